# SPDX-License-Identifier: Apache-2.0
"""A run sampled over time, and its file."""

from __future__ import annotations

import csv
import io
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from table_1 import table_1

from stickslip_ros.files import WriteError
from stickslip_ros.model import Plant, drive_of, friction_force
from stickslip_ros.model.waveforms import command_of
from stickslip_ros.motion import trace as trace_module
from stickslip_ros.motion.sampling import trace_at_rate, trace_steps
from stickslip_ros.motion.steps import run_steps
from stickslip_ros.motion.trace import Trace, read_csv, save_csv, write_csv
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.solver import CycleResults, Simulation
from stickslip_ros.solver.driven import simulation_of

P = table_1()


@pytest.fixture(scope="module")
def trace() -> Trace:
    return trace_steps(P, 3)


def test_a_trace_is_the_run_it_samples(trace: Trace) -> None:
    """At the end of each cycle stands the position that a run without samples gives."""
    period = drive_of(P).period
    assert (trace.t[0], trace.t[-1]) == (0.0, 3 * period)
    assert (np.diff(trace.t) > 0).all()
    position = run_steps(P, 3).position
    for cycle in (1, 2, 3):
        at = int(np.argmin(np.abs(trace.t - cycle * period)))
        assert trace.x[at] == pytest.approx(position[cycle - 1], abs=1e-14)


def test_the_kinks_of_the_drive_are_sampled(trace: Trace) -> None:
    """So the top of u(t) is really the stroke, and each cycle brings u back to 0."""
    drive_cycle = drive_of(P)
    for cycle in range(3):
        for kink, u in ((0.0, 0.0), (drive_cycle.durations[0], 160e-9)):
            at = int(np.argmin(np.abs(trace.t - cycle * drive_cycle.period - kink)))
            assert trace.t[at] == pytest.approx(cycle * drive_cycle.period + kink, abs=1e-15)
            assert trace.u[at] == pytest.approx(u, abs=1e-18)


def test_the_columns_of_a_trace_agree_with_each_other(trace: Trace) -> None:
    """Velocity is the slope of position, w that against the actuator, F follows from z and w."""
    middle = 0.5 * (trace.v[1:] + trace.v[:-1])
    assert np.cumsum(middle * np.diff(trace.t)) == pytest.approx(trace.x[1:], abs=2e-10)
    drive_cycle = drive_of(P)
    within, slope = trace.t % drive_cycle.period, drive_cycle.rates[0]
    rising = (within > 1e-9) & (within < 0.99 * drive_cycle.durations[0])  # kinks have two slopes
    assert trace.w[rising] == pytest.approx(trace.v[rising] - slope, abs=1e-12)
    contact = Plant.of(P).contact
    expected = [friction_force(z, w, contact) for z, w in zip(trace.z, trace.w, strict=True)]
    assert trace.force == pytest.approx(expected, abs=1e-15)


def test_a_backward_trace_is_the_mirror(trace: Trace) -> None:
    back = trace_steps(P, -3)
    assert np.array_equal(back.t, trace.t)
    for name in ("x", "v", "u", "z", "w", "force"):
        assert np.array_equal(getattr(back, name), -getattr(trace, name))
    assert back.work == pytest.approx(trace.work, abs=1e-18)


def test_the_file_holds_every_digit_below_names_with_units(trace: Trace) -> None:
    text = io.StringIO()
    write_csv(trace, text)
    text.seek(0)
    header, *rows = csv.reader(text)
    assert len(header) == len(fields(trace)) - 1
    assert all(name.endswith((" (s)", "(m)", "(m/s)", "(N)", "(J)")) for name in header)
    numbers = np.array(rows, dtype=float)
    for column, field in enumerate(fields(trace)[:-1]):
        assert np.array_equal(numbers[:, column], getattr(trace, field.name))


def test_a_file_holds_the_deflection_of_each_contact(tmp_path: Path) -> None:
    several = trace_steps({"contacts": 3, "contact_spread": 0.2}, 1)
    save_csv(several, tmp_path / "run.csv")
    again = read_csv(tmp_path / "run.csv")
    assert again.each.shape == (3, len(several.t))
    assert np.array_equal(again.each, several.each) and np.array_equal(again.work, several.work)


