# SPDX-License-Identifier: Apache-2.0
"""The whole system at once, from the command to the runner, left to a general integrator.

Amplifier, plays, creep, resonance, contacts and runner are one state vector, and no stage is solved
by itself. Steps are those of SciPy's DOP853, compiled; each ends where something switches: where
the output of the amplifier turns or meets its slew limit, a play begins or ends to move, or the
runner turns on the actuator. Nothing is shared with the solver but the parameters, the constants
of the contacts, and the table of plays.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from stickslip_ros.physics.laws.law import ALWAYS_PLASTIC, ELASTOPLASTIC_CALC, FOREIGN
from stickslip_ros.physics.model import Plant, drive_of
from stickslip_ros.physics.model.actuator import Actuator
from stickslip_ros.physics.parameters import Parameters

#: States of the runner, the amplifier, the actuator and the wear; creep and contacts follow.
X, V, VOLTS, U, SWING, SLID, CREEP = range(7)
_NM, _SPEED = 1e-9, 1e-4  # m and m/s in one unit of the state
#: Exponentials of the creep, two a decade from `creep_start` on
_EXPONENTIALS = 16
_EULER = 0.5772156649015329
#: K at which gain and friction are given; factor by which wear changes distances at most
_ROOM, _MOST_WORN = 293.15, 100.0
#: Longest steps: radians of a ringing; time constants of the amplifier and of the contact's
#: damping; shares of the shortest distance of a contact that the runner slides on the actuator
_RADIANS, _CONSTANTS, _SLID = 0.6, 3.0, 0.1
#: Search of a switch in a step: as near as a millionth of a millionth of it, or (m/s or V) as
#: this; the most tries, and how near one may come to what is known, as a share of what is left
_NEAREST, _SWITCHED, _TRIES, _APART = 1e-12, 1e-14, 80, 1e-4
#: So near to a switch (m/s or V) it has switched: a play that moves is there to rounding
_ROUNDING = 1e-12
#: Error of a step, of the state and at least (nm)
ACCURACY = (1e-12, 1e-9)
#: Steps of one piece of a cycle, and there is no answer
MOST_STEPS = 1_000_000

_A, _B, _C, _E3, _E5 = (
    np.ascontiguousarray(part) for part in (DOP853.A, DOP853.B, DOP853.C, DOP853.E3, DOP853.E5)
)
_STAGES = len(_B)

compiled = numba.njit(error_model="numpy", nogil=True, cache=True)


class System(NamedTuple):
    """Constants of the whole system."""

    elastic: float  #: m/V
    thresholds: NDArray[np.float64]  #: of the plays, V
    weights: NDArray[np.float64]  #: of the plays, m/V
    tau: float  #: of the amplifier, s; 0 without a lag
    slew: float  #: of the amplifier, V/s
    omega: float  #: of the actuator, rad/s; 0 if rigid
    zeta: float
    taus: NDArray[np.float64]  #: of the creep, s; empty without
    creep: float  #: weight of each exponential
    mass: float
    force: float
    spring: float


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _alpha(z: float, w: float, z_ba: float, z_ss: float, printed: bool) -> float:
    """Return alpha of Eq. 8."""
    if z * w <= 0.0 or abs(z) <= z_ba:
        return 0.0
    if abs(z) >= z_ss:
        return 1.0
    shown = z if printed else abs(z)
    return 0.5 * math.sin(math.pi * (shown - 0.5 * (z_ss + z_ba)) / (z_ss - z_ba)) + 0.5


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def contact_rates(z: float, theta: float, w: float, c: NDArray) -> tuple[float, float, float]:
    """Return z' (m/s), the rate of the age and F (N) of a contact with the constants c."""
    z_ba, z_ss, top, theta_rate = c[3], c[4], 0.0, 0.0
    if c[8] == FOREIGN:
        age = 1.0 + c[10] * math.log(1.0 + max(theta, 0.0) / c[12])
        z_ba, z_ss, top = age * z_ba, age * z_ss, age * c[5]
        theta_rate = 1.0 - abs(w) * theta / c[11]
    else:
        top = c[5] + (c[6] - c[5]) * math.exp(-((w / c[7]) ** 2))
    if c[8] == ELASTOPLASTIC_CALC:
        z_ss = top
    share = 1.0 if c[8] == ALWAYS_PLASTIC else _alpha(z, w, z_ba, z_ss, c[9] != 0.0)
    rate = w - share * abs(w) / top * z
    return rate, theta_rate, c[0] * z + c[1] * rate + c[2] * w


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _volt_rate(t: float, y: NDArray, line: tuple[float, float], s: System) -> float:
    """Return the slope (V/s) of the output of the amplifier; line is the command's start, slope."""
    if s.tau == 0.0:
        return line[1]
    return min(max((line[0] + line[1] * t - y[VOLTS]) / s.tau, -s.slew), s.slew)


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _rates(
    t: float, y: NDArray, dy: NDArray, plays: NDArray, line: tuple[float, float], s: System, c: Any
) -> float:
    """Fill the rates of the state; return w (m/s)."""
    slope = _volt_rate(t, y, line, s)
    volts = y[VOLTS]
    q, share = s.elastic * volts, s.elastic
    for k in range(len(plays)):
        low, high = volts - s.thresholds[k], volts + s.thresholds[k]
        q += s.weights[k] * min(max(plays[k], low), high)
        if (slope > 0.0 and plays[k] <= low) or (slope < 0.0 and plays[k] >= high):
            share += s.weights[k]
    dy[VOLTS] = slope
    deflection, rate = q, share * slope
    for k in range(len(s.taus)):
        crept = (q - y[CREEP + k] * _NM) / s.taus[k]
        dy[CREEP + k] = crept / _NM
        deflection += s.creep * y[CREEP + k] * _NM
        rate += s.creep * crept
    if s.omega > 0.0:
        rate = y[SWING] * _NM * s.omega
        dy[U] = rate / _NM
        dy[SWING] = s.omega * (deflection / _NM - y[U]) - 2.0 * s.zeta * s.omega * y[SWING]
    else:
        dy[U], dy[SWING] = rate / _NM, 0.0
    w = y[V] * _SPEED - rate
    force, slid, stiffness, first = 0.0, 0.0, 0.0, CREEP + len(s.taus)
    for k in range(len(c)):
        z_rate, aging, one = contact_rates(
            y[first + 2 * k] * _NM, y[first + 2 * k + 1] * c[k, 12], w, c[k]
        )
        dy[first + 2 * k], dy[first + 2 * k + 1] = z_rate / _NM, aging / c[k, 12]
        force, slid, stiffness = (
            force + one, slid + c[k, 0] * abs(w - z_rate), stiffness + c[k, 0]
        )  # fmt: skip
    dy[SLID] = slid / stiffness / _NM
    dy[X] = y[V] * _SPEED / _NM
    dy[V] = (s.force - s.spring * y[X] * _NM - force) / s.mass / _SPEED
    return w


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _step(
    t: float, y: NDArray, h: float, stages: NDArray, plays: NDArray,
    line: tuple[float, float], s: System, c: NDArray, end: NDArray, accuracy: tuple[float, float],
) -> float:  # fmt: skip
    """Fill the state h later; return its error over the one allowed. stages[0] are the rates."""
    for k in range(1, _STAGES):
        for i in range(len(y)):
            change = 0.0
            for j in range(k):
                change += _A[k, j] * stages[j, i]
            end[i] = y[i] + h * change
        _rates(t + _C[k] * h, end, stages[k], plays, line, s, c)
    for i in range(len(y)):
        change = 0.0
        for j in range(_STAGES):
            change += _B[j] * stages[j, i]
        end[i] = y[i] + h * change
    _rates(t + h, end, stages[_STAGES], plays, line, s, c)
    three, five = 0.0, 0.0
    for i in range(len(y)):
        allowed = accuracy[1] + accuracy[0] * max(abs(y[i]), abs(end[i]))
        a, b = 0.0, 0.0
        for j in range(_STAGES + 1):
            a += _E3[j] * stages[j, i]
            b += _E5[j] * stages[j, i]
        three, five = three + (a / allowed) ** 2, five + (b / allowed) ** 2
    if three == 0.0 and five == 0.0:
        return 0.0
    return abs(h) * five / math.sqrt((five + 0.01 * three) * len(y))


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _switches(
    t: float, y: NDArray, w: float, plays: NDArray, line: tuple[float, float], s: System,
    found: NDArray,
) -> None:  # fmt: skip
    """Fill what turns its sign where something switches."""
    found[0] = w
    found[1] = line[0] + line[1] * t - y[VOLTS] if s.tau > 0.0 else 1.0
    found[2] = abs(found[1]) - s.tau * s.slew if s.tau > 0.0 else 1.0
    for k in range(len(plays)):
        found[3 + 2 * k] = y[VOLTS] - s.thresholds[k] - plays[k]
        found[4 + 2 * k] = y[VOLTS] + s.thresholds[k] - plays[k]


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _turned(before: NDArray, after: NDArray) -> bool:
    for k in range(len(before)):
        if before[k] * after[k] < 0.0 and abs(before[k]) > _ROUNDING:
            return True
    return False


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _first_switch(
    t: float, y: NDArray, h: float, stages: NDArray, plays: NDArray,
    line: tuple[float, float], s: System, c: NDArray, end: NDArray, accuracy: tuple[float, float],
    before: NDArray,
) -> tuple[float, int]:  # fmt: skip
    """Return the step (s), at most h, just behind the first switch, and how many were tried.

    before is where it begins. By straight lines between both sides, of which one that stays twice
    counts half.
    """
    rates = np.empty_like(y)
    below, above, found = before.copy(), np.empty_like(before), np.empty_like(before)
    low, high, nearest = 0.0, h, _NEAREST * h
    least, most, side = 1.0, 1.0, 0
    _step(t, y, h, stages, plays, line, s, c, end, accuracy)
    w = _rates(t + h, end, rates, plays, line, s, c)
    _switches(t + h, end, w, plays, line, s, above)
    tried = 0
    while tried < _TRIES:
        tried += 1
        share, rest = 1.0, 0.0
        for k in range(len(before)):
            if before[k] * above[k] < 0.0 and abs(before[k]) > _ROUNDING:
                share = min(share, least * below[k] / (least * below[k] - most * above[k]))
                rest = max(rest, abs(above[k]))
        if high - low <= nearest or rest <= _SWITCHED:
            break
        h = low + min(max(share, _APART), 1.0 - _APART) * (high - low)
        _step(t, y, h, stages, plays, line, s, c, end, accuracy)
        w = _rates(t + h, end, rates, plays, line, s, c)
        _switches(t + h, end, w, plays, line, s, found)
        if _turned(before, found):
            high, most, above[:] = h, 1.0, found
            least = 0.5 * least if side > 0 else least
            side = 1
        else:
            low, least, below[:] = h, 1.0, found
            most = 0.5 * most if side < 0 else most
            side = -1
    return high, tried


