# SPDX-License-Identifier: Apache-2.0
"""The tables of parameters of recorder and player: what a number may be."""

import math

import pytest

from stickslip_ros.base.errors import UsageError
from stickslip_ros.ros.nodes import recorder_node, replay_node
from stickslip_ros.ros.nodes.node_parameters import OwnParameter

NUMBERS = [
    row
    for row in (*recorder_node.PARAMETERS, *replay_node.PARAMETERS)
    if isinstance(row.default, float)
]


@pytest.mark.parametrize("row", NUMBERS, ids=lambda row: str(row.name))
def test_a_number_that_means_nothing_is_refused_with_its_limits(row: OwnParameter) -> None:
    """1e300 s ended in an OverflowError, and 1e-12 s in a new file with each message."""
    row.check(row.default)
    row.check(row.low)
    row.check(row.high)
    tiny = [1e-12] if row.name != "start" else []  # which begins where 0 does
    for value in (1e300, -1.0, math.nan, math.inf, *tiny):
        with pytest.raises(UsageError) as refused:
            row.check(value)
        text = str(refused.value)
        assert f"{row.name} is {value:g}" in text
        assert f"between {row.low:g} and {row.high:g}" in text


def test_every_number_has_limits() -> None:
    assert len(NUMBERS) == 7
    assert all(-math.inf < row.low < row.high < math.inf for row in NUMBERS)
