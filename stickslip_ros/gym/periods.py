# SPDX-License-Identifier: Apache-2.0
"""One period of many axes at once: an action becomes a piece of drive, which the kernel runs.

A period is a drive cycle, or a sample of the controller. Each axis has its own row in every array
and is advanced alone, so its bits do not depend on how many others there are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compiled import compiled
from stickslip_ros.model.actuator_chain import CAPACITY, Chain
from stickslip_ros.model.actuator_stages import lay_pieces
from stickslip_ros.solver.advance import ENDLESS, PER_CYCLE
from stickslip_ros.solver.event_loop import solve_cycles
from stickslip_ros.solver.layout import ROW_SIZE, contacts_in, kernel_in, plant_in
from stickslip_ros.solver.plants import begin_cycles

#: Time (s) that the fast part of a period takes at least: a segment needs some, also one at rest
SHORTEST = 1e-9
#: Above this share of the speed that the pieces of an actuator were laid for they get finer, as in
#: `solver.driven`
NEARLY_AS_FAST = 0.7
#: The bits of a scrambled number
_BITS = 2**32 - 1
#: Positions of the numbers in an action of a drive cycle
AMPLITUDE, PLACE, FREQUENCY, SLEWRATE = range(4)


class Buffers(NamedTuple):
    """Memory of the kernel, one row an axis."""

    plants: NDArray[np.float64]  #: (axes, PLANT_SIZE)
    axes: NDArray[np.float64]  #: (axes, KERNEL_SIZE)
    contacts: NDArray[np.float64] | None  #: (axes, buffer of several contacts), see `layout`
    sampled: NDArray[np.float64]  #: positions at the last readings, m, (axes, delay + 1)
    actuators: NDArray[np.float64]  #: states of the chain, (axes, places); without one no places
    limits: NDArray[np.float64]  #: of pieces, (axes, 3), see `actuator_chain.limits_of_pieces`


class States(NamedTuple):
    """What is known of each axis after its last period; arrays of shape (axes,)."""

    t: NDArray[np.float64]  #: s
    level: NDArray[np.float64]  #: voltage, V
    x: NDArray[np.float64]  #: position of the runner, m
    v: NDArray[np.float64]  #: its velocity, m/s
    vibration: NDArray[np.float64]  #: amplitude of the free oscillation on the contact, m
    lost: NDArray[np.float64]  #: heat of the contact in the period, J
    slid: NDArray[np.float64]  #: distance that the contact slid in the period, m
    reading: NDArray[np.float64]  #: of the sensor that has arrived last, m
    failed: NDArray[np.int64]  #: 1 if the solver exceeded its budget or failed


class ActionScale(NamedTuple):
    """How actions become voltages; numbers of an action lie within -1 and 1."""

    sample: float  #: s, duration of a sample; 0: periods are drive cycles
    low: float  #: lowest and highest voltage, V
    high: float
    gain: float  #: m/V
    frequency: tuple[float, float]  #: lowest and highest, Hz
    slewrate: tuple[float, float]  #: likewise, V/s


class Sensing(NamedTuple):
    """The sensor, as `axis.sensor` describes it; arrays of shape (axes,)."""

    rate: float  #: Hz
    delay: int  #: age of a reading when it arrives, in readings
    resolution: float  #: m; 0: no rounding
    noise: NDArray[np.float64]  #: standard deviation of a reading, m
    drift: NDArray[np.float64]  #: m/s
    seed: NDArray[np.int64]


@compiled
def between(share: float, ends: tuple[float, float]) -> float:
    """Return the value at a share, -1 to 1, of the way between ends, even in the logarithm."""
    return ends[0] * math.exp(0.5 * (share + 1.0) * math.log(ends[1] / ends[0]))


@compiled
def lay_period(
    action: NDArray, level: float, drive: ActionScale, lines: NDArray
) -> tuple[float, int]:
    """Write the two lines of u, durations (s) and rates (m/s), into lines, (2, 2).

    The voltage sets out from level (V). Returns where it ends (V) and the direction of the step,
    0 without a slip.
    """
    span = drive.high - drive.low
    if drive.sample > 0.0:
        first = end = drive.low + 0.5 * (action[0] + 1.0) * span
        lines[0, 0] = max(abs(end - level) / drive.slewrate[1], SHORTEST)
        lines[0, 1] = drive.sample - lines[0, 0]
        sign = 0
    else:
        share = action[AMPLITUDE]
        fall = abs(share) * span
        end = drive.low + 0.5 * (action[PLACE] + 1.0) * (span - fall)
        first = end + fall
        if share < 0.0:
            first, end = end, first
        frequency = between(action[FREQUENCY], drive.frequency)
        slewrate = between(action[SLEWRATE], drive.slewrate)
        lines[0, 1] = max(fall / slewrate, SHORTEST)
        lines[0, 0] = 1.0 / frequency - lines[0, 1]
        sign = 0 if fall == 0.0 else (1 if share > 0.0 else -1)
    lines[1, 0] = drive.gain * (first - level) / lines[0, 0]
    lines[1, 1] = drive.gain * (end - first) / lines[0, 1]
    return end, sign


@compiled
def own_contacts(contacts: NDArray | None, k: int) -> NDArray | None:
    """Return the buffer of several contacts of one axis, None for a single contact."""
    if contacts is None:
        return None
    return contacts[k]


@compiled
def lay_drive(
    chain: Chain | None, now: tuple[NDArray, NDArray, float], lines: NDArray, sign: int
) -> tuple[NDArray, float, int, int]:
    """Return the pieces of u that two lines of the command come to, their shift (m), those of slip.

    now are state and limits of the chain, and u (m). The shift is nan where a chain takes too many
    pieces.
    """
    slip, slip_end = (1, 2) if sign != 0 else (-1, -1)
    if chain is None:
        return lines, lines[0, 0] * lines[1, 0] + lines[0, 1] * lines[1, 1], slip, slip_end
    state, limits, u = now
    own = Chain(
        chain.lag, chain.slew, chain.elastic, chain.thresholds, chain.weights, chain.creep_times,
        chain.creep_weight, chain.omega, chain.zeta, limits[0], limits[1], limits[2],
    )  # fmt: skip
    slips = (lines[0, 0], lines[0, 0] + lines[0, 1]) if sign != 0 else (math.inf, math.inf)
    pieces = np.empty((3, CAPACITY))
    count, shift, slip, slip_end = lay_pieces(
        own, state, lines[:2], (0.0, u), slips, (np.empty((3, CAPACITY)), pieces)
    )
    if count < 0:
        return lines, math.nan, slip, slip_end
    return pieces[:, :count].copy(), shift, slip, slip_end


@compiled
def run_periods(
    buffers: Buffers,
    states: States,
    actions: NDArray,
    drive: ActionScale,
    chain: Chain | None,
    sensing: Sensing,
    part: tuple[int, int],
) -> None:
    """Run one period of the axes part[0] to part[1] - 1 with actions (axes, numbers)."""
    lines, row = np.zeros((3, 2)), np.empty((1, ROW_SIZE))
    for k in range(part[0], part[1]):
        plant, kernel = plant_in(buffers.plants[k]), kernel_in(buffers.axes[k])
        contacts, s = own_contacts(buffers.contacts, k), kernel.state
        each, t, slid = contacts_in(contacts, False), states.t[k], s.slid
        states.level[k], sign = lay_period(actions[k], states.level[k], drive, lines)
        limits = buffers.limits[k]
        pieces, shift, slip, slip_end = lay_drive(
            chain, (buffers.actuators[k], limits, s.now_u), lines, sign
        )
        if math.isnan(shift):
            states.failed[k] = 1
            continue
        slips = shift, slip, slip_end, 1 if sign == 0 else sign
        begin_cycles(buffers.axes[k], contacts, t, 1, slips)
        s.spent, s.allowance, s.unfinished, kernel.arc.holds = 0, PER_CYCLE, 0, 0
        end = t + (lines[0, 0] + lines[0, 1])
        last, kept = math.floor(end * sensing.rate), buffers.sampled.shape[1]
        for reading in range(max(math.floor(t * sensing.rate) + 1, last - sensing.delay), last + 1):
            s.t_end, s.stop_cycle = reading / sensing.rate, ENDLESS
            solve_cycles(plant, s, kernel, each, pieces, row)
            buffers.sampled[k, reading % kept] = s.now_x
        s.t_end, s.stop_cycle = math.inf, 1
        solve_cycles(plant, s, kernel, each, pieces, row)
        if s.v_most > NEARLY_AS_FAST * limits[1]:
            limits[1] = s.v_most / NEARLY_AS_FAST**2
        s.v_most = 0.0
        states.t[k], states.x[k], states.v[k] = end, s.now_x, s.now_v
        states.lost[k], states.slid[k] = s.last_heat, s.slid - slid
        states.vibration[k] = ringing(plant, s)
        states.reading[k] = read(buffers.sampled[k], sensing, k, max(last - sensing.delay, 0))
        states.failed[k] = 1 if s.unfinished != 0 or not math.isfinite(s.now_x) else 0


@compiled
def read(sampled: NDArray, sensing: Sensing, k: int, number: int) -> float:
    """Return a reading (m) of axis k by its number; sampled are positions (m), see `Buffers`."""
    x = sampled[number % len(sampled)] + sensing.noise[k] * normal(sensing.seed[k], number)
    x += sensing.drift[k] * (number / sensing.rate)
    if sensing.resolution > 0.0:
        return np.rint(x / sensing.resolution) * sensing.resolution
    return x


@compiled
def scramble(number: int) -> int:
    """Return 32 bits that look random, of 32 bits.

    The permuted congruential generator, as M. Jarzynski, M. Olano, J. Comput. Graph. Tech. 9 (2020)
    21 recommend it for hashing. All products stay below 2^63.
    """
    state = (number * 747796405 + 2891336453) & _BITS
    word = (((state >> ((state >> 28) + 4)) ^ state) * 277803737) & _BITS
    return (word >> 22) ^ word


@compiled
def normal(seed: int, number: int) -> float:
    """Return a normal number that depends only on the seed and the number of a reading.

    Unlike the blocks of `axis.sensor`, it costs the same whichever readings a policy sees.
    """
    first = scramble(scramble(seed) ^ (number & _BITS))
    second = scramble(first ^ scramble(number & _BITS))
    size = math.sqrt(-2.0 * math.log((first + 0.5) / (_BITS + 1.0)))
    return size * math.cos(2.0 * math.pi * (second / (_BITS + 1.0)))


@compiled
def ringing(plant: np.record, s: np.record) -> float:
    """Return the amplitude (m) with which the runner rings on an elastic contact at rest."""
    away = s.now_z - (plant.force - plant.spring * s.now_x) / plant.sigma_0
    return math.hypot(away, s.now_v * plant.inv_omega)
