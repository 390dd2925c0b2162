# SPDX-License-Identifier: Apache-2.0
"""Amplifier, hysteresis with its past, creep and resonance against an integrator of its own."""

import contextlib
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from found import FOUND
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from table_1 import table_1

from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.actuator_chain import Chain
from stickslip_ros.physics.model.waveforms import command_of, drives_of
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.physics.solver import Simulation, SolverError
from stickslip_ros.physics.solver.driven import DrivenSimulation, simulation_of
from stickslip_ros.simulation.sampling import trace_at_rate
from validation.campaigns.drives import EFFECTS as LOTS
from validation.campaigns.drives import GROWTH, check, drives
from validation.whole_system import NoAnswerError, U, WholeSystem, positions

FAST = {"frequency": 5e3}
MEMORY = {"actuator": "hysteresis", "hysteresis": 0.15, "actuator_memory": True}
EFFECTS: dict[str, dict[str, Any]] = {
    "lag": {"amplifier_bandwidth": 2e5},
    "slow lag": {"amplifier_bandwidth": 1e4},
    "current limit": {"amplifier_bandwidth": 5e5, "amplifier_slew": 40.0},
    "resonance of the paper": {"actuator_resonance": 8.2e5, "actuator_damping": 0.5},
    "weak damping": {"actuator_resonance": 1e5, "actuator_damping": 0.05},
    "memory": MEMORY,
    "creep": {"creep": 0.02, "creep_start": 1e-3},
    "all": {
        **MEMORY,
        "creep": 0.02,
        "creep_start": 1e-3,
        "amplifier_bandwidth": 2e5,
        "amplifier_slew": 80.0,
        "actuator_resonance": 2e5,
        "actuator_damping": 0.2,
    },
}


def _run(p: Parameters, cycles: int, rest: float = 0.0, **how: Any) -> np.ndarray:
    simulation = simulation_of(p, Plant.of(p), **how)
    simulation.start(command_of(p), cycles)
    x = simulation.run_cycles(cycles).position
    if rest:
        simulation.advance(simulation.t + rest)
        x = np.append(x, simulation.x)
    return x


@pytest.mark.parametrize("name", [*EFFECTS, *FOUND["rate_counts"]])
def test_each_effect_agrees_with_an_integrator(name: str) -> None:
    """To 0.01 nm a cycle, and after the actuator has come to rest."""
    p = table_1(**{**FAST, **(EFFECTS | FOUND["rate_counts"])[name]})
    x = _run(p, 2, rest=5e-5)
    assert x == pytest.approx(positions(p, 2, rest=5e-5), abs=2e-11)


@pytest.mark.parametrize("waveform", ["triangle", "sawtooth"])
def test_an_output_that_lags_when_a_cycle_ends_lags_in_the_next_one(waveform: str) -> None:
    """With a slew limit alone; the amplifier never runs faster than that, back or forth."""
    p = table_1(frequency=2e3, amplifier_slew=0.3, waveform=waveform)
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p), 4)
    samples = simulation.sample(np.linspace(0.0, 2e-3, 1000))
    assert np.abs(samples.rate).max() == pytest.approx(0.3e6 * p.actuator.gain, rel=1e-9)
    assert _run(p, 4) == pytest.approx(positions(p, 4), abs=4e-11)


def test_a_slew_limit_far_below_the_command_is_kept_and_the_run_ends() -> None:
    """Where the limit sets in, the lag takes less time than a float can tell."""
    values = {"gain": 1.87e-4, "slewrate": 31.2032}
    p = Parameters.of({**values, "amplifier_bandwidth": 25725.06, "amplifier_slew": 1e-6})
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p), 3)
    rates = simulation.sample(np.linspace(0.0, 3.0 / p.drive.frequency, 1000)).rate
    assert np.abs(rates).max() == pytest.approx(1e-6 * 1e6 * p.actuator.gain, rel=1e-9)