@compiled  # type: ignore[untyped-decorator, unused-ignore]
def _piece(
    y: NDArray, plays: NDArray, line: tuple[float, float], duration: float, longest: float,
    shortest: float, accuracy: tuple[float, float], s: System, c: NDArray,
) -> bool:  # fmt: skip
    """Go on while the command is straight; return whether that took no more than `MOST_STEPS`.

    longest is the longest step (s), shortest the shortest distance (m) of a contact.
    """
    stages = np.empty((_STAGES + 1, len(y)))
    end, best = np.empty_like(y), np.empty_like(y)
    before, after = np.empty(3 + 2 * len(plays)), np.empty(3 + 2 * len(plays))
    t, h, count = 0.0, min(longest, 1e-3 * duration), 0
    while t < duration:
        count += 1
        if count > MOST_STEPS:
            return False
        w = _rates(t, y, stages[0], plays, line, s, c)
        _switches(t, y, w, plays, line, s, before)
        h = min(h, longest, _SLID * shortest / max(abs(w), 1e-30))
        last = h >= duration - t
        h = min(h, duration - t)
        error = _step(t, y, h, stages, plays, line, s, c, end, accuracy)
        if error > 1.0 and h > 1e-15 * duration:
            h *= max(0.2, 0.9 * error ** (-1.0 / 8.0))
            continue
        _switches(t + h, end, _rates(t + h, end, best, plays, line, s, c), plays, line, s, after)
        wider = h * min(5.0, 0.9 * max(error, 1e-10) ** (-1.0 / 8.0))
        if _turned(before, after):
            h, tried = _first_switch(t, y, h, stages, plays, line, s, c, end, accuracy, before)
            last, count = False, count + tried  # a play that hardly moves may switch at each step
            _step(t, y, h, stages, plays, line, s, c, end, accuracy)
        t = duration if last else t + h
        y[:] = end
        if s.tau == 0.0:
            y[VOLTS] = line[0] + line[1] * t
        for k in range(len(plays)):
            plays[k] = min(max(plays[k], y[VOLTS] - s.thresholds[k]), y[VOLTS] + s.thresholds[k])
        h = wider
    return True


