# SPDX-License-Identifier: Apache-2.0
"""attocube's AMC: the requests of the maker's driver and of Diamond's EPICS driver, as they come.

The maker's driver is in no package index. It sends objects without an end and reads up to CR LF;
the first value of a result is the error, which it raises.
"""

import itertools
import json
import time
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live import wait_until

from stickslip_ros.emulator.amc import ERRORS, Objects

AMC = {"gain": 5e-9, "frequency": 1000.0, "sensor_noise": 0.0}


class Driver:
    """Sends requests as the maker's driver does."""

    def __init__(self, emulated: Any) -> None:
        self.client = emulated.client()
        self._number = 0

    def request(self, method: str, *values: object, **others: object) -> Any:
        self._number += 1
        asked = {"jsonrpc": "2.0", "method": method, "api": 2, "id": self._number, **others}
        if values:
            asked["params"] = list(values)
        self.client.send(json.dumps(asked).encode())
        answer = json.loads(self.client.until(b"\r\n"))
        assert answer["id"] == self._number
        return answer

    def __call__(self, method: str, *values: object) -> Any:
        """Return the values of a result without error."""
        error, *found = self.request(f"com.attocube.amc.{method}", *values)["result"]
        assert error == 0, method
        return found[0] if len(found) == 1 else found

    def wait(self, method: str, value: object) -> None:
        """Wait until a method returns a value for axis 0."""
        end = time.monotonic() + 20.0
        while self(method, 0) != value:
            assert time.monotonic() < end, method


def test_the_closed_loop_and_motion_without_end(emulate: Callable[..., Any]) -> None:
    emulated = emulate("amc", AMC)
    amc = Driver(emulated)
    amc("move.setControlContinuousFwd", 0, True)
    assert amc("status.getStatusMoving", 0) == 2  # until the output is enabled
    assert amc("status.getFullCombinedStatus", 0) == "output not enabled"
    amc("control.setControlOutput", 0, True)
    assert amc("status.getStatusMoving", 0) == 1
    amc("move.setControlContinuousBkwd", 0, False)
    amc.wait("status.getStatusMoving", 0)
    amc("control.setReset", 0)
    amc("control.setControlMove", 0, True)
    amc("move.setControlTargetPosition", 0, 3000)
    wait_until(lambda: emulated.look(lambda: emulated.axes[0].mode) == "holding", "the target")
    assert amc("status.getStatusTargetRange", 0)
    assert amc("move.getPosition", 0) == pytest.approx(3000, abs=100)
    amc("control.MultiAxisPositioning", 1, 0, 0, -500, 0, 0)
    assert amc("move.getControlTargetPosition", 0) == -500
    amc.wait("status.getStatusTargetRange", True)
    amc("control.setControlOutput", 0, False)
    wait_until(lambda: emulated.look(lambda: emulated.axes[0].mode) == "stopped", "a stop")


def test_steps_and_the_search_for_the_reference(emulate: Callable[..., Any]) -> None:
    emulated = emulate("amc", {**AMC, "frequency": 500.0})
    amc = Driver(emulated)
    amc("control.setControlOutput", 0, True)
    amc("control.setControlAmplitude", 0, 45000)
    amc("control.setControlFrequency", 0, 1000000)
    amc("move.setNSteps", 0, True, 20)
    amc.wait("status.getStatusMoving", 0)
    status = emulated.look(lambda: emulated.axes[0].status)
    assert (status.step_count, status.amplitude, status.frequency) == (-20, 45.0, 1000.0)
    amc("control.setControlAutoReset", 0, True)
    amc("control.searchReferencePosition", 0)
    amc.wait("status.getStatusReference", True)
    assert amc("move.getPosition", 0) == pytest.approx(0, abs=100)


def test_the_requests_of_the_epics_driver(emulate: Callable[..., Any]) -> None:
    """They end with a line feed and have no api; texts come without the number of an error."""
    with emulate("amc", AMC).client() as client:
        for method, values, result in (
            ("system.getFirmwareVersion", [], None),
            ("amc.status.getStatusConnected", [0], [0, True]),
            ("amc.status.getStatusReference", [0], [0, False]),
            ("amc.control.setControlAutoReset", [0, True], [0]),
            ("amc.control.getControlAutoReset", [0], [0, True]),
            ("amc.control.getReferencePosition", [0], [0, 0]),
            ("amc.status.getStatusEotFwd", [0], [0, False]),
            ("amc.control.getControlFrequency", [0], [0, 1000000]),
        ):
            asked = {"jsonrpc": "2.0", "method": f"com.attocube.{method}", "params": values}
            answer = json.loads(client.ask(json.dumps({**asked, "id": 7})))
            assert answer["id"] == 7
            assert answer["result"] == result or isinstance(answer["result"][0], str)