def test_a_slip_of_a_picosecond_moves_no_slow_actuator() -> None:
    """What comes in turns within 1e-15 s: that line is rounding, a million times too steep."""
    values = {"amplitude": 0.04, "slewrate": 29369.773, "frequency": 99.0758, "waveform": "hold"}
    p = Parameters.of(
        {**values, "hold_before": 0.11695, "hold_after": 0.17816, "amplifier_bandwidth": 464.929,
         "actuator_resonance": 1.97165, "actuator_damping": 0.0084}
    )  # fmt: skip
    first, again = (simulation_of(p, Plant.of(p), replay=False) for _ in range(2))
    for simulation in (first, again):
        simulation.start(command_of(p), 2)
    assert np.abs(again.sample(first.event_times(0.02)).u).max() < 1e-12


@pytest.mark.parametrize("model", ["ceim", "lugre"])
def test_slow_slips_and_weak_damping_agree_with_finer_lines(model: str) -> None:
    """Over all that the parameters allow, to 0.01 nm a cycle against lines ten times as fine."""
    random, beyond = np.random.default_rng(24), []
    for _ in range(20):
        values = {
            "slewrate": 10.0 * 100.0 ** random.random(),
            "actuator_damping": 0.03 * 30.0 ** random.random(),
            "actuator_resonance": 1e4 * 1e3 ** random.random(),
            "preload": 0.1 * 50.0 ** random.random(),
        }
        frequency = 300.0 * 30.0 ** random.random()
        p = table_1(model=model, frequency=min(frequency, 1.5e3 * values["slewrate"]), **values)
        simulations = [
            DrivenSimulation(Plant.of(p), p.solver.tolerance, chain)
            for chain in (Chain.of(p), Chain.of(p)._replace(error=5e-14, mean_only_rate=math.inf))
        ]
        for simulation in simulations:
            simulation.start(command_of(p), 3)
        x, finer = (simulation.run_cycles(3).position for simulation in simulations)
        beyond += [values] * bool((np.abs(x - finer) > 1e-11 * np.arange(1, 4)).any())
    assert not beyond


def test_lines_are_finer_where_a_resonance_makes_the_runner_fast() -> None:
    """Driven at half its resonance, the actuator goes much farther than it is commanded to.

    The speed that the runner gets to was taken from the command: 0.5 nm a step were wrong.
    """
    p = table_1(
        frequency=5e3, actuator_resonance=1e4, actuator_damping=0.01, mass=1e-3, preload=2.0
    )
    found = []
    for chain in (Chain.of(p), Chain.of(p)._replace(mean_only_rate=math.inf)):
        simulation = DrivenSimulation(Plant.of(p), p.solver.tolerance, chain)
        simulation.start(command_of(p), 40)
        speeds = np.abs(simulation.sample(np.linspace(0.0, 0.004, 20_001)).v)
        assert speeds.max() > Chain.of(p).mean_only_rate
        found.append(simulation.run_cycles(20).position)
    assert np.diff(found[0]) == pytest.approx(np.diff(found[1]), abs=3e-11)


def test_creep_does_not_drift_off() -> None:
    """Over many cycles the deflection is the command with the exponentials of its past."""
    p = table_1(frequency=500.0, creep=0.1, creep_start=10.0)
    simulation, command = simulation_of(p, Plant.of(p)), command_of(p)
    simulation.start(command, 100)
    u = simulation.sample(np.arange(1.0, 101.0) * command.period).u
    taus = 10.0 * np.exp(0.5772156649) * 10.0 ** (np.arange(16) / 2.0 + 0.25)
    creep, expected = np.zeros(16), []
    for _ in range(100):
        q = 0.0
        for span, rate in zip(command.durations, command.rates, strict=True):
            gone = -np.expm1(-span / taus)
            # The mean of q over the span, for creep is slow beside it.
            creep += (q + 0.5 * rate * span - creep) * gone
            q += rate * span
        expected.append(0.05 * creep.sum())
    assert u == pytest.approx(expected, abs=1e-14)


