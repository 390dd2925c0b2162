# SPDX-License-Identifier: Apache-2.0
"""Amplifier, hysteresis, creep, resonance and contact as one system, left to a general integrator.

SciPy's DOP853 takes the steps, restarted at every kink of the voltage; the plays are moved after
each of them. Nothing of this is shared with the package but the parameters and the table of plays.
The contact of a cycle is that of its place, its number, its dwell and its rate.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from reference import z_rate_and_force
from scipy.integrate import DOP853

from stickslip_ros.model import Plant, drive_of
from stickslip_ros.model.actuator import Actuator
from stickslip_ros.parameters import Parameters

_NM, _SPEED = 1e-9, 1e-4


class Reference:
    """The whole system of one set of parameters, from rest."""

    def __init__(self, p: Parameters) -> None:
        """Take the constants."""
        a = p.actuator
        self.take(Plant.of(p))
        self.gain = a.gain
        self.tau = 1.0 / (2.0 * math.pi * a.amplifier_bandwidth) if a.amplifier_bandwidth else 0.0
        self.slew = 1e6 * a.amplifier_slew if a.amplifier_slew else math.inf
        self.omega = 2.0 * math.pi * (a.actuator_resonance or 0.0)
        self.zeta = a.actuator_damping
        actuator = Actuator.of(a)
        self.elastic, self.r, self.w = actuator.elastic, actuator.thresholds, actuator.weights
        half_decades = np.arange(16) if a.creep else np.empty(0)
        self.taus = a.creep_start * math.exp(0.5772156649) * 10.0 ** (half_decades / 2.0 + 0.25)
        self.creep_weight = 0.5 * (a.creep or 0.0)
        self.plays = np.zeros(len(self.r))
        # x, v, volts, u, u' / omega, creep, z of each contact
        self.y = np.zeros(5 + len(self.taus) + len(self.contacts))
        self.command = 0.0  # V
        self.output = 0.0  # V, of an amplifier with a slew limit alone

    def take(self, plant: Plant) -> None:
        """Go on with another plant."""
        self.plant = plant
        self.contacts = plant.contacts or (plant.contact,)

    def _quasistatic(self, volts: float, rate: float) -> tuple[float, float]:
        """Deflection of elastic part and plays (m), and its rate (m/s), while volts run one way."""
        low, high = volts - self.r, volts + self.r
        plays = np.clip(self.plays, low, high)
        moved = np.where(rate > 0.0, self.plays <= low, self.plays >= high)
        share = self.elastic + float(self.w @ moved)
        return self.elastic * volts + float(self.w @ plays), share * rate

    def _rates(self, t: float, y: NDArray[np.float64], start: float, slope: float) -> list[float]:
        command = start + slope * t
        volts, volt_rate = command, slope
        if self.tau:
            volts = y[2]
            volt_rate = min(max((command - volts) / self.tau, -self.slew), self.slew)
        q, q_rate = self._quasistatic(volts, volt_rate)
        creep = y[5 : 5 + len(self.taus)] * _NM
        creep_rate = (q - creep) / self.taus
        s = q + self.creep_weight * float(creep.sum())
        u_rate = q_rate + self.creep_weight * float(creep_rate.sum())
        bend = 0.0
        if self.omega:
            u, u_rate = y[3] * _NM, y[4] * _NM * self.omega
            bend = self.omega**2 * (s - u) - 2.0 * self.zeta * self.omega * u_rate
        plant = self.plant
        w = y[1] * _SPEED - u_rate
        each = [
            z_rate_and_force(z * _NM, w, contact)
            for z, contact in zip(y[-len(self.contacts) :], self.contacts, strict=True)
        ]
        force = sum(one for _, one in each)
        push = (-force + plant.force - plant.spring * y[0] * _NM) / plant.mass
        dynamic = [u_rate / _NM, bend / _NM / self.omega] if self.omega else [0.0, 0.0]
        return [
            y[1] * _SPEED / _NM, push / _SPEED, volt_rate, *dynamic, *(creep_rate / _NM),
            *(z_rate / _NM for z_rate, _ in each),
        ]  # fmt: skip

    def _longest(self, rate: float) -> float:
        """Step (s) short enough for the switches of the contact, the plays and the ringing."""
        longest = min(2e-6, abs(2e-9 / rate) if rate else math.inf)
        return min(longest, 0.3 / self.omega) if self.omega else longest

    def segment(self, duration: float, slope: float) -> None:
        """Let the voltage run straight for a duration (s) at a slope (V/s)."""
        if self.tau or math.isinf(self.slew):
            self._integrate(duration, slope)
            return
        # Without a lag the output runs at the slew until it meets the command, then with it.
        target = self.command + slope * duration
        apart = self.command - self.output
        towards = math.copysign(self.slew, apart)
        meets = apart / (towards - slope) if apart * (towards - slope) > 0.0 else math.inf
        late = min(duration, meets) if apart else 0.0
        parts = [(late, towards), (duration - late, min(max(slope, -self.slew), self.slew))]
        for span, rate in parts:
            if span > 0.0:
                self.command = self.output
                self._integrate(span, rate)
                self.output += rate * span
        self.command = target

    def _integrate(self, duration: float, slope: float, accuracy: float = 1e-10) -> None:
        start, t = self.command, 0.0
        ringing = 12.0 / (self.zeta * self.omega) if self.omega else 0.0
        dense = min(duration, max(30.0 * self.tau, ringing, 1e-7) + 3e-6)
        for end, quick in ((dense, True), (duration, False)):
            if end <= t:
                continue
            rate = slope * self.gain if not self.tau else 0.05
            longest = self._longest(rate) if quick else min(2e-6, (end - t) / 20.0)
            solver = DOP853(
                lambda s, y: self._rates(s, y, start, slope), t, self.y, end,
                max_step=longest, rtol=accuracy, atol=accuracy,
            )  # fmt: skip
            while solver.status == "running":
                solver.step()
                volts = solver.y[2] if self.tau else start + slope * solver.t
                self.plays = np.clip(self.plays, volts - self.r, volts + self.r)
            assert solver.status == "finished"
            self.y, t = solver.y, end
        self.command = start + slope * duration

    @property
    def x(self) -> float:
        """Position of the runner, m."""
        return float(self.y[0] * _NM)


def aged(p: Parameters, dwell: float, rate: float, x: float = 0.0, number: int = 0) -> Plant:
    """The laws once more: dwell (s), rate (m/s), place (m) and number of the cycle."""
    f, plant = p.friction, Plant.of(p)
    factor = 1.0 + f.dwell_growth * math.log(1.0 + dwell / f.dwell_start) / math.log(10.0)
    factor += f.rate_growth * math.log(1.0 + rate / f.rate_start) / math.log(10.0)
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


def positions(p: Parameters, cycles: int, rest: float = 0.0, again: int = 0) -> NDArray[np.float64]:
    """Return x (m) at the end of each cycle from rest, after a rest (s), and of more cycles."""
    plain = {"actuator": "linear", "actuator_memory": False, "creep": 0.0}
    stages = ("amplifier_bandwidth", "amplifier_slew", "actuator_resonance")
    command = drive_of(p.replace(**plain, **dict.fromkeys(stages, 0.0)))
    begins, ends = (float(command.durations[:k].sum()) for k in (command.slip, command.slip_end))
    slips = command.rates[command.slip : command.slip_end]
    lasting = command.durations[command.slip : command.slip_end]
    rate = float(np.abs(slips * lasting).sum()) / (ends - begins)
    reference, found, now, slipped = Reference(p), [], 0.0, 0.0
    number = 0
    for count, after in ((cycles, rest), (again, 0.0)):
        for _ in range(count):
            number += 1
            reference.take(aged(p, now + begins - slipped, rate, reference.x, number))
            for duration, slope in zip(command.durations, command.rates, strict=True):
                reference.segment(float(duration), float(slope) / p.actuator.gain)
            now, slipped = now + command.period, now + ends
            found.append(reference.x)
        if after:
            reference.segment(after, 0.0)
            now += after
            found.append(reference.x)
    return np.array(found)
