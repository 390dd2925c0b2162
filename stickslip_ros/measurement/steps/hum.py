# SPDX-License-Identifier: Apache-2.0
"""Hum of the mains in a measurement: its frequencies, its waves, and a record without it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stickslip_ros.base.arrays import Array
from stickslip_ros.measurement.steps.record import Record

#: Mains frequencies, Hz, and the default number of harmonics of each.
MAINS, HARMONICS = (50.0, 60.0), 3
#: Prior standard deviation of the amplitudes of the fundamental, m; that of harmonic n is n times
#: smaller.
USUAL = 2e-8
#: Harmonics that are taken out; order of the drift beside them; samples that are fitted at most.
_HARMONICS, _DRIFT, _SAMPLES = 5, 5, 40_000
#: Periods of the mains that a record holds at least; least hum that is taken out, m.
_PERIODS, _LEAST = 3.0, 3e-10


def without_hum(record: Record) -> Record | None:
    """Return a record without hum of the mains that it has most of; None where none is told."""
    found = [one for one in (_without(record, mains) for mains in MAINS) if one is not None]
    best = max(found, key=lambda one: one[0], default=(0.0, None))
    return best[1] if best[0] > _LEAST else None


def _without(record: Record, mains: float) -> tuple[float, Record] | None:
    """Return the hum (m) of a frequency (Hz) and the record without it; None if it is too short."""
    if record.duration * mains < _PERIODS or mains * record.spacing > 1.0 / (3.0 * _HARMONICS):
        return None
    step = max(1, len(record.t) // _SAMPLES)
    t, x = record.t[::step], record.x[::step]
    place = 2.0 * (t - t[0]) / record.duration - 1.0
    columns = np.column_stack(
        [*hum_columns(t, (mains,), _HARMONICS), np.polynomial.legendre.legvander(place, _DRIFT)]
    )
    found, *_ = np.linalg.lstsq(columns, x, rcond=None)
    waves = hum_columns(record.t, (mains,), _HARMONICS)
    hum = np.column_stack(waves) @ found[: 2 * _HARMONICS]
    return float(np.hypot(*found[:2])), replace(record, x=record.x - hum)


def hum_columns(t: Array, mains: Sequence[float], harmonics: int = HARMONICS) -> list[Array]:
    """Return cosine and sine of each harmonic of the mains (Hz) at times t (s)."""
    found = []
    for frequency in mains:
        first = np.exp(2j * math.pi * frequency * t)
        wave = np.ones_like(first)
        for _ in range(harmonics):
            wave = wave * first
            found += [wave.real, wave.imag]
    return found