def test_other_waveforms_go_through_it_as_well(tmp_path: Path) -> None:
    """A slip in two parts, and a table of one's own."""
    table = tmp_path / "own.csv"
    table.write_text("0, 0\n0.6, 1\n0.8, 0.9\n0.81, 0\n1, 0\n")
    effects = {**EFFECTS["all"], "surface_spread": 0.2, "slip_spread": 0.1, "dwell_growth": 0.1}
    for waveform in (
        {"waveform": "shaped", "split": 0.8, "latency": 2e-5},
        {"waveform": "table", "waveform_table": str(table)},
    ):
        p = table_1(**FAST, **effects, **waveform)
        assert _run(p, 2) == pytest.approx(positions(p, 2), abs=2e-11)


@pytest.mark.parametrize("name", FOUND["driven"])
def test_a_drive_that_a_lot_found_agrees(name: str) -> None:
    """To 0.01 nm a cycle.

    A bend of 1e-15 s and 0.15 nm at the end of a hold; lines beside their curve, which turned a
    contact that yields at once, or that it felt as it slides from 51 pm on; a second of sliding in
    steps each off as in a millisecond; lines as long as a ringing of 600 Hz, which it adds up;
    rates that jump by four Stribeck velocities, or with another mean than the curve.
    """
    outcome = check(table_1(**FOUND["driven"][name]))
    assert outcome.off < 0.01
    assert outcome.growth < GROWTH


#: So many drives of each effect; radians of the fastest pole in the cycles of one
COUNT, RADIANS = int(os.environ.get("STICKSLIP_DRIVES", "1")), 2e4


@pytest.mark.parametrize("effect", [*LOTS, "all"])
@pytest.mark.parametrize("real", [True, pytest.param(False, marks=pytest.mark.long)])
def test_random_drives_agree_with_an_integrator(effect: str, real: bool) -> None:
    """To 0.01 nm a cycle, over all of the parameters' ranges; STICKSLIP_DRIVES=20 runs 20."""
    judged = 0
    for p in drives(effect, 7, real, RADIANS):
        with contextlib.suppress(NoAnswerError):  # the integrator gave up: the next drive
            outcome = check(p)
            assert outcome.off < 0.01 or outcome.growth > GROWTH, p
            judged += 1
        if judged == COUNT:
            break


@pytest.mark.parametrize(
    "nearly",
    [
        {"amplifier_bandwidth": 1e12},
        {"amplifier_slew": 1e6},
        {"actuator_resonance": 1e12, "actuator_damping": 0.7},
        {"creep": 1e-12},
        {**MEMORY, "hysteresis": 0.0},
    ],
)
def test_in_the_limit_there_is_the_plain_model(nearly: dict[str, Any]) -> None:
    """To 1e-4 nm a cycle."""
    p = table_1(**nearly)
    plain = table_1()
    simulation = Simulation(Plant.of(plain), plain.solver.tolerance)
    simulation.start(drive_of(plain), 10)
    x = _run(p, 10)
    assert x == pytest.approx(simulation.run_cycles(10).position, abs=1e-12)


def test_without_effects_there_is_the_plain_simulation() -> None:
    p = table_1()
    assert type(simulation_of(p, Plant.of(p))) is Simulation
    assert (command_of(p).rates == drive_of(p).rates).all()


def test_the_virgin_cycle_differs_from_the_settled_loop() -> None:
    """The later cycles run the loop to which `drive_of` goes at once."""
    p = table_1(**MEMORY)
    first, settled = _run(p, 12), _run(p.replace(actuator_memory=False), 12)
    assert type(simulation_of(p, Plant.of(p))) is DrivenSimulation
    assert abs(first[0] - settled[0]) > 5e-9
    assert np.diff(first)[4:] == pytest.approx(np.diff(settled)[4:], abs=1e-12)


