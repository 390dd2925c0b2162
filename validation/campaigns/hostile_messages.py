# SPDX-License-Identifier: Apache-2.0
"""Hostile messages of any type, built by Hypothesis from the fields that the type defines.

A value is either one that an axis would take, so that what follows it is reached, or one at a limit
of its type, or not a number, or far too long.
"""

import math
import re
import struct
import time
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any, TypeVar

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded
from hypothesis import strategies as some
from hypothesis.strategies import SearchStrategy

from stickslip_ros.physics.parameters import PARAMETERS
from stickslip_ros.ros.nodes.messages import message_class

#: Numbers at which arithmetic goes wrong, and some that an axis takes.
FLOATS = (
    0.0, -0.0, 1e-9, -1e-6, 1.0, -3.0, 100.0, 300.0, math.nan, math.inf, -math.inf,
    5e-324, -1e-300, 1e15, -1e40, 1e308, -1.7976931348623157e308,
)  # fmt: skip
WHOLE = (0, 1, -1, 2, 7, 10, 100, 255, 1000)
TEXTS = (
    "", "axis_slider", "axis_piezo", "/", "..", "\0", "a\0b", "%s%n", "line\nline", "\u202e",
    "\U0001f980", "0x10", "1e999", "nan", "/dev/zero", "x" * 300, "y" * 200_000,
)  # fmt: skip
#: Names of parameters, among them those that every node has and one that none has.
NAMES = (*PARAMETERS, "use_sim_time", "start_type_description_service", "qos_overrides./x", "no")
#: Numbers of elements: none, few, too many.
LONG = 3000

T = TypeVar("T")
_ROUND = 20  # examples of one seed

_BITS = {f"{sign}int{bits}": (bits, not sign) for bits in (8, 16, 32, 64) for sign in ("", "u")}


def messages(kind: type[Any]) -> SearchStrategy[Any]:
    """Give messages of a class of ROS."""
    if not (fields := kind.get_fields_and_field_types()):
        return some.builds(kind)
    if kind.__name__ == "Parameter":
        fields = {**fields, "name": "name of a parameter"}
    return some.builds(_filled(kind), **{name: values(type_) for name, type_ in fields.items()})


def _filled(kind: type[Any]) -> Callable[..., Any]:
    def fill(**found: Any) -> Any:
        return kind(**found)

    return fill


def values(kind: str) -> SearchStrategy[Any]:
    """Give values of a field whose type reads as `get_fields_and_field_types` writes it."""
    if sequence := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        return _lists(sequence[1], int(sequence[2] or LONG))
    if array := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        count = int(array[2])
        return some.lists(values(array[1]), min_size=count, max_size=count)
    if kind in _BITS:
        bits, signed = _BITS[kind]
        low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
        usual = [number for number in (*WHOLE, low, high, low + 1) if low <= number <= high]
        return some.sampled_from(usual) | some.integers(low, high)
    if kind == "double":
        return some.sampled_from(FLOATS) | some.floats()
    if kind == "float":
        return some.floats(width=32)
    if kind == "boolean":
        return some.booleans()
    if kind == "octet":
        return some.binary(min_size=1, max_size=1)
    if kind == "name of a parameter":
        return some.sampled_from(NAMES) | some.sampled_from(TEXTS)
    if kind.startswith(("string", "wstring")):
        # What cannot be encoded cannot be sent either.
        return some.sampled_from(TEXTS) | some.text(some.characters(codec="utf-8"), max_size=40)
    package, name = kind.split("/")
    return messages(message_class(f"{package}/msg/{name}"))


def _lists(kind: str, most: int) -> SearchStrategy[list[Any]]:
    """Give none, a few, or so many elements; many are small ones, to spare the machine."""
    few = some.lists(values(kind), max_size=min(4, most))
    if "/" in kind:
        package, name = kind.split("/")
        return few | some.just([message_class(f"{package}/msg/{name}")()] * most)
    one = some.sampled_from(TEXTS[:-1]) if kind.startswith("string") else values(kind)
    return few | one.map(lambda value: [value] * most)


@some.composite
def damaged(draw: Callable[..., Any], whole: bytes) -> bytes:
    """Give the bytes of a message with a piece of them other than it was."""
    data = bytearray(whole)
    at = draw(some.integers(0, len(data)))
    match draw(some.integers(0, 4)):
        case 0:
            del data[at:]
        case 1:
            data[at:at] = draw(some.binary(max_size=30))
        case 2:
            data[at : at + 4] = struct.pack("<I", draw(some.sampled_from(LENGTHS)))
        case 3:
            data[at : at + 1] = draw(some.binary(min_size=1, max_size=1))
        case _:
            data = bytearray(draw(some.binary(max_size=200)))
    return bytes(data)


#: Lengths of texts and sequences that lie.
LENGTHS = (0, 1, 2**16, 2**24, 2**28, 2**31 - 1, 2**31, 2**32 - 4, 2**32 - 1)


def _check_each(strategy: SearchStrategy[T], check: Callable[[T], object], seed: int, most: int,
                *phases: Phase) -> None:  # fmt: skip
    how: dict[str, Any] = {"deadline": None, "database": None, "print_blob": False}
    checks = settings(
        max_examples=most, phases=phases, suppress_health_check=list(HealthCheck), **how
    )

    def checked(example: T) -> None:
        check(example)

    seeded(seed)(checks(given(strategy)(checked)))()


def examples(strategy: SearchStrategy[T], seed: int, most: int) -> list[T]:
    """Return as many examples as that, from a seed."""
    found: list[T] = []
    _check_each(strategy, found.append, seed, most, Phase.generate)
    return found


def search(
    strategy: SearchStrategy[T], check: Callable[[T], None], seconds: float, seed: int,
    finds: Iterable[T] = (),
) -> int:  # fmt: skip
    """Check examples until the time is up, those found earlier first; return how many.

    What fails is made as small as it can be before it is told.
    """
    done, end = 0, time.monotonic() + seconds
    for one in finds:
        check(one)

    def check_in_time(example: T) -> None:
        nonlocal done
        done += 1
        if time.monotonic() < end:
            check(example)

    for number in count(seed):
        _check_each(strategy, check_in_time, number, _ROUND, Phase.generate, Phase.shrink)
        if time.monotonic() > end:
            break
    return done
