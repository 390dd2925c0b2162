# SPDX-License-Identifier: Apache-2.0
"""Arcs of contacts whose law has its own rate: one step of an explicit method of order 8.

So go several contacts whose limit of z follows w, too: they have no series.

State and step are mirrored so that w > 0: w, the z of each contact, their second states if the law
has two, and with a spring the path, the integral of w. The step gives polynomials of time, which
the rest of the solver uses like a Taylor series for events, samples and sums. An arc ends where w
turns, or with the step, whose length keeps the error of the polynomials, of order 7, within its
limit.

The method is DOP853 with its continuous output: E. Hairer, S. P. Norsett, G. Wanner, Solving
Ordinary Differential Equations I, Springer 1993, section II.10. Stages 1 to 12 make the step, stage
13 is the rate at its end, 14 to 16 serve the output alone. Each row of the tables is what one stage
takes of those before it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.arrays import Array
from stickslip_ros.compiled import compiled
from stickslip_ros.laws.law import ELASTOPLASTIC_CALC, FOREIGN
from stickslip_ros.model.friction import has_two_states, rates_of_law
from stickslip_ros.solver.contact_arcs import mean_at_end, stay
from stickslip_ros.solver.layout import ORDER, PLASTIC, TAYLOR, TURN
from stickslip_ros.solver.taylor import W, Z, integral, polynomial, turn_end
from stickslip_ros.solver.within_arc import AT_REST, end_at, is_at_rest

#: Stages with those of the continuous output, and those of a step alone
STAGES, STEP = 16, 12
#: Powers of the fraction of a step in its continuous output, from 0 on
DEGREES = 8


def _matrix(rows: list[tuple[list[int], list[float]]]) -> Array:
    """Return rows (rows, STAGES) of which each is given by its columns and its numbers."""
    matrix = np.zeros((len(rows), STAGES))
    for row, (columns, numbers) in zip(matrix, rows, strict=True):
        row[columns] = numbers
    return matrix


# fmt: off
#: What each stage takes of those before it
A = _matrix([
    ([], []),
    ([0], [0.05260015195876773]),
    ([0, 1], [
        0.0197250569845379, 0.0591751709536137,
    ]),
    ([0, 2], [
        0.02958758547680685, 0.08876275643042054,
    ]),
    ([0, 2, 3], [
        0.2413651341592667, -0.8845494793282861, 0.924834003261792,
    ]),
    ([0, 3, 4], [
        0.037037037037037035, 0.17082860872947386, 0.12546768756682242,
    ]),
    ([0, 3, 4, 5], [
        0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125,
    ]),
    ([0, 3, 4, 5, 6], [
        0.03709200011850479, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023,
    ]),
    ([0, 3, 4, 5, 6, 7], [
        0.6241109587160757, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
        20.154067550477894, -43.48988418106996,
    ]),
    ([0, 3, 4, 5, 6, 7, 8], [
        0.47766253643826434, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627,
    ]),
    ([0, 3, 4, 5, 6, 7, 8, 9], [
        -0.9371424300859873, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
        -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
    ]),
    ([0, 3, 4, 5, 6, 7, 8, 9, 10], [
        2.273310147516538, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
        27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
        0.6433927460157636,
    ]),
    ([0, 5, 6, 7, 8, 9, 10, 11], [
        0.054293734116568765, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
    ]),
    ([0, 6, 7, 8, 9, 10, 11, 12], [
        0.056167502283047954, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637,
        0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298,
    ]),
    ([0, 5, 6, 7, 10, 11, 12, 13], [
        0.03183464816350214, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099,
        -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456,
        0.1413124436746325,
    ]),
    ([0, 5, 6, 7, 8, 12, 13, 14], [
        -0.42889630158379194, -4.697621415361164, 7.683421196062599, 4.06898981839711,
        0.3567271874552811, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987,
    ]),
])
#: Estimates of the error, of order 5 and 3
ERRORS = _matrix([
    ([0, 5, 6, 7, 8, 9, 10, 11], [
        0.01312004499419488, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
        -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
    ]),
    ([0, 5, 6, 7, 8, 9, 10, 11], [
        -0.18980075407240762, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082,
    ]),
])
#: The last four functions of the continuous output
OUTPUT = _matrix([
    ([0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], [
        -8.428938276109013, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
        2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688,
        -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894,
    ]),
    ([0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], [
        10.427508642579134, 242.28349177525817, 165.20045171727028, -374.5467547226902,
        -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229,
        15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408,
    ]),
    ([0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], [
        19.985053242002433, -387.0373087493518, -189.17813819516758, 527.8081592054236,
        -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443,
        -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279,
    ]),
    ([0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], [
        -25.69393346270375, -154.18974869023643, -231.5293791760455, 357.6391179106141,
        93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605,
        -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564,
    ]),
])
# fmt: on

#: When each stage is, as a fraction of the step
TIMES = np.sum(A, axis=1)


def _powers() -> Array:
    """Return the output's functions x, x (1 - x), x^2 (1 - x), ... as powers of x, (7, DEGREES)."""
    found, function = np.zeros((7, DEGREES)), np.polynomial.Polynomial([1.0])
    for k in range(7):
        function *= np.polynomial.Polynomial([0.0, 1.0] if k % 2 == 0 else [1.0, -1.0])
        found[k, : len(function.coef)] = function.coef
    return found