def test_what_is_no_request_is_answered(emulate: Callable[..., Any]) -> None:
    with emulate("amc").client() as client:
        move = '{"method": "com.attocube.amc.move.'
        for asked, code in [
            ("not json", -32700),
            ("[1]", -32600),
            ("{}", -32600),
            ('{"method": 5}', -32600),
            ("}", -32700),
            ('{"a": "' + "x" * 5000 + '"}', -32700),
            ('{"method": "com.attocube.amc.fly.away"}', -32601),
            ('{"method": "getLockStatus", "id": [1]}', -32600),
            (move + 'getPosition"}', -32602),
            (move + 'getPosition", "params": ["0"]}', -32602),
            (move + 'getPosition", "params": [true]}', -32602),
            (move + 'getPosition", "params": [0.0]}', -32602),
            (move + 'getPosition", "params": {"axis": 0}}', -32602),
            (move + 'getPosition", "params": 0}', -32602),
            (move + 'setNSteps", "params": [0, true]}', -32602),
            (move + 'setNSteps", "params": [0, 2, 5]}', -32602),
            (move + 'setNSteps", "params": [0, true, true]}', -32602),
            (move + 'setNSteps", "params": [0, true, 1.5]}', -32602),
            (move + 'setNSteps", "params": [0, true, NaN]}', -32700),
            (move + 'setControlTargetPosition", "params": [0, null]}', -32602),
            (move + 'writeNSteps", "params": [0, 1e999]}', -32602),
        ]:
            assert json.loads(client.ask(asked))["error"]["code"] == code, asked
            after = json.loads(client.ask('{"method": "getLockStatus"}'))
            assert after["result"] == [0, False, True], asked


def test_what_cannot_be_is_an_error_with_a_text_and_changes_nothing(
    emulate: Callable[..., Any],
) -> None:
    emulated = emulate("amc", {**AMC, "soft_high": 5e-6})
    amc = Driver(emulated)

    def kept() -> list[Any]:
        names = "move.getControlTargetPosition", "control.getControlMove", "move.getNSteps"
        drive = "control.getControlAmplitude", "control.getControlFrequency"
        return [amc(name, 0) for name in (*names, "control.getControlTargetRange", *drive)]

    for on in (False, True):
        amc("control.setControlOutput", 0, on)
        amc("control.setControlMove", 0, on)
        for method, values, number, text in (
            ("control.setControlAmplitude", (0, 60001), 7, "Parameter out of range"),
            ("control.setControlFrequency", (0, 0), 7, "Parameter out of range"),
            ("control.setControlTargetRange", (0, -1), 7, "Parameter out of range"),
            ("control.MultiAxisPositioning", (1, 1, 0, 2000, 0, 0), 7, "Parameter out of range"),
            ("control.MultiAxisPositioning", (1, 0, 0, 5001, 0, 0), 7, "Parameter out of range"),
            ("move.writeNSteps", (0, 0), 7, "Parameter out of range"),
            ("move.setControlTargetPosition", (0, 5001), 7, "Parameter out of range"),
            ("move.getPosition", (8,), 7, "Parameter out of range"),
            ("move.moveReference", (0,), 3 if on else 2, "No reference" if on else ERRORS[2]),
            ("rtin.getGpioMode", (), 10, "Feature not available"),
        ):
            before = kept()
            assert amc.request(f"com.attocube.amc.{method}", *values)["result"] == [number], method
            told = amc.request("com.attocube.system.errorNumberToString", 0, number)["result"]
            assert told == [0, text], method
            assert kept() == before, method
    amc("control.setControlOutput", 0, False)
    assert amc.request("com.attocube.amc.move.setNSteps", 0, True, 5)["result"] == [2]
    emulated.look(lambda: emulated.axes[0].trip("tried out"))
    amc("move.setControlContinuousFwd", 0, False)  # a stop is never refused


@pytest.mark.long
@settings(max_examples=40)
@given(
    st.lists(st.dictionaries(st.text(max_size=4), st.text(max_size=9), max_size=3), max_size=5),
    st.lists(st.integers(0, 200), max_size=6),
)
def test_objects_are_cut_however_they_come(objects: list[Any], cuts: list[int]) -> None:
    stream = "".join(json.dumps({"a": one}) for one in objects).encode()
    ends = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    reader, found = Objects(), []
    for begin, end in itertools.pairwise(ends):
        found += reader.take(stream[begin:end])
    assert [json.loads(one or b"") for one in found] == [{"a": one} for one in objects]
