# SPDX-License-Identifier: Apache-2.0
"""The benchmark compares like with like, and its judge is right. No test here looks at a time."""

import importlib
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from table_1 import table_1

from stickslip_ros.model import Plant, drive_of, friction_force, z_rate
from validation.benchmark import (
    CASES,
    LIMIT,
    METHODS,
    OURS,
    Case,
    CaseResult,
    Effort,
    MissingPeer,
    as_json,
    load,
    measure,
    methods,
    plot,
    reference,
    summary,
    table,
    work,
)
from validation.benchmark.cases import FINEST, Problem, Scaled, rates
from validation.benchmark.measuring import Measured, Point
from validation.benchmark.methods import DEFAULT_TOLERANCE, Method

FAST = next(case for case in CASES if case.name == "0.4N-18500Hz")
SLOW = next(case for case in CASES if case.name == "0.4N-1000Hz")
#: One setting for each method that is fine enough to be within the limit on every case.
FINE = {OURS: DEFAULT_TOLERANCE}
FINE_PEER = 1e-7


@pytest.fixture(scope="module")
def fast() -> Problem:
    """The fast case, three cycles of it."""
    return FAST.problem(3)


@pytest.fixture(scope="module")
def slow() -> Problem:
    """The slow case, in which the slip is 3 us of 1 ms."""
    return SLOW.problem(2)


def ready(name: str) -> Method:
    """The method, or a skipped test where it is not installed."""
    try:
        return METHODS[name].load()
    except MissingPeer as missing:
        pytest.skip(str(missing))


def test_the_cases_are_those_of_the_comparison() -> None:
    points = {(case.preload, case.mass, case.frequency) for case in CASES}
    hertz = (100.0, 1e3, 10e3, 18.5e3, 100e3)
    assert points == {(f, m, h) for f, m in ((0.4, 4e-3), (1.0, 3e-3)) for h in hertz}
    assert len({case.name for case in CASES}) == len(CASES)


def test_the_equations_are_those_of_the_model() -> None:
    p = table_1(force=0.01, sigma_2=0.3)
    plant = Plant.of(p)
    scaled, contact = Scaled.of(plant, drive_of(p)), plant.contact
    speed = scaled.length / scaled.time
    depths = (-70e-9, -45e-9, -20e-9, 0.0, 17e-9, 25e-9, 50e-9)
    for w, z in itertools.product((-2e-2, -1e-4, 0.0, 3e-3), depths):
        dw, dz, slide = rates(w / speed, z / scaled.length, *scaled.constants)
        acceleration = (plant.force - friction_force(z, w, contact)) / plant.mass
        assert dw * speed / scaled.time == pytest.approx(acceleration, rel=1e-12)
        assert dz * speed == pytest.approx(z_rate(z, w, contact), rel=1e-12, abs=1e-18)
        assert slide * speed == pytest.approx(w - z_rate(z, w, contact), rel=1e-9, abs=1e-17)


@pytest.mark.parametrize("changed", [{"spring": 1e5}, {"model": "lugre"}])
def test_a_plant_that_the_equations_do_not_describe_is_refused(changed: dict[str, Any]) -> None:
    p = table_1(**changed)
    with pytest.raises(ValueError, match="no spring"):
        Scaled.of(Plant.of(p), drive_of(p))


def test_a_jump_of_w_is_a_kink_of_u(fast: Problem) -> None:
    """Over a cycle the jumps cancel, and the first one undoes the slip."""
    scaled, drive_cycle = fast.scaled, fast.drive_cycle
    assert math.isclose(scaled.jumps.sum(), 0.0, abs_tol=1e-9)
    speed = scaled.length / scaled.time
    assert scaled.jumps[0] * speed == pytest.approx(drive_cycle.rates[-1] - drive_cycle.rates[0])
    assert scaled.durations.sum() * scaled.time == pytest.approx(drive_cycle.period)


@pytest.mark.parametrize("case", [FAST, SLOW, CASES[-1]], ids=lambda case: case.name)
def test_the_reference_is_converged_and_agrees_with_the_kernel(case: Case) -> None:
    """A hundred times better than what it judges, and so is the kernel at its finest."""
    problem = case.problem(2)
    ours = METHODS[OURS].load()
    for cycle, count in ((0, 1), (1, 1), (0, 2)):
        true = reference.displacement(problem, cycle, count)
        assert abs(reference.displacement(problem, cycle, count, 0.5) - true) < LIMIT / 100
        assert abs(ours.prepare(problem, FINEST, cycle, count)() - true) < LIMIT / 100


