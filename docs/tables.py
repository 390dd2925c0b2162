# SPDX-License-Identifier: Apache-2.0
"""Writes what is registered where it is shown: in pages of docs/, the SROS 2 policy.

    python docs/tables.py            writes them
    python docs/tables.py --check    says what is out of date

A table stands between `<!-- table: NAME -->` and `<!-- end -->`. The package must be installed.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path

from stickslip_ros.axis.command import FLOAT64, INT32, STATES, Command
from stickslip_ros.axis.commands import COMMANDS, state_table
from stickslip_ros.axis.faults import FAULTS
from stickslip_ros.client import AxisClient
from stickslip_ros.emulator import CONTROLLERS, commands_of
from stickslip_ros.measurement.metric import METRICS
from stickslip_ros.measurement.twin.recording import KNOWN, UNKNOWN
from stickslip_ros.physics.parameters import PARAMETERS, NodeParameters
from stickslip_ros.ros.nodes.diagnostics import STATUS_KEYS
from stickslip_ros.ros.nodes.node_parameters import OF_PROCESS
from stickslip_ros.ros.nodes.topics import OUTPUTS, READY, TWIN_OUTPUTS, OutputTopic

PAGES = Path(__file__).parent
_AXIS, _TWIN = "/stickslip_axis", "/stickslip_twin"  # the nodes, as the policy names them


def _markdown(rows: Iterator[Sequence[str]]) -> str:
    """Return rows, the names of the columns first, as a table."""
    head, *body = ("| " + " | ".join(cells) + " |" for cells in rows)
    return "\n".join([head, "|---" * head.count(" | ") + "|---|", *body])


def _states() -> Iterator[Sequence[str]]:
    yield "command", *STATES
    for name, row in state_table().items():
        yield name, *(row[state] for state in STATES)


def _status() -> Iterator[Sequence[str]]:
    yield "key", "unit", "value"
    for key, (_, meaning) in STATUS_KEYS.items():
        yield f"`{key}`", key.partition(" (")[2].rstrip(")"), meaning


def _commands() -> Iterator[Sequence[str]]:
    yield "topic or service", "type", "meaning", "example"
    for command in COMMANDS.values():
        parts = command.type.split("/")
        yield (
            f"`~/{command.interface}`",
            f"{parts[0]}/{parts[-1]}",
            _meaning(command),
            _example(command),
        )


def _outputs(topics: Iterable[OutputTopic]) -> Iterator[Sequence[str]]:
    yield "topic", "type", "kept for late subscribers", "content"
    for topic in topics:
        parts = topic.type.split("/")
        kept = f"the last {topic.kept}" if topic.kept > 1 else "the last" * topic.kept
        yield f"`{topic.name}`", f"{parts[0]}/{parts[-1]}", kept, topic.content


def _of_process() -> Iterator[Sequence[str]]:
    yield "parameter", "default", "changes while it runs", "meaning"
    for own in OF_PROCESS:
        yield f"`{own.name}`", _shown(own.default), "", own.description
    for name in (field.name for field in fields(NodeParameters) if field.name != "axis_name"):
        row = PARAMETERS[name]
        unit = f"{row.unit}: " if row.unit else ""
        yield f"`{name}`", _shown(row.default), "yes" * row.mutable, unit + row.description


def _shown(default: object) -> str:
    """Return a default as it is written in YAML."""
    return "[]" if default == [""] else json.dumps(default)


def _faults() -> Iterator[Sequence[str]]:
    yield "fault", "value", "meaning"
    for name, fault in FAULTS.items():
        value = "" if fault.unit is None else f"{fault.default:g} {fault.unit}".strip()
        yield f"`{name}`", value, fault.meaning


def _protocols() -> Iterator[Sequence[str]]:
    yield "controller", "emulated", "answered as unsupported"
    for name in CONTROLLERS:
        known = commands_of(name)
        yield (
            f"`{name}`",
            *(_names(one for one in known if known[one] is emulated) for emulated in (True, False)),
        )


def _client() -> Iterator[Sequence[str]]:
    yield "of an `AxisClient`", "what it does"
    for cls in (AxisClient, *AxisClient.__bases__):
        for name, member in vars(cls).items():
            text = inspect.getdoc(member)
            if name.startswith("_") or not text:
                continue
            inputs = "" if isinstance(member, property) else f"({_inputs(member)})"
            yield f"`{name}{inputs}`", " ".join(text.split("\n\n")[0].split())


def _inputs(method: Callable[..., object]) -> str:
    names = [*inspect.signature(method).parameters.values()][1:]
    return ", ".join(str(one.replace(annotation=one.empty)) for one in names)


def _names(names: Iterable[str]) -> str:
    """Return names of commands in order; a byte that cannot be shown as its number."""
    shown = (one if one.isprintable() else f"#{ord(one)}" for one in names)
    return ", ".join(f"`{one}`" for one in sorted(shown))


def _metrics() -> Iterator[Sequence[str]]:
    yield "metric", "limit", "tolerance at least", "what it is"
    for row in METRICS:
        floor = f"{1e9 * row.floor:g} nm" if row.unit == "m" else f"{100.0 * row.floor:.2g} %"
        yield row.name, f"`--max-{row.limit}`" if row.limit else "", floor, row.meaning


def _meaning(command: Command) -> str:
    field = f"`{command.field}`, " if command.field != "data" else ""
    unit = f"{command.unit}: " if command.unit else ""
    return field + unit + command.meaning


def _example(command: Command) -> str:
    if len(command.example) < 2 or command.arguments is None:
        return ", ".join(f"`{value}`" for value in command.example)
    return ", ".join(
        f"{name} `{value}`" for name, value in zip(command.arguments, command.example, strict=False)
    )


def _table(rows: Callable[[], Iterator[Sequence[str]]]) -> Callable[[], str]:
    return lambda: _markdown(rows())


def _allowed(*but: OutputTopic) -> str:
    """Return the topics of an axis, but for some, as the policy for SROS 2 allows them."""
    return _entries("topic", (o.full_name(_AXIS) for o in OUTPUTS.values() if o not in but))


def _of_twin() -> str:
    """Return the topics of a twin, as the policy allows them."""
    return _entries("topic", (one.full_name(_TWIN) for one in TWIN_OUTPUTS))


def _heard_by_twin() -> str:
    """Return the topics of commands that a twin hears from other programs."""
    heard = [one for one in COMMANDS.values() if one.name in (*KNOWN, *UNKNOWN)]
    plain = [one.interface for one in heard if one.type in (INT32, FLOAT64)]
    return _entries("topic", (f"/{name}" for name in plain))


def _commanded(tag: str) -> str:
    """Return the topics or services of the commands of an axis, as the policy allows them."""
    offered = [one for one in COMMANDS.values() if one.arguments is not None]
    chosen = [one for one in offered if one.is_service == (tag == "service")]
    return _entries(tag, (f"{_AXIS}/{one.interface}" for one in chosen))


def _entries(tag: str, names: Iterable[str]) -> str:
    """Return names as entries of the policy."""
    return "\n".join(f"            <{tag}>{name}</{tag}>" for name in sorted(names))


TABLES: dict[str, list[Callable[[], str]]] = {
    "states.md": [_table(_states), _table(_status)],
    "commands.md": [_table(_client)],
    "node.md": [_table(_commands), _table(lambda: _outputs(OUTPUTS.values())), _table(_of_process)],
    "twin.md": [_table(lambda: _outputs(TWIN_OUTPUTS))],
    "faults.md": [_table(_faults)],
    "compare.md": [_table(_metrics)],
    "emulator.md": [_table(_protocols)],
    # What an axis offers, publishes and hears; what a recorder hears; what a commander may ask;
    # what a twin publishes, and hears of other programs.
    "../config/sros2_policy.xml": [
        lambda: _commanded("service"),
        _allowed,
        lambda: _commanded("topic"),
        lambda: _allowed(READY),
        lambda: _commanded("topic"),
        lambda: _commanded("service"),
        lambda: _commanded("topic"),
        _of_twin,
        _heard_by_twin,
    ],
}


def current(page: str) -> tuple[str, str]:
    """Return the text of a page as it is, and with its tables as the registries have them."""
    text = (PAGES / page).read_text(encoding="utf-8")
    tables = [make() for make in TABLES[page]]
    parts = iter(tables)
    written, marked = re.subn(
        r"(<!-- table: [^\n]+ -->\n).*?(\n *<!-- end -->)",
        lambda match: match[1] + next(parts, "") + match[2],
        text,
        flags=re.DOTALL,
    )
    if marked != len(tables):
        raise ValueError(f"docs/{page} has {marked} marked tables; it needs {len(tables)}")
    return text, written


def findings() -> Iterator[str]:
    """Yield what is out of date and the cure."""
    for page in TABLES:
        text, written = current(page)
        if text != written:
            yield f"docs/{page}: run python docs/tables.py"


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit("\n".join(findings()) or 0)
    for name in TABLES:
        (PAGES / name).write_text(current(name)[1], encoding="utf-8")