def test_creep_is_the_logarithm_of_time() -> None:
    """After a jump of the command, u = q (1 + gamma log10(t / t0))."""
    p = table_1(creep=0.02, creep_start=0.1)
    simulation = simulation_of(p, Plant.of(p))
    step = drive_of(p.replace(creep=0.0))
    rise = type(step)(np.array([1e-4]), np.array([1e-3]), slip=-1, sign=1, slip_parts=0)
    simulation.start(rise, 1)
    t = 0.1 * 10.0 ** np.arange(1.0, 6.01, 0.5)
    u = simulation.sample(t).u
    assert u == pytest.approx(1e-7 * (1.0 + 0.02 * np.log10(t / 0.1)), abs=0.003 * 0.02 * 1e-7)


def test_cycles_that_are_looked_at_are_the_same() -> None:
    p = table_1(**EFFECTS["all"], frequency=2e3, surface_spread=0.2, surface_length=1e-6)
    often, seldom = (simulation_of(p, Plant.of(p)) for _ in range(2))
    for simulation in (often, seldom):
        simulation.start(command_of(p), 5)
    times = np.linspace(0.0, 4e-3, 1777)
    samples = often.sample(times)
    seldom.advance(4e-3)
    assert often.state == seldom.state
    assert samples.x[-1] == seldom.x
    assert often.cycles_done == seldom.cycles_done == 5


def test_a_run_in_parts_is_the_run_at_once() -> None:
    """Cycles one by one, with looks in the middle of them, end where they do in one go."""
    p = table_1(**EFFECTS["all"], frequency=2e3)
    parts = simulation_of(p, Plant.of(p))
    parts.start(command_of(p), 6)
    found = []
    for k in range(6):
        parts.advance((k + 0.37) / 2000.0)
        assert parts.end_of_cycle == pytest.approx((k + 1) / 2000.0, abs=1e-15)
        found.append(float(parts.run_cycles(1).position[0]))
        assert (parts.cycles_done, parts.cycles_left) == (k + 1, 5 - k)
        assert parts.t == pytest.approx((k + 1) / 2000.0, abs=1e-15)
        assert parts.end_of_move == pytest.approx(6 / 2000.0, abs=1e-15)
    assert found == _run(p, 6).tolist()


def test_moves_that_follow_each_other_at_once_are_one_move() -> None:
    """The actuator was 34 nm off after the fourth, and 1.5 um after the fifth."""
    p = table_1(amplifier_bandwidth=2332.0, frequency=11424.0, slewrate=900.0, amplitude=77.0)
    moves = simulation_of(p, Plant.of(p))
    for _ in range(5):
        moves.start(command_of(p), 900)
        moves.run_cycles(900)
    once = simulation_of(p, Plant.of(p))
    once.start(command_of(p), 4500)
    once.run_cycles(4500)
    assert moves.state.u == pytest.approx(once.state.u, abs=1e-12)
    assert moves.x == pytest.approx(once.x, abs=4500 * 1e-13)


def test_a_stop_in_the_middle_of_a_cycle_goes_on_from_there() -> None:
    """The command stays where it was; the actuator comes to rest at it."""
    p = table_1(amplifier_bandwidth=1e3, actuator_resonance=1e5)
    simulation = simulation_of(p, Plant.of(p))
    simulation.start(command_of(p), 3)
    simulation.advance(0.015)
    commanded, step = simulation.commanded, simulation.last_step
    assert commanded == pytest.approx(80e-9, rel=1e-3)
    assert simulation.state.u < commanded - 1e-9
    simulation.start(command_of(p), 0)
    simulation.advance(0.03)
    assert simulation.last_step == step
    assert simulation.commanded == commanded
    assert simulation.state.u == pytest.approx(commanded, abs=1e-14)
    assert simulation.state.rate == 0.0