#: Powers of x that the functions of the continuous output are made of
POWERS = _powers()


# -- the arcs

#: Error allowed in a step, as a fraction of the tolerance per cycle. The estimate is that of the
#: output, several times the error of the state at the end.
_PER_STEP = 0.03
#: This many steps of a cycle may each have that error. Where there are more, each gets a fraction
#: by its length: a sliding contact keeps their errors, and a slow drive takes thousands of steps.
_FREE_STEPS = 3.0
#: Smallest such share: a rest may last for ever, and its steps grow
_LEAST_PART = 1e-4
#: Error allowed in a step, as a fraction of the motion that is left: a ringing has to die away
_OF_MOTION = 1e-3
#: First step, in units of the ringing; its length soon adapts to the allowed error
_FIRST = 0.1
#: Least and largest factor from one step to the next; the step taken, as a fraction of the one
#: whose error would be just allowed
_LEAST, _MOST, _SAFE = 0.2, 5.0, 0.9
#: Power of its length with which the error of a step grows; fraction of it that counts as no error
_ORDER, _NO_ERROR = 8.0, 1e-30
#: Longest step of a runner in motion, in the fastest time of its elastic contact: beyond, no such
#: method is stable. Its estimate of the error, a polynomial of that number, has a root at 5.65, and
#: is less than the error within the step from 4 on
_STABLE = 4.0
#: Weight of the square of the estimate of third order beside that of fifth: as the authors of the
#: method have it
_THIRD = 0.01
#: Lengths tried for one arc. Where none is exact enough, the arc has no length, and the next one
#: tries still shorter ones; the event loop ends that.
_TRIES = 40
#: Places of w and of the z of the first contact in the state
_W, _FIRST_Z = range(2)
#: Row of the second state among the series of a contact, after that of its deflection
SECOND = 1


@compiled
def needs_steps(c: np.record) -> bool:
    """Return whether arcs of a contact are steps: its law has its own rate, or z_lim follows w."""
    return c.kind >= FOREIGN or c.kind == ELASTOPLASTIC_CALC or c.z_k != c.z_s


@compiled
def force_of(c: np.record, z: float, second: float, w: float) -> float:
    """Return F (N) of Eq. 1 of one of the contacts, whatever its law."""
    z_rate, _ = rates_of_law(z, second, w, c)
    return c.sigma_0 * z + c.sigma_1 * z_rate + c.sigma_2 * w


@compiled
def second_after(arc: np.record, c: np.record, t: float) -> float:
    """Return the second state of a contact after t (s) within the arc."""
    if arc.kind == TAYLOR and c.kind >= FOREIGN:
        return polynomial(c.series, SECOND, t)
    return c.second