@pytest.mark.slow
def test_a_file_is_written_whole_or_not_at_all(
    trace: Trace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failure half way leaves the file of an earlier run, and nothing beside it."""
    path = tmp_path / "run.csv"
    save_csv(trace, path)
    before = path.read_bytes()

    def fail(trace: Trace, file: io.TextIOBase) -> None:
        file.write("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(trace_module, "write_csv", fail)
    with pytest.raises(WriteError, match=r"run\.csv: No space left on device; make room"):
        save_csv(trace, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(WriteError, match="No such file"):
        save_csv(trace, tmp_path / "none" / "run.csv")


def test_a_trace_of_an_earlier_version_is_written_as_it_was_read(
    trace: Trace, tmp_path: Path
) -> None:
    """Earlier versions knew no work; writing such a trace failed over the empty column."""
    path = tmp_path / "old.csv"
    save_csv(replace(trace, work=np.empty(0)), path)
    again = read_csv(path)
    assert len(again.work) == 0
    assert (again.force == trace.force).all()


EFFECTS: list[dict[str, Any]] = [
    {},
    {"frequency": 500.0, "spring": 1e4, "force": 0.01, "model": "lugre"},
    {"actuator_resonance": 5e4, "actuator_damping": 0.05},
    {"actuator": "hysteresis", "actuator_memory": True, "amplifier_bandwidth": 1e5},
    {"contacts": 6, "contact_shares": "guide", "slip_spread": 0.1},
]


def _cycles_of(p: Parameters, steps: int) -> tuple[CycleResults, Simulation]:
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p), steps)
    return simulation.run_cycles(steps), simulation


@pytest.mark.slow
@pytest.mark.parametrize("effects", EFFECTS)
@pytest.mark.parametrize("rate", [0.0, 1e5, 1e7])
def test_the_work_along_a_trace_is_heat_and_what_the_contacts_hold(
    rate: float, effects: dict[str, Any]
) -> None:
    """Whatever the rate; 0 is the trace with all events."""
    p = table_1(**{"frequency": 5e3, **effects})
    trace = trace_at_rate(p, 3, rate) if rate else trace_steps(p, 3)
    if rate:
        assert np.diff(trace.t) == pytest.approx(np.full(len(trace.t) - 1, 1.0 / rate), rel=1e-6)
    cycles, simulation = _cycles_of(p, 3)
    contacts = simulation.plant.contacts or (simulation.plant.contact,)
    held = [
        0.5 * contact.sigma_0 * z * z
        for contact, z in zip(contacts, simulation.deflections, strict=True)
    ]
    assert trace.t[-1] == pytest.approx(3.0 / p.drive.frequency, rel=1e-9)
    assert trace.work[-1] == pytest.approx(cycles.lost.sum() + sum(held), rel=1e-6)


@pytest.mark.parametrize(
    "effects",
    [*EFFECTS, {"frequency": 10.0}, {"frequency": 2e4}, {"frequency": 1e3, "slewrate": 0.7}],
)
def test_a_trace_has_every_extreme_and_every_kink(effects: dict[str, Any]) -> None:
    """So the largest deflection of each cycle is among its samples, whatever the ringing."""
    p = table_1(**{"frequency": 5e3, **effects})
    trace, (cycles, _) = trace_steps(p, 3), _cycles_of(p, 3)
    for cycle in range(3):
        within = (trace.t * p.drive.frequency >= cycle) & (trace.t * p.drive.frequency <= cycle + 1)
        assert trace.z[within].max() == pytest.approx(cycles.z_max[cycle], rel=1e-6, abs=1e-12)
        assert trace.z[within].min() == pytest.approx(cycles.z_min[cycle], rel=1e-6, abs=1e-12)
    # Where the runner turns between two samples, one of them is the turn.
    turns = np.flatnonzero(trace.v[1:] * trace.v[:-1] < 0.0)
    assert np.minimum(np.abs(trace.v[turns]), np.abs(trace.v[turns + 1])).max(initial=0.0) < 1e-6
    # Between two samples the actuator goes along a parabola.
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p), 3)
    begins, spans = trace.t[:-1], np.diff(trace.t)
    times = np.stack([begins + 0.25 * spans, begins + 0.5 * spans], axis=1).ravel()
    quarters, halves = simulation.sample(times).u.reshape(-1, 2).T
    along = (3.0 * trace.u[:-1] + 6.0 * halves - trace.u[1:]) / 8.0
    assert quarters == pytest.approx(along, abs=1e-13)


@pytest.mark.parametrize("rate", [10.0, 1e12, float("nan")])
def test_an_even_trace_has_samples_that_fit_a_file(rate: float) -> None:
    with pytest.raises(ParameterError, match="it may have 1 to 10000000"):
        trace_at_rate(P, 3, rate)