@pytest.mark.parametrize("name", METHODS)
def test_every_method_reproduces_the_reference(name: str, fast: Problem) -> None:
    one = ready(name)
    setting = FINE.get(name, FINE_PEER)
    for cycle, count in ((0, 1), (2, 1), (0, 3)):
        found = one.prepare(fast, setting, cycle, count)()
        assert abs(found - reference.displacement(fast, cycle, count)) < LIMIT * count


@pytest.mark.parametrize("name", METHODS)
def test_no_method_falls_into_the_trap_of_the_kinks(name: str, slow: Problem) -> None:
    """Even at its loosest setting a method sees every slip."""
    one = ready(name)
    true = reference.displacement(slow, 0, 2)
    loosest = one.prepare(slow, one.settings[0], 0, 2)()
    assert abs(loosest - true) < 0.2 * abs(true)


def test_the_trap_is_there(slow: Problem) -> None:
    """A solver that is led across the kinks misses slips; that would have been noticed above."""
    scaled, plant, drive_cycle = slow.scaled, slow.plant, slow.drive_cycle
    speed = scaled.length / scaled.time
    rise = float(scaled.durations[0])
    period = float(scaled.durations.sum())
    rate = drive_cycle.rates / speed

    def slope(t: float, y: NDArray[np.float64]) -> Sequence[float]:
        now = rate[0] if t % period < rise else rate[1]
        dw, dz, _ = rates(y[1] - now, y[2], *scaled.constants)
        return (y[1], dw, dz)

    assert plant.spring == 0.0
    true = reference.displacement(slow, 0, 2)
    begin = slow.starts[0]
    y0 = [0.0, begin.v / speed, begin.z / scaled.length]

    def error(method: str, tolerance: float) -> float:
        options = {"method": method, "rtol": tolerance, "atol": tolerance}
        found = solve_ivp(slope, (0.0, 2 * period), y0, **options)
        assert found.success  # it does not even notice
        return abs(float(found.y[0, -1]) * scaled.length - true)

    # Which of them falls into it depends on the last digits of where it starts.
    tried = itertools.product(("RK45", "DOP853", "LSODA"), (1e-3, 1e-4, 1e-5))
    assert any(error(*one) > 0.2 * abs(true) for one in tried)


def test_no_cycle_of_ours_is_replayed(slow: Problem) -> None:
    simulation = slow.simulation(0)
    assert simulation._s["replay"] == 0


def test_starting_states_are_not_used_up(fast: Problem) -> None:
    ours = METHODS[OURS].load()
    first = ours.prepare(fast, DEFAULT_TOLERANCE, 0, 2)()
    assert ours.prepare(fast, DEFAULT_TOLERANCE, 0, 2)() == first


