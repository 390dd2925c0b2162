# SPDX-License-Identifier: Apache-2.0
"""Events go into texts and come back as they were."""

import math
from array import array

from hypothesis import given
from hypothesis import strategies as st
from table_1 import table_1

from stickslip_ros.axis.events import Event, event_texts, value_text

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(time=finite, value=finite | st.integers(-(2**31), 2**31) | st.booleans())
def test_what_goes_in_comes_out(time: float, value: float | int | bool) -> None:
    event = Event(time, "steps", "applied", {"value": value})
    back = Event.of(event_texts(event))
    assert back == event
    assert type(back.details["value"]) is type(value)


def test_every_kind_of_detail_comes_back() -> None:
    for details in [
        {},
        {"joints": ["axis_slider"], "points": [[0.5, 1e-6], [1.0, -2.5e-7]]},
        {**table_1().flat(), "version": "1.2.3"},
        {"waveform_table": "7", "preload": 2.0},
    ]:
        event = Event(0.1, "start", "applied", details)
        assert Event.of(event_texts(event)) == event


def test_what_is_no_event_is_none() -> None:
    assert Event.of({"state": "stopped"}) is None


def test_values_are_written_in_full() -> None:
    assert value_text(0.1 + 0.2) == "0.30000000000000004"
    assert value_text(math.nan) == value_text(None) == "nan"
    assert value_text(True) == "True"
    assert value_text({"mass": array("d", [0.5])}) == '{"mass": [0.5]}'
