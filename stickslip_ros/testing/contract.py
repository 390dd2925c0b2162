# SPDX-License-Identifier: Apache-2.0
"""Behaviour that every driver of a stick-slip axis should show; each test states one piece of it.

    pytest --pyargs stickslip_ros.testing.contract --stickslip-driver my_lab.driver:connect

Nothing here knows how far a step goes: what one move did is compared with what another did. A real
axis is moved by some hundred steps to both sides of where it stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest

from stickslip_ros.testing.driver import Driver, driver_named

POLL_S = 0.005
STEPS = 40  # of a usual move


@pytest.fixture
def driver(request: pytest.FixtureRequest) -> Iterator[Driver]:
    """Give the driver that the option names, with its usual drive, at rest.

    Where none can be made, no test can run: the session ends.
    """
    try:
        found = driver_named(request.config.getoption("--stickslip-driver"))
    except pytest.UsageError as error:
        pytest.exit(str(error), returncode=pytest.ExitCode.USAGE_ERROR)
    try:
        found.set_drive(found.amplitude, found.frequency)
        yield found
    finally:
        found.close()


def until(driver: Driver, condition: Callable[[], bool], seconds: float, what: str) -> float:
    """Wait for a condition; return how long it took, s."""
    waited = 0.0
    while not condition():
        if waited > seconds + driver.slack:
            pytest.fail(f"not within {seconds + driver.slack:g} s: {what}")
        driver.pass_time(POLL_S)
        waited += POLL_S
    return waited


def rest(driver: Driver, seconds: float = 1.0) -> float:
    """Wait until the axis stands still; return its position, m."""
    until(driver, lambda: not driver.moving, seconds, "the axis stands still")
    driver.pass_time(0.05)
    return driver.position


def move(driver: Driver, steps: int) -> float:
    """Run steps to their end; return how far (m) they went."""
    before = driver.position
    driver.step(steps)
    return rest(driver, abs(steps) / driver.frequency) - before


def run(driver: Driver, seconds: float) -> None:
    """Jog upwards until it has gone on for some time."""
    driver.jog(1)
    until(driver, lambda: driver.moving, 0.0, "it moves")
    driver.pass_time(seconds)


def moves_for(driver: Driver, steps: int, due: float) -> float:
    """Run steps that should take so long (s); return how long the axis moved, s."""
    begin = driver.now()
    driver.step(steps)
    # On a busy machine all of it may pass between two looks.
    until(driver, lambda: driver.moving or driver.now() - begin > due, 0.0, "it moves")
    until(driver, lambda: not driver.moving, 1.1 * due, "the steps end")
    return driver.now() - begin


# -- steps


def test_it_stands_still_until_it_is_told_to_move(driver: Driver) -> None:
    before = driver.position
    driver.pass_time(0.2)
    assert not driver.moving
    assert driver.position == pytest.approx(before, abs=driver.tolerance)


def test_steps_go_where_their_sign_says(driver: Driver) -> None:
    assert move(driver, STEPS) > 0.0
    assert move(driver, -STEPS) < 0.0


def test_as_many_steps_run_as_were_told(driver: Driver) -> None:
    together = move(driver, 10)
    alone = sum(move(driver, 1) for _ in range(10))
    assert alone == pytest.approx(together, rel=0.4)
    assert move(driver, 4 * STEPS) == pytest.approx(4 * move(driver, STEPS), rel=0.2)


def test_steps_take_the_time_that_the_frequency_gives_them(driver: Driver) -> None:
    for hertz in (driver.frequency, 0.5 * driver.frequency):
        driver.set_drive(driver.amplitude, hertz)
        steps = round(0.2 * driver.frequency)
        for count in (steps, -steps):
            took = moves_for(driver, count, steps / hertz)
            assert took > 0.9 * steps / hertz, f"{count} steps at {hertz:g} Hz have ended early"


def test_a_smaller_amplitude_makes_smaller_steps(driver: Driver) -> None:
    full = move(driver, STEPS)
    driver.set_drive(0.6 * driver.amplitude, driver.frequency)
    assert 0.0 < move(driver, STEPS) < 0.85 * full


def test_a_new_command_replaces_what_runs(driver: Driver) -> None:
    driver.step(round(20.0 * driver.frequency))
    driver.step(-STEPS)
    turned = driver.position
    assert rest(driver, STEPS / driver.frequency) <= turned + driver.tolerance


# -- jog and stop


def test_a_jog_goes_on_until_it_is_stopped(driver: Driver) -> None:
    for sign in (1, -1):
        before = driver.position
        driver.jog(sign)
        driver.pass_time(0.3)
        assert driver.moving
        driver.stop()
        assert sign * (rest(driver) - before) > 0.0


def test_what_was_stopped_stays_where_it_is(driver: Driver) -> None:
    run(driver, 0.1)
    driver.stop()
    stopped = rest(driver)
    driver.pass_time(0.2)
    assert driver.position == pytest.approx(stopped, abs=driver.tolerance)


def test_a_stop_at_rest_does_nothing(driver: Driver) -> None:
    before = driver.position
    driver.stop()
    assert rest(driver) == pytest.approx(before, abs=driver.tolerance)
    assert move(driver, STEPS) > 0.0


# -- limits


@pytest.mark.parametrize(
    ("amplitude", "frequency"),
    [(math.nan, 1.0), (1e3, 1.0), (-1.0, 1.0), (1.0, math.nan), (1.0, 0.0), (1.0, 1e9)],
    ids=["amplitude=nan", "amplitude=1000x", "amplitude<0", "hertz=nan", "hertz=0", "hertz=1e9x"],
)
def test_an_impossible_drive_is_refused_and_what_runs_goes_on(
    driver: Driver, amplitude: float, frequency: float
) -> None:
    run(driver, 0.05)
    with pytest.raises(ValueError, match=r"."):  # a reason
        driver.set_drive(amplitude * driver.amplitude, frequency * driver.frequency)
    driver.pass_time(0.1)
    assert driver.moving
    driver.stop()
    rest(driver)


def test_a_limit_is_not_passed(driver: Driver) -> None:
    stroke = move(driver, STEPS)
    low, high = driver.position - 2.0 * stroke, driver.position + 2.0 * stroke
    driver.set_limits(low, high)
    driver.jog(1)
    assert rest(driver, 5.0) <= high + driver.tolerance
    with pytest.raises(ValueError, match=r"."):
        driver.move_to(high + stroke)
    assert move(driver, -STEPS) < 0.0


# -- closed loop


def test_the_closed_loop_goes_to_its_target_and_holds_it(driver: Driver) -> None:
    stroke = abs(move(driver, STEPS))
    start = driver.position
    for target in (start + 1.3 * stroke, start - 0.4 * stroke):
        driver.move_to(target)
        until(driver, lambda: driver.at_target, 10.0, "the target is reached")
        assert driver.position == pytest.approx(target, abs=driver.tolerance)
        driver.pass_time(0.3)
        assert driver.at_target
        assert driver.position == pytest.approx(target, abs=driver.tolerance)


def test_steps_end_the_closed_loop(driver: Driver) -> None:
    driver.move_to(driver.position)
    until(driver, lambda: driver.at_target, 10.0, "the target is reached")
    assert move(driver, STEPS) > 0.0
    assert not driver.at_target


# -- faults and diagnostics


def test_a_fault_stops_it_and_holds_until_the_reset(driver: Driver) -> None:
    assert not driver.fault
    driver.provoke_fault()
    until(driver, lambda: driver.fault, 2.0, "the fault")
    before = rest(driver)
    with pytest.raises(ValueError, match=r"."):
        driver.step(STEPS)
    driver.pass_time(0.1)
    assert driver.position == pytest.approx(before, abs=driver.tolerance)
    driver.reset()
    assert not driver.fault
    assert move(driver, STEPS) > 0.0


def test_diagnostics_count_steps(driver: Driver) -> None:
    before = driver.status()["steps"]
    move(driver, STEPS)
    assert driver.status()["steps"] - before == STEPS
    move(driver, -10)
    assert driver.status()["steps"] - before == STEPS - 10


def test_diagnostics_count_refusals(driver: Driver) -> None:
    before = driver.status()["refused"]
    with pytest.raises(ValueError, match=r"."):
        driver.set_drive(100.0 * driver.amplitude, driver.frequency)
    assert driver.status()["refused"] > before
