# SPDX-License-Identifier: Apache-2.0
"""A runner on several contacts, left to SciPy's DOP853 between the events of its contacts.

Where w turns, or a contact gets to z_ba or z_ss, the integration is restarted with the equations
that hold from there on. Nothing of it is shared with the package but the constants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip_ros.model import Contact, DriveCycle, Plant

_NM, _SPEED = 1e-9, 1e-4
#: So near (nm) to a border a contact has reached it, and so slow (in _SPEED) w is 0; events are
#: found to 1e-15 s
_NEAR = 1e-6


class Reference:
    """The runner of a plant, from rest."""

    def __init__(self, plant: Plant) -> None:
        """Take the constants."""
        self.plant, self.contacts = plant, plant.contacts
        self.y = np.zeros(2 + len(self.contacts))  # x (nm), v (_SPEED), z (nm)
        self.lost = 0.0  # J

    def _law(self, k: int, sign: float) -> Callable[[float], float]:
        """Return alpha z / z_lim of contact k as a function of z (m), while w keeps its sign."""
        c: Contact = self.contacts[k]
        z = sign * self.y[2 + k] * _NM
        if z < c.z_ba - _NEAR * _NM:
            return lambda z: 0.0
        if z > c.z_ss + _NEAR * _NM or (z > c.z_ss - _NEAR * _NM and c.z_k > c.z_ss):
            return lambda z: z / c.z_k
        middle, width = 0.5 * (c.z_ss + c.z_ba), c.z_ss - c.z_ba
        return lambda z: 0.5 * (1.0 + math.sin(math.pi * (abs(z) - middle) / width)) * z / c.z_k

    def _forces(self, y: NDArray[np.float64], w: float, laws: Any) -> tuple[float, list[float]]:
        """Return F (N) and z' of each contact (m/s)."""
        total, rates = 0.0, []
        for c, z, law in zip(self.contacts, y[2:] * _NM, laws, strict=True):
            rates.append(w - abs(w) * law(z))
            total += c.sigma_0 * z + c.sigma_1 * rates[-1] + c.sigma_2 * w
        return total, rates

    def _piece(self, duration: float, rate: float, longest: float) -> float:
        """Go on with u' = rate (m/s) to the next event or for a duration (s); return how long."""
        plant, stuck = self.plant, [lambda z: 0.0] * len(self.contacts)
        w = self.y[1] * _SPEED - rate
        if abs(w) < _NEAR * _SPEED:
            self.y[1], w = rate / _SPEED, 0.0
        force = self._forces(self.y, 0.0, stuck)[0]
        net = plant.force - plant.spring * self.y[0] * _NM - force
        sign = math.copysign(1.0, w if w else net)
        laws = [self._law(k, sign) for k in range(len(self.contacts))]

        def rates(_: float, y: NDArray[np.float64]) -> list[float]:
            w = y[1] * _SPEED - rate
            force, z_rates = self._forces(y, w, laws)
            push = plant.force - plant.spring * y[0] * _NM - force
            return [
                y[1] * _SPEED / _NM, push / plant.mass / _SPEED, *(z / _NM for z in z_rates)
            ]  # fmt: skip

        events: list[Any] = [lambda _, y: sign * (y[1] - rate / _SPEED)]
        events[0].direction = -1.0
        for k, c in enumerate(self.contacts):
            z = sign * self.y[2 + k]
            for border in (c.z_ba / _NM, c.z_ss / _NM):
                if abs(z - border) > _NEAR:
                    events.append(lambda _, y, k=k, border=border: sign * y[2 + k] - border)
                    events[-1].direction = 1.0 if z < border else -1.0
        for event in events:
            event.terminal = True
        found = solve_ivp(
            rates, (0.0, duration), self.y, "DOP853", events=events, rtol=1e-11, atol=1e-11,
            max_step=longest,
        )  # fmt: skip
        assert found.success
        self.y = found.y[:, -1].copy()
        return float(found.t[-1])

    def segment(self, duration: float, rate: float) -> None:
        """Let the actuator move at a rate (m/s) for a duration (s)."""
        longest = min(3e-6, 1e-9 / abs(rate)) if abs(rate) > 1e-3 else 3e-6
        while duration > 0.0:
            gone = self._piece(duration, rate, longest)
            duration = duration - gone if gone < duration else 0.0


def follow(plant: Plant, drive_cycle: DriveCycle, cycles: int) -> tuple[Any, Any]:
    """Return x (m) at the end of each cycle from rest, and the deflections (m) at the last end."""
    reference, x = Reference(plant), []
    for _ in range(cycles):
        for duration, rate in zip(
            drive_cycle.durations.tolist(), drive_cycle.rates.tolist(), strict=True
        ):
            reference.segment(duration, rate)
        x.append(reference.y[0] * _NM)
    return np.array(x), reference.y[2:] * _NM