@compiled
def general_arc(arc: np.record, plant: np.record, contacts: NDArray, limit: float) -> None:
    """Find the end of the arc that `begin_arc` started, at most limit (s) long."""
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * arc.z
    arc.kind, arc.cost = TAYLOR, len(contacts)
    arc.mirror = 1.0 if arc.w > 0.0 or (arc.w == 0.0 and net > 0.0) else -1.0
    still = is_at_rest(arc, plant, net)
    two = has_two_states(contacts[0].kind)
    if still and not two:
        stay(arc, contacts, limit, 0.0)
        return
    size = _FIRST_Z + (2 if two else 1) * len(contacts) + (1 if plant.spring != 0.0 else 0)
    rates = np.zeros((STAGES + 2, size))  # at the stages; the state there, and that at the start
    y = rates[STAGES + 1]
    y[_W] = 0.0 if still else arc.mirror * arc.w
    for i in range(len(contacts)):
        y[_FIRST_Z + i] = arc.mirror * contacts[i].z
        if two:
            y[_FIRST_Z + len(contacts) + i] = contacts[i].second
    h = _accepted_step(arc, plant, contacts, rates, limit, math.inf if still else plant.mass)
    if h == 0.0:
        stay(arc, contacts, 0.0, arc.w)
        return
    _write_output(arc.work[W], rates, _W, h)
    arc.work[Z] = 0.0
    for i in range(len(contacts)):
        c = contacts[i]
        c.branch = PLASTIC
        _write_output(c.series[Z], rates, _FIRST_Z + i, h)
        if two:
            _write_output(c.series[SECOND], rates, _FIRST_Z + len(contacts) + i, h)
        for n in range(DEGREES):
            arc.work[Z, n] += c.sigma_0 / plant.sigma_0 * c.series[Z, n]
    t = h
    if not still:
        t, event = turn_end(arc.work, h, 0.0)
    for c in contacts:
        c.z_end = arc.mirror * polynomial(c.series, Z, t)
        c.second_end = polynomial(c.series, SECOND, t)
    turned = not still and event == TURN
    w_end = 0.0 if turned else arc.mirror * polynomial(arc.work, W, t)
    end_at(arc, t, mean_at_end(contacts), w_end, arc.mirror * integral(arc.work, W, t))


@compiled
def _accepted_step(
    arc: np.record, plant: np.record, contacts: NDArray, rates: NDArray, limit: float, mass: float
) -> float:
    """Fill the rates of all stages of a step within the error limit; return its length (s).

    0 if no step is exact enough. mass (kg) is that of the runner, infinite if it is still.
    """
    h = arc.trial if arc.trial > 0.0 else _FIRST * min(plant.inv_omega, 1.0)
    net = arc.force - plant.spring * arc.x - plant.sigma_0 * arc.z
    motion = abs(arc.w) * plant.inv_omega + abs(net) / plant.sigma_0
    allowed = _PER_STEP * plant.tolerance
    if mass < math.inf:
        h = min(h, _STABLE * min(plant.inv_omega, 0.5 / plant.delta))
        allowed = min(allowed, _OF_MOTION * max(motion, AT_REST * plant.tolerance))
    _fill_stage(arc, plant, contacts, rates, (0, 0.0), mass)
    for _ in range(_TRIES):
        cut = h >= limit
        h = min(h, limit)
        for stage in range(1, STEP):
            _fill_stage(arc, plant, contacts, rates, (stage, h), mass)
        part = min(1.0, max(_FREE_STEPS * h / limit, _LEAST_PART)) if limit > 0.0 else 1.0
        off = _error(arc, contacts, rates, h) / (part * allowed)
        factor = min(_MOST, max(_LEAST, _SAFE * max(off, _NO_ERROR) ** (-1.0 / _ORDER)))
        if off <= 1.0:
            # The length of a step cut by a limit does not predict the next one.
            arc.trial = max(h * factor, arc.trial) if cut else h * factor
            for stage in range(STEP, STAGES):
                _fill_stage(arc, plant, contacts, rates, (stage, h), mass)
            return h
        arc.cost += len(contacts)
        h *= min(factor, _SAFE)
    arc.trial = h
    return 0.0


