# SPDX-License-Identifier: Apache-2.0
"""Each refusal of a command or a parameter names a cure; what it advises is accepted."""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from table_1 import TABLE_1

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError

Do = Callable[[Axis], Any]


class Case(NamedTuple):
    """A refusal, words of its cure, and what follows them."""

    refused: Do
    cure: str
    advised: list[Do]


def command(name: str, *arguments: Any) -> Do:
    return lambda axis: axis.command(name, *arguments)


def put(**values: Any) -> Do:
    return lambda axis: axis.command("parameters", values)


def both(*steps: Do) -> Do:
    """Return what does one after the other."""
    return lambda axis: [step(axis) for step in steps]


CASES = {
    "amplitude too high": Case(
        command("amplitude", 301.0), "lower it", [command("amplitude", 299.0)]
    ),
    "amplitude too low": Case(command("amplitude", -1.0), "raise it", [command("amplitude", 50.0)]),
    "frequency too high": Case(command("frequency", 2e5), "lower it", [command("frequency", 15e3)]),
    "frequency too low": Case(
        command("frequency", -1.0), "raise it", [command("frequency", 100.0)]
    ),
    "slip too long": Case(
        both(put(slewrate=1.0), command("frequency", 5e3)),
        "stay below 3333.33 Hz, or lower the amplitude or raise the slewrate",
        [
            both(put(slewrate=1.0), command("frequency", 3.3e3)),
            both(put(slewrate=1.0), command("amplitude", 100.0), command("frequency", 5e3)),
            both(put(slewrate=10.0), command("frequency", 5e3)),
        ],
    ),
    "jog too fast": Case(command("jog", 1e9), "lower it", [command("jog", 1000.0)]),
    "scan above": Case(command("scan", 301.0), "stay below it", [command("scan", 300.0)]),
    "scan below": Case(command("scan", -301.0), "stay above it", [command("scan", 0.0)]),
    "target beyond": Case(
        command("position", 1.0), "choose one in this range", [command("position", 0.0099)]
    ),
    "trajectory of others": Case(
        command("trajectory", ["x"], [(1.0, 0.0)]),
        "give axis_slider only",
        [command("trajectory", ["axis_slider"], [(1.0, 0.0)])],
    ),
    "trajectory without points": Case(
        command("trajectory", ["axis_slider"], []),
        "give at least one point",
        [command("trajectory", ["axis_slider"], [(0.1, 0.0)])],
    ),
    "soft limits crossed": Case(
        put(soft_low=1e-3, soft_high=-1e-3),
        "it has to be less than soft_high",
        [put(soft_low=-1e-3, soft_high=1e-3)],
    ),
    "mass too low": Case(put(mass=-1.0), r"has to lie between (\S+) ", [put(mass=1e-3)]),
    "distance of slip": Case(
        put(z_ss=1e-9), "raise z_ss .*or lower z_ba", [put(z_ss=5e-8), put(z_ss=1e-9, z_ba=5e-10)]
    ),
    "load too fast": Case(
        put(force=900.0, mass=1e-6), "lower force or raise mass", [put(force=0.1), put(mass=0.01)]
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_advised_is_accepted(name: str) -> None:
    case = CASES[name]
    with pytest.raises((CommandRefused, ParameterError)) as refused:
        case.refused(Axis(TABLE_1))
    assert re.search(case.cure, str(refused.value)), str(refused.value)
    for follow in case.advised:
        follow(Axis(TABLE_1))


@pytest.mark.parametrize(
    "name", [name for name, row in PARAMETERS.items() if row.kind in (int, float)]
)
def test_the_ends_of_a_range_are_in_it(name: str) -> None:
    """What a refusal of a number allows is allowed, and what lies beyond is not."""
    row = PARAMETERS[name]
    for end in (row.low, row.high):
        assert row.check(row.kind(end)) == end
    beyond = row.high + (abs(row.high) or 1)
    with pytest.raises(ParameterError) as refused:
        row.check(row.kind(beyond))
    assert f"{row.high:g}" in str(refused.value)