@given(
    name=st.sampled_from([*LOTS, "all"]),
    seed=st.integers(0, 10**6),
    load=st.floats(-0.05, 0.05).map(lambda force: round(force, 12)),
    ageing=st.sampled_from(
        [
            {},
            {"surface_spread": 0.3, "slip_spread": 0.1},
            {"dwell_growth": 0.1, "dwell_start": 1e-5},
        ]
    ),
)
@settings(max_examples=40, deadline=None)
def test_the_contact_never_creates_energy(
    name: str, seed: int, load: float, ageing: dict[str, float]
) -> None:
    """Over each cycle, of any drive with any effect, it turns work into heat.

    But for a friction that falls with the rate: then z may be larger than what sliding holds, and
    its damping sigma_1 z' gives back more than it takes (docs/friction.md).
    """
    p = next(drives(name, seed, True, RADIANS)).replace(force=load, **ageing)
    contact = Plant.column(p).contact
    assume(contact.z_s <= contact.z_k)
    simulation = simulation_of(p, Plant.of(p))
    before = simulation.state
    try:
        simulation.start(command_of(p), 6)
        found = simulation.run_cycles(6)
    except SolverError:  # more lines than it may take: refused, and no matter of energy
        assume(False)
    assert (found.lost >= -1e-9 * found.lost.max()).all()
    assert before.z == 0.0


def test_settled_cycles_are_replayed() -> None:
    p = table_1(**FAST, **EFFECTS["weak damping"])
    replayed, solved = _run(p, 300), _run(p, 300, replay=False)
    assert replayed == pytest.approx(solved, abs=1e-11)


def test_a_sweep_over_the_amplifier_is_each_of_its_drives() -> None:
    """Without a lag for the first point."""
    bandwidths = (0.0, 5e4, 2e5)
    column = Parameters().replace(amplifier_bandwidth=np.array(bandwidths))
    drive_cycles, possible = drives_of(column, 3, 1)
    assert possible.all()
    for k, bandwidth in enumerate(bandwidths):
        one = drive_of(Parameters.of({"amplifier_bandwidth": bandwidth}))
        assert (drive_cycles.row(k).rates == one.rates).all()
    assert len(drive_cycles.row(0).rates) == 2 < len(drive_cycles.row(1).rates)


def test_sweeps_run_the_settled_cycle_with_lag_and_resonance() -> None:
    p = table_1(**EFFECTS["current limit"], frequency=500.0)
    simulation = Simulation(Plant.of(p), p.solver.tolerance)
    simulation.start(drive_of(p), 12)
    settled = np.diff(simulation.run_cycles(12).position)[6:]
    assert settled == pytest.approx(np.diff(_run(p, 12))[6:], abs=1e-11)


def test_the_command_is_that_of_a_rigid_drive() -> None:
    """It is known without the chain behind it, so also when the chain needs too many lines."""
    effects = {"amplifier_bandwidth": 2e5, "creep": 0.02, "actuator_resonance": 8e5}
    rigid, driven = (simulation_of(p, Plant.of(p)) for p in (table_1(), table_1(**effects)))
    for simulation in (rigid, driven):
        simulation.start(command_of(table_1()), 3)
    for t in (0.0, 0.004, 0.0099, 0.010001, 0.0253, 0.029999, 0.05):
        rigid.advance(t)
        driven.advance(t)
        assert driven.commanded == pytest.approx(rigid.commanded, abs=1e-20), t


@pytest.mark.parametrize("spring", [0.0, 1e5])
def test_at_a_stop_and_with_a_spring_bent_pieces_count_as_fine_ones(spring: float) -> None:
    """There straight lines take the place of bent pieces; so do they, however short these are."""
    values = {"actuator_resonance": 1e5, "actuator_damping": 0.1, "spring": spring}
    p = table_1(frequency=5e3, **values)
    found = []
    for part in (1.0, 1e-3):
        chain = Chain.of(p)._replace(error=part * Chain.of(p).error, mean_only_rate=math.inf)
        simulation = DrivenSimulation(Plant.of(p), p.solver.tolerance, chain)
        simulation.set_stops(-1e-7, 2.5e-7)
        simulation.start(command_of(p), 6)
        cycles = simulation.run_cycles(6)
        assert spring or simulation.stop_hits
        found.append(np.concatenate([cycles.position, 1e-2 * cycles.lost / cycles.lost[-1]]))
    assert found[0][:6] == pytest.approx(found[1][:6], abs=3e-11)
    assert found[0][6:] == pytest.approx(found[1][6:], rel=1e-3)