class NoAnswerError(Exception):
    """The integrator has no answer: too many steps, or numbers beyond all bounds."""


class WholeSystem:
    """The system of one set of parameters, from rest."""

    def __init__(self, p: Parameters, accuracy: tuple[float, float] = ACCURACY) -> None:
        """Take the constants; accuracy as in `ACCURACY`."""
        p = at_room_temperature(p)
        a, actuator, plant = p.actuator, Actuator.of(p.actuator), Plant.of(p)
        half_decades = np.arange(_EXPONENTIALS if a.creep else 0)
        self.system = System(
            elastic=actuator.elastic,
            thresholds=actuator.thresholds,
            weights=actuator.weights,
            tau=1.0 / (2.0 * math.pi * a.amplifier_bandwidth) if a.amplifier_bandwidth else 0.0,
            slew=1e6 * a.amplifier_slew if a.amplifier_slew else math.inf,
            omega=2.0 * math.pi * (a.actuator_resonance or 0.0),
            zeta=a.actuator_damping,
            taus=a.creep_start * math.exp(_EULER) * 10.0 ** (half_decades / 2.0 + 0.25),
            creep=0.5 * (a.creep or 0.0),
            mass=plant.mass,
            force=plant.force,
            spring=plant.spring,
        )
        self.accuracy = accuracy
        self.take(plant)
        self.plays = np.zeros(len(actuator.thresholds))
        self.y = np.zeros(CREEP + len(half_decades) + 2 * len(self.contacts))
        self.command = 0.0  # V

    @classmethod
    def moving(
        cls, p: Parameters, v: float, z: float, accuracy: tuple[float, float]
    ) -> WholeSystem:
        """Begin at a speed (m/s), with a deflection (m) of each contact."""
        system = cls(p, accuracy)
        system.y[V] = v / _SPEED
        system.y[CREEP + len(system.system.taus) :: 2] = z / _NM
        return system

    def take(self, plant: Plant) -> None:
        """Go on with other contacts."""
        own = plant.own if plant.own else (0.0, 1.0, 1.0)
        contacts = plant.contacts or (plant.contact,)
        self.contacts = np.array([(*contact, *own) for contact in contacts], dtype=np.float64)
        self.system = self.system._replace(mass=plant.mass, force=plant.force, spring=plant.spring)

    @property
    def fastest(self) -> float:
        """Rate (1/s) of the fastest pole of the linear parts."""
        s, c = self.system, self.contacts
        stiffness, damping = c[:, 0].sum() + s.spring, (c[:, 1] + c[:, 2]).sum()
        poles = np.roots([s.mass, damping, stiffness])
        return float(max(np.abs(poles).max(), s.omega, 1.0 / s.tau if s.tau else 0.0))

    @property
    def x(self) -> float:
        """Position of the runner, m."""
        return float(self.y[X] * _NM)

    @property
    def slid(self) -> float:
        """Way that the contacts have slid, their mean by stiffness, m."""
        return float(self.y[SLID] * _NM)

    @property
    def z(self) -> NDArray[np.float64]:
        """Deflection of each contact, m."""
        return self.y[CREEP + len(self.system.taus) :: 2] * _NM

    def segment(self, duration: float, slope: float) -> None:
        """Let the command run straight for a duration (s) at a slope (V/s)."""
        s, target = self.system, self.command + slope * duration
        if s.tau or math.isinf(s.slew):
            self._go(duration, self.command, slope)
        else:
            # Without a lag the output runs at the slew until it meets the command, then with it.
            apart = self.command - float(self.y[VOLTS])
            towards = math.copysign(s.slew, apart)
            meets = apart / (towards - slope) if apart * (towards - slope) > 0.0 else math.inf
            late = min(duration, meets) if apart else 0.0
            for span, rate in (
                (late, towards), (duration - late, min(max(slope, -s.slew), s.slew))
            ):  # fmt: skip
                if span > 0.0:
                    self._go(span, float(self.y[VOLTS]), rate)
        self.command = target

    def _go(self, duration: float, start: float, slope: float) -> None:
        s, c = self.system, self.contacts
        stiffness = c[:, 0].sum() + s.spring
        longest = min(
            duration / 20.0,
            _RADIANS * math.sqrt(s.mass / stiffness) if stiffness else math.inf,
            _CONSTANTS * s.mass / max((c[:, 1] + c[:, 2]).sum(), 1e-300),
            _RADIANS / s.omega if s.omega else math.inf,
        )
        if s.tau:
            longest = min(longest, _CONSTANTS * s.tau)
        distances = np.where(c[:, 8] == ALWAYS_PLASTIC, np.minimum(c[:, 5], c[:, 6]), c[:, 3])
        ended = _piece(
            self.y, self.plays, (start, slope), duration, longest, float(distances.min()),
            self.accuracy, s, c,
        )  # fmt: skip
        if not ended or not np.isfinite(self.y).all():
            raise NoAnswerError


