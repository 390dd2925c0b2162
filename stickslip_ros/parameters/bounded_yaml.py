# SPDX-License-Identifier: Apache-2.0
"""YAML from strangers: bounded in size, depth and digits; a key twice is refused.

Numbers are those that ROS takes: `1e-6` and `7.0e6` are numbers, `1:30` is text.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

_LARGEST = 1024 * 1024  # characters, and values once aliases are followed
_DEEPEST = 20
_LONGEST_NUMBER = 100  # characters; 64 bits in binary take 67

# The parsers in C are ten times as fast; they are missing where PyYAML was built without libyaml.
_C = hasattr(yaml, "CSafeLoader")
_BASE: Any = yaml.CBaseLoader if _C else yaml.BaseLoader
_SAFE: Any = yaml.CSafeLoader if _C else yaml.SafeLoader

_FLOAT = "tag:yaml.org,2002:float"
#: Numbers as in YAML 1.1, but for those to the base of 60, and with exponents as C reads them
_NUMBERS = {
    "tag:yaml.org,2002:int": re.compile(
        r"[-+]?(0b[0-1_]+|0[0-7_]+|0|[1-9][0-9_]*|0x[0-9a-fA-F_]+)\Z"
    ),
    _FLOAT: re.compile(
        r"([-+]?([0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)([eE][-+]?[0-9]+)?"
        r"|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))\Z"
    ),
}


class _OneOfEach:
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    line = key.start_mark.line + 1
                    raise yaml.YAMLError(f"{key.value!r} stands there twice, again in line {line}")
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)  # type: ignore[misc]


class _Texts(_OneOfEach, _BASE):  # type: ignore[misc]
    pass


class _Values(_OneOfEach, _SAFE):  # type: ignore[misc]
    yaml_implicit_resolvers = {  # noqa: RUF012  as in the class above
        first: [(tag, _NUMBERS.get(tag, pattern)) for tag, pattern in resolvers]
        for first, resolvers in _SAFE.yaml_implicit_resolvers.items()
    }

    def construct_yaml_int(self, node: yaml.ScalarNode) -> Any:
        if len(node.value) > _LONGEST_NUMBER:
            raise yaml.YAMLError(f"a number of {len(node.value)} digits")
        return super().construct_yaml_int(node)


_Values.add_constructor("tag:yaml.org,2002:int", _Values.construct_yaml_int)


def load_values(text: str) -> Any:
    """Load YAML text.

    :raises ValueError: not YAML, a duplicate key, or text that takes much time or memory to load.
    """
    return _load(text, _Values)


def load_texts(text: str) -> Any:
    """Load YAML text with all values as texts, without numbers and dates.

    :raises ValueError: as :func:`load_values`.
    """
    return _load(text, _Texts)


def _load(text: str, loader: Any) -> Any:
    if len(text) > _LARGEST:
        raise ValueError(f"it has {len(text)}, at most {_LARGEST} characters of YAML are allowed")
    try:
        _refuse_traps(text)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"not YAML ({' '.join(str(error).split())[:300]})") from None


def _refuse_traps(text: str) -> None:
    """Deep nesting overflows the stack; aliases can make a short text very long."""
    sizes: dict[str | None, int] = {}  # of the values with an anchor, in scalars
    inside: list[tuple[str | None, int]] = []  # anchor of each open collection, size before it
    size = 0
    for event in yaml.parse(text, Loader=_BASE):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("YAML with a value inside itself, or an unknown alias")
            size += sizes[event.anchor]
        elif isinstance(event, yaml.CollectionStartEvent):
            inside.append((event.anchor, size))
            size += 1
            if len(inside) > _DEEPEST:
                raise ValueError(f"YAML nested more than {_DEEPEST} deep")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = inside.pop()
            sizes[anchor] = size - before
        elif isinstance(event, yaml.ScalarEvent):
            size += 1
            sizes[event.anchor] = 1
        if size > _LARGEST:
            raise ValueError(f"YAML that is too long: more than {_LARGEST} values")