@compiled
def _fill_stage(
    arc: np.record,
    plant: np.record,
    contacts: NDArray,
    rates: NDArray,
    step: tuple[int, float],
    mass: float,
) -> None:
    """Fill the rates at a stage of a step; step is the number of the stage and the length (s)."""
    (stage, h), size = step, rates.shape[1]
    y = STAGES
    for k in range(size):
        rates[y, k] = rates[STAGES + 1, k]
    for j in range(stage):
        a = h * A[stage, j]
        if a != 0.0:
            for k in range(size):
                rates[y, k] += a * rates[j, k]
    w, count = rates[y, _W], len(contacts)
    seconds = _FIRST_Z + count if has_two_states(contacts[0].kind) else 0
    force = plant.sigma_2 * w
    for i in range(count):
        c = contacts[i]
        z, second = rates[y, _FIRST_Z + i], rates[y, seconds + i] if seconds else 0.0
        z_rate, second_rate = rates_of_law(z, second, abs(w), c)
        if w < 0.0:  # beyond the turn: what the law would do if it went on as before
            at_turn = rates_of_law(z, second, 0.0, c)
            z_rate, second_rate = 2.0 * at_turn[0] - z_rate, 2.0 * at_turn[1] - second_rate
        force += c.sigma_0 * z + c.sigma_1 * z_rate
        rates[stage, _FIRST_Z + i] = z_rate
        if seconds:
            rates[stage, seconds + i] = second_rate
    pull = arc.force
    if plant.spring != 0.0:
        rates[stage, size - 1] = w
        dr = arc.mirror * rates[y, size - 1] + arc.pulled * h * TIMES[stage]
        pull -= plant.spring * (arc.x + dr)
    rates[stage, _W] = (arc.mirror * pull - force) / mass


@compiled
def _error(arc: np.record, contacts: NDArray, rates: NDArray, h: float) -> float:
    """Return the error of a step of h (s), m; infinite if it is beyond all numbers."""
    largest, count = 0.0, len(contacts)
    for k in range(rates.shape[1]):
        fifth = third = 0.0
        for j in range(STEP):
            fifth += ERRORS[0, j] * rates[j, k]
            third += ERRORS[1, j] * rates[j, k]
        whole = math.sqrt(fifth * fifth + _THIRD * third * third)
        off = h * fifth * fifth / whole if whole > 0.0 else 0.0
        if k == _W:
            off *= arc.weight
        elif _FIRST_Z + count <= k < _FIRST_Z + 2 * count and has_two_states(contacts[0].kind):
            # What a fraction of the second state is off changes the limit of z by less than that.
            off *= contacts[k - _FIRST_Z - count].z_k / (abs(rates[STAGES + 1, k]) + h)
        if not off < math.inf:
            return math.inf
        largest = max(largest, off)
    return largest


@compiled
def _write_output(row: NDArray, rates: NDArray, k: int, h: float) -> None:
    """Write the continuous output of one state into a row of coefficients (ORDER + 1,)."""
    f0 = f3 = f4 = f5 = f6 = 0.0
    for j in range(STAGES):
        rate = h * rates[j, k]
        f0 += A[STEP, j] * rate
        f3 += OUTPUT[0, j] * rate
        f4 += OUTPUT[1, j] * rate
        f5 += OUTPUT[2, j] * rate
        f6 += OUTPUT[3, j] * rate
    f1 = h * rates[0, k] - f0
    f2 = 2.0 * f0 - h * (rates[STEP, k] + rates[0, k])
    per_power = 1.0
    row[0] = rates[STAGES + 1, k]
    for n in range(1, ORDER + 1):
        per_power /= h
        row[n] = 0.0
        if n < DEGREES:
            row[n] = POWERS[0, n] * f0 + POWERS[1, n] * f1 + POWERS[2, n] * f2
            row[n] += POWERS[3, n] * f3 + POWERS[4, n] * f4 + POWERS[5, n] * f5
            row[n] = (row[n] + POWERS[6, n] * f6) * per_power