def at_room_temperature(p: Parameters) -> Parameters:
    """Return the parameters at 293.15 K with the gain that the actuator has now."""
    a = p.actuator
    gain = a.gain * (1.0 + a.gain_temperature * (a.temperature - _ROOM))
    return p.replace(gain=gain, temperature=_ROOM)


def aged(
    p: Parameters, dwell: float, rate: float, x: float = 0.0, number: int = 0, slid: float = 0.0
) -> Plant:
    """Return the plant of a cycle.

    After a dwell (s), at a rate (m/s), a place (m), a number, and a way that it slid before (m).
    """
    f, plant = p.friction, Plant.of(at_room_temperature(p))
    factor = 1.0 + f.dwell_growth * math.log(1.0 + dwell / f.dwell_start) / math.log(10.0)
    factor += f.rate_growth * math.log(1.0 + rate / f.rate_start) / math.log(10.0)
    factor *= 1.0 + f.friction_temperature * (p.actuator.temperature - _ROOM)
    factor *= min(max(math.exp(-f.wear_rate * slid), 1.0 / _MOST_WORN), _MOST_WORN)
    factor *= math.exp(f.surface_spread * _field(p, x) + f.slip_spread * _normal(p, 1, number))
    contact, *each = (
        c._replace(**{name: factor * getattr(c, name) for name in ("z_ba", "z_ss", "z_k", "z_s")})
        for c in (plant.contact, *plant.contacts)
    )
    return plant._replace(contact=contact, contacts=tuple(each))