@pytest.mark.parametrize("module", ["CyRK", "scijit.integrate", "sksundae.cvode"])
@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ModuleNotFoundError("No module named 'x'"), "not installed: pip install "),
        (ImportError("needs AVX2\nand more"), "does not load: needs AVX2"),
        (OSError("no Fortran library"), "does not load: no Fortran library"),
    ],
)
def test_a_missing_peer_is_said_to_be_missing(
    module: str, error: Exception, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    normal = importlib.import_module

    def without(name: str) -> Any:
        if name == module:
            raise error
        return normal(name)

    monkeypatch.setattr(importlib, "import_module", without)
    peers = {"CyRK": "cyrk-lsoda", "scijit.integrate": "scijit-lsoda"}
    name = peers.get(module, "sundae-cvode")
    methods, missing = load([OURS, name], lambda _: None)
    assert list(methods) == [OURS]
    assert said in missing[name]
    assert "\n" not in missing[name]


class Clock:
    """Stands in for a clock: every look at it takes a second."""

    def __init__(self) -> None:
        """Start at zero."""
        self._ticks = itertools.count()

    def __call__(self) -> float:
        """Return the time, s."""
        return float(next(self._ticks))


class Sloppy:
    """A made-up peer: off by its setting, in nm per cycle, and lost at the first."""

    settings = (math.nan, 1e-1, 1e-3, 1e-2, 1e-4)

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> methods.Run:
        """Return the truth with an error."""
        return lambda: reference.displacement(problem, cycle, count) + 1e-8 * setting * count


@pytest.fixture(scope="module")
def result() -> CaseResult:
    """A case with our kernel, a made-up peer and a missing one, under a clock of our own."""
    effort = Effort(cycles=2, repeats=5, quoted=1.0, plotted=1.0)
    methods: dict[str, Method] = {OURS: METHODS[OURS].load(), "scipy-lsoda": Sloppy()}
    done = 0

    def progress(steps: int) -> None:
        nonlocal done
        done += steps

    missing = {"cyrk-lsoda": "not installed: pip install cyrk"}
    found = measure(FAST, methods, missing, effort, Clock(), progress)
    assert done + len(methods) + len(missing) == work(1, 3, effort)  # `load` reports the rest
    return found


def test_errors_and_repeats_are_measured(result: CaseResult) -> None:
    sloppy = result.measured["scipy-lsoda"].points
    assert math.isinf(sloppy[0].error)
    assert sloppy[0].times == []
    for point in sloppy[1:]:
        assert point.error == pytest.approx(1e-8 * point.setting, rel=1e-3)
        assert len(point.times) == 5
    assert result.gap < LIMIT / 100
    assert result.reference_gap < LIMIT / 100


def test_ours_is_quoted_at_its_default_tolerance(result: CaseResult) -> None:
    quoted = result.measured[OURS].quoted
    assert quoted is not None
    assert quoted.setting == DEFAULT_TOLERANCE
    assert quoted.error <= LIMIT


def test_a_peer_is_quoted_at_its_fastest_setting_within_the_limit() -> None:
    def point(error: float, time: float) -> Point:
        return Point(setting=error, error=error, cycles=1, times=[time, 2 * time, time / 2])

    lucky, wrong, slow, fast = (
        point(0.9 * LIMIT, 1.0),
        point(2 * LIMIT, 2.0),
        point(0.5 * LIMIT, 4.0),
        point(0.2 * LIMIT, 3.0),
    )
    one = Measured("scipy-lsoda", [lucky, wrong, slow, fast])
    assert one.quoted is lucky
    assert one.quoted.median == 1.0
    assert one.dependable is fast
    assert Measured("scipy-lsoda", [wrong]).quoted is None
    assert Measured("scipy-lsoda", [wrong]).dependable is None


def test_the_table_names_everything_that_was_asked_for(result: CaseResult) -> None:
    text = table(result)
    assert FAST.title in text
    assert "stickslip_ros" in text
    assert "SciPy LSODA" in text
    assert "missing: not installed: pip install cyrk" in text
    assert f"{DEFAULT_TOLERANCE:.0e}" in text
    last = summary([result])
    assert "fastest peer" in last
    assert FAST.title in last


def test_the_json_holds_every_number(result: CaseResult) -> None:
    found = as_json([result])
    assert found["limit"] == LIMIT
    (case,) = found["cases"]
    assert case["frequency"] == FAST.frequency
    assert case["fastest_peer"] == "scipy-lsoda"
    ratio = case["scipy_lsoda_by_ours"]
    assert ratio == case["fastest_peer_by_ours"]
    methods = {one["name"]: one for one in case["methods"]}
    assert set(methods) == {OURS, "scipy-lsoda", "cyrk-lsoda"}
    assert methods["cyrk-lsoda"]["missing"]
    assert methods["cyrk-lsoda"]["quoted"] is None
    ours = methods[OURS]["quoted"]
    peer = methods["scipy-lsoda"]["quoted"]
    assert ratio == pytest.approx(peer["time_per_cycle"] / ours["time_per_cycle"])
    for point in (ours, peer):
        assert point["fastest"] <= point["time_per_cycle"] <= point["slowest"]
        assert point["real_time_factor"] * point["time_per_cycle"] * FAST.frequency == (
            pytest.approx(1.0)
        )
    assert methods["scipy-lsoda"]["points"][0]["error"] is None  # lost: no number, and no Infinity


def test_the_plot_is_written(result: CaseResult, tmp_path: Path) -> None:
    path = tmp_path / "speed.png"
    plot(path, [result])
    assert path.read_bytes().startswith(b"\x89PNG")
