# SPDX-License-Identifier: Apache-2.0
"""Numbers as people read them; colours, the micro sign and notes on slow work on terminals."""

import io
import math
import os
import pty
import threading
from collections.abc import Iterator

import pytest
from live import wait_until

from stickslip_ros.base.reporting import format_si
from stickslip_ros.base.reporting.terminal import announce_if_slow, nanometres, style_text
from stickslip_ros.cli.main import main

RED = "\x1b[31mwrong\x1b[0m"


@pytest.fixture(autouse=True)
def no_wishes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody has said what to do about colours."""
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")


@pytest.fixture
def terminal() -> Iterator[io.TextIOWrapper]:
    """A pseudo-terminal of Linux."""
    master, slave = pty.openpty()
    with open(slave, "w", encoding="utf-8") as stream:
        yield stream
    os.close(master)


def test_an_error_sets_the_decimals() -> None:
    said = [nanometres(133.7664e-9, error) for error in (0.139e-9, 12e-9, 9.96e-11, 3e-18)]
    assert said == [
        "133.77 nm, standard error 0.14 nm",
        "134 nm, standard error 12 nm",
        "133.766 nm, standard error 0.100 nm",
        "133.766 nm",
    ]
    assert nanometres(math.nan, math.nan) == "not measurable"


def test_a_terminal_gets_colours_and_a_pipe_none(terminal: io.TextIOWrapper) -> None:
    assert style_text("wrong", "red", terminal) == RED
    assert style_text("wrong", "red", io.StringIO()) == "wrong"


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_who_wants_no_colours_gets_none(
    name: str, value: str, terminal: io.TextIOWrapper, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    assert style_text("wrong", "red", terminal) == "wrong"


def test_a_pipe_gets_colours_where_they_are_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    """As runners of CI do, which show them."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert style_text("wrong", "red", io.StringIO()) == RED
    monkeypatch.setenv("NO_COLOR", "1")
    assert style_text("wrong", "red", io.StringIO()) == "wrong"


def test_an_error_is_coloured_up_to_its_text(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["simulate", "--steps", "0"]) == 2
    plain = capsys.readouterr().err
    assert plain.startswith("stickslip simulate: --steps is 0")
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert main(["simulate", "--steps", "0"]) == 2
    assert capsys.readouterr().err == plain.replace(
        "stickslip simulate:", "\x1b[1;31mstickslip simulate:\x1b[0m", 1
    )


class Shown(io.StringIO):
    """A terminal whose text can be read."""

    def isatty(self) -> bool:
        return True


def timers() -> list[threading.Timer]:
    return [one for one in threading.enumerate() if isinstance(one, threading.Timer)]


def test_what_lasts_is_named_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip_ros.base.reporting.terminal._PATIENCE", 0.01)
    stream = Shown()
    monkeypatch.setattr("sys.stderr", stream)
    with announce_if_slow("searching"):
        wait_until(lambda: stream.getvalue() == "searching ...\n", "what goes on")


def test_what_ends_at_once_is_not_named_nor_anything_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for stream, in_pipes, waiting in (
        (Shown(), False, 1),
        (io.StringIO(), False, 0),
        (io.StringIO(), True, 1),
    ):
        monkeypatch.setattr("sys.stderr", stream)
        before = timers()
        with announce_if_slow("searching", in_pipes):
            begun = [one for one in timers() if one not in before]
            assert len(begun) == waiting
        for one in begun:
            one.join(30.0)
        assert stream.getvalue() == ""


def test_a_value_has_a_unit_of_fitting_size() -> None:
    for value, unit, text in [
        (133.83e-9, "m", "133.8 nm"),
        (-1e-9, "m", "-1.000 nm"),
        (3e-6, "m", "3000 nm"),
        (2.1e-3, "m", "2.100 mm"),
        (3e-6, "s", "3.000 µs"),
        (2.5266e6, "N/m", "2.527 N/µm"),
        (12.0, "N/m", "12.00 N/m"),
        (3990.0, "Hz", "3990 Hz"),
        (1e-16, "m", "0 nm"),
        (math.nan, "m", "–"),
    ]:
        assert format_si(value, unit) == text


def test_an_uncertainty_sets_the_digits() -> None:
    assert format_si(133.8312e-9, "m", uncertainty=0.052e-9) == "133.831 ± 0.052 nm"
    assert format_si(36.73055e-6, "s", uncertainty=311e-9) == "36.73 ± 0.31 µs"
    assert format_si(-4.0e3, "Hz", uncertainty=120.0) == "-4000 ± 120 Hz"
    assert format_si(1.0, "N", uncertainty=math.nan) == "1.000 N"


def test_the_unit_can_be_that_of_another_value() -> None:
    assert format_si(1e-9, "s", like=1e-6) == "0.001 µs"