def _normal(p: Parameters, what: int, number: int) -> float:
    """Number 0, 1, ... of the field (what 0) or of the cycles (1), by the generator it is of."""
    random = np.random.RandomState([p.friction.surface_seed, what, (number // 256) % 2**32])
    return float(random.standard_normal(256)[number % 256])


def _field(p: Parameters, x: float) -> float:
    """g(x): white noise, two nodes a correlation length, under a bell of half that length."""
    place = 2.0 * x / p.friction.surface_length
    nodes = np.arange(math.floor(place) - 12, math.floor(place) + 13)
    bell = np.exp(-0.5 * (nodes - place) ** 2)
    noise = np.array([_normal(p, 0, int(node)) for node in nodes])
    return float(bell @ noise / np.sqrt(bell @ bell))


def positions(
    p: Parameters,
    cycles: int,
    rest: float = 0.0,
    again: int = 0,
    accuracy: tuple[float, float] = ACCURACY,
    pushed: float = 0.0,
    before: float = 0.0,
) -> NDArray[np.float64]:
    """Return x (m) at the end of each cycle from rest, after a rest (s), and of more cycles.

    pushed: deflection (m) that each contact begins with; before: rest (s) before the first cycle.
    Raises NoAnswerError: as it says.
    """
    plain = {"actuator": "linear", "actuator_memory": False, "creep": 0.0}
    stages = ("amplifier_bandwidth", "amplifier_slew", "actuator_resonance")
    room = at_room_temperature(p)
    command = drive_of(room.replace(**plain, **dict.fromkeys(stages, 0.0)))
    begins, ends = (float(command.durations[:k].sum()) for k in (command.slip, command.slip_end))
    slips = command.rates[command.slip : command.slip_end]
    lasting = command.durations[command.slip : command.slip_end]
    rate = float(np.abs(slips * lasting).sum() / lasting.sum())
    system, found, now, slipped = WholeSystem.moving(p, 0.0, pushed, accuracy), [], 0.0, 0.0
    if before:  # warm or cold, of the mean surface
        system.take(aged(p.replace(surface_spread=0.0, slip_spread=0.0), 0.0, 0.0))
        system.segment(before, 0.0)
        now = before
    number = 0
    for count, after in ((cycles, rest), (again, 0.0)):
        for _ in range(count):
            number += 1
            dwell = now + begins - slipped
            system.take(aged(p, dwell, rate, system.x, number, system.slid))
            for duration, slope in zip(command.durations, command.rates, strict=True):
                system.segment(float(duration), float(slope) / room.actuator.gain)
            now, slipped = now + command.period, now + ends
            found.append(system.x)
        if after:
            system.segment(after, 0.0)
            now += after
            found.append(system.x)
    return np.array(found)
