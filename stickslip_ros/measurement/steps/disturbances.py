# SPDX-License-Identifier: Apache-2.0
"""What disturbs a measured position: drift, hum of the mains, steps that change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.settings import SETTINGS

#: Mains frequencies, Hz, and the number of harmonics of each.
MAINS, HARMONICS = (50.0, 60.0), 3


def hum_columns(
    t: Array, mains: Sequence[float], harmonics: int = HARMONICS, width: Array | float = 0.0
) -> list[Array]:
    """Return cosine and sine of each harmonic of the mains (Hz) at times t (s).

    They are means over a width (s).
    """
    found = []
    for frequency in mains:
        first = np.exp(2j * math.pi * frequency * t)
        wave = np.ones_like(first)
        for k in range(1, harmonics + 1):
            wave = wave * first
            mean = wave * np.sinc(k * frequency * np.asarray(width))
            found += [mean.real, mean.imag]
    return found


@dataclass(frozen=True)
class Disturbances:
    """Drift and hum of a measured position, of the likeliest model."""

    drift: float = 0.0  #: m/s
    drift_error: float = math.inf  #: standard error, m/s
    mains: float | None = None  #: Hz; None: no hum is seen
    waves: tuple[tuple[float, float], ...] = ()  #: cosine and sine (m) of each harmonic
    hum_error: float = math.inf  #: standard error of the amplitude, m

    duration: float = 0.0  #: of the measurement, s

    @property
    def drifts(self) -> bool:
        """Whether the drift is plainly there."""
        clear = abs(self.drift) > SETTINGS.step_errors * self.drift_error
        return clear and abs(self.drift) * self.duration > 2e-9

    @property
    def hums(self) -> bool:
        """Whether the hum is plainly there."""
        return self.hum > max(SETTINGS.step_errors * self.hum_error, 5e-10)

    @property
    def hum(self) -> float:
        """Amplitude of the strongest harmonic, m."""
        return max((math.hypot(*wave) for wave in self.waves), default=0.0)

    def at(
        self, t: Array, drift: bool = False, hum: bool = True, width: Array | float = 0.0
    ) -> Array:
        """Return drift and hum (m) at times (s), as means over a width (s).

        The drift counts from the first of the times.
        """
        total = self.drift * (t - t[0]) if drift else np.zeros_like(t)
        if self.mains is not None and hum:
            columns = np.stack(hum_columns(t, (self.mains,), width=width), axis=-1)
            total = total + columns @ np.ravel(self.waves)
        return np.asarray(total)

    def as_json(self) -> dict[str, float | None]:
        """Return drift (m/s) and hum (Hz, m) with their standard errors; None if unknown."""
        known = math.isfinite(self.drift_error)
        return {
            "position_drift": self.drift if known else None,
            "position_drift_error": self.drift_error if known else None,
            "mains": self.mains,
            "hum": self.hum if self.mains else None,
            "hum_error": self.hum_error if self.mains else None,
        }


@dataclass(frozen=True)
class Change:
    """Steps that are not the same all over a run."""

    t: float  #: when they change, s
    before: float  #: step until then, m
    after: float  #: step from then on, m