@pytest.mark.parametrize("name", ["weak damping", "lag", "all"])
def test_pieces_lie_within_three_times_their_error_of_the_curve(name: str) -> None:
    """Against pieces ten times shorter, none longer for a fast actuator; straight ones add 1.5."""
    p = table_1(**{**FAST, **EFFECTS[name]})
    drives = []
    for part in (1.0, 1e-3):
        chain = Chain.of(p)._replace(error=part * Chain.of(p).error, mean_only_rate=math.inf)
        simulation = DrivenSimulation(Plant.of(p), p.solver.tolerance, chain)
        simulation.start(command_of(p), 1)
        drives.append(simulation.sample(np.linspace(0.0, 2e-4, 2001)).u)
    assert np.abs(drives[0] - drives[1]).max() < 3.0 * Chain.of(p).error


@pytest.mark.parametrize("sigma_0", [0.0, 1.0, 1e4])
def test_behind_an_actuator_of_20_ghz_the_runner_moves_as_behind_a_rigid_one(
    sigma_0: float,
) -> None:
    """Its pieces are so short that the runner's load -m u'' bends a soft contact by kilometres."""
    found = []
    for resonance in (0.0, 2e10):
        p = table_1(sigma_0=sigma_0, actuator_resonance=resonance)
        simulation = simulation_of(p, Plant.of(p))
        simulation.start(command_of(p), 3)
        found.append(simulation.run_cycles(3))
    rigid, driven = found
    assert driven.position == pytest.approx(rigid.position, abs=3e-12)
    assert driven.lost == pytest.approx(rigid.lost, rel=1e-4)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_settled_hysteresis_runs_the_same_loop_with_a_lag_and_without(sign: int) -> None:
    """The virgin curve of the first rise was 20 nm away; a lag of 1 ns alone moves 0.04 nm."""
    known = {"preload": 0.5, "mass": 5e-3, "frequency": 400.0}
    loop = {"actuator": "hysteresis", "hysteresis": 0.15}
    quick = {"amplifier_bandwidth": 1e9 / (2.0 * math.pi)}
    t = np.linspace(0.0, 0.06, 3001)

    def moved(settled: bool, **more: Any) -> Any:
        p = Parameters.of({**known, **more})
        simulation = simulation_of(p, Plant.of(p), settled=settled)
        simulation.start(command_of(p, sign), 8)
        first = simulation.sample(t[:1500]).x
        simulation.advance(0.03)
        simulation.start(command_of(p, sign), 4)
        return np.append(first, simulation.sample(np.maximum(t[1500:], 0.03)).x)

    without, lagging = moved(True, **loop), moved(True, **loop, **quick)
    linear = np.abs(moved(True, **quick) - moved(True)).max()
    assert np.abs(lagging - without).max() < 1.2 * linear < 6e-11
    assert np.abs(moved(False, **loop, **quick) - without).max() > 5e-9
    assert np.abs(moved(True, **loop, **quick, creep=0.01) - lagging).max() < 2e-10


@pytest.mark.parametrize(
    "effects",
    [{"amplifier_bandwidth": 1e5}, {"actuator_resonance": 2e4}, {"creep": 0.02}],
)
def test_a_smaller_tolerance_holds_behind_effects(effects: dict[str, Any]) -> None:
    """It had no effect there, and the deflection in a trace was 0.2 nm off within slips."""
    p = table_1(frequency=1000.0, tolerance=1e-13, **effects)
    trace, system = trace_at_rate(p, 1, 77777.0), WholeSystem(p)
    command = command_of(p)
    ends, now, k = np.cumsum(command.durations), 0.0, 0
    slopes = command.rates / p.actuator.gain
    for t, x, u in zip(trace.t, trace.x, trace.u, strict=True):
        while k < len(ends) and ends[k] <= t:
            system.segment(ends[k] - now, slopes[k])
            now, k = ends[k], k + 1
        if t > now:
            system.segment(t - now, slopes[k])
            now = t
        assert (x, u) == pytest.approx((system.x, 1e-9 * system.y[U]), abs=1e-13)
