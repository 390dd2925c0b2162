# SPDX-License-Identifier: Apache-2.0
"""Step elongation: holds before and after the slip win the elastic deflection back (section 4.2).

It works at high frequencies, where a hold catches the runner while it still rings, and with a
runner in motion: steps are judged once they have settled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import drive_of, plant_of
from stickslip_ros.parameters import ParameterError, Parameters
from stickslip_ros.studies.operating_points import batch_of

#: Cycles from rest, and how many of them at the end a step is averaged over.
_CYCLES, _MEAN = 300, 50
#: Holds tried at first, shares of the period, and the most that both may take.
_HOLDS, _MOST = np.linspace(0.0, 0.9, 19), 0.95
#: Each further search looks at so many holds each way, between the neighbours of the best.
_FINER, _SEARCHES = 5, 4
#: m by which a step has to be larger to be a better one: what a blocked drive still creeps is less.
_GAIN = 1e-13


@dataclass(frozen=True)
class ElongatedStep:
    """A step with holds next to one without; lengths in m."""

    hold_before: float  #: share of the period
    hold_after: float  #: share of the period
    step_before: float  #: settled step size of the same slip without holds
    step_after: float  #: settled step size with the holds


def elongate_step(p: Parameters) -> ElongatedStep:
    """Find the hold times that give the largest step; none if no hold gives a larger one.

    The slip stays as it is: in one part, or in two if p shapes it. Raises ParameterError for other
    waveforms and where the slip is impossible without holds.
    """
    if p.drive.waveform not in ("sawtooth", "hold", "shaped"):
        raise ParameterError(
            f"waveform is {p.drive.waveform}; the slip of sawtooth, hold and shaped can have holds"
        )
    held = p.replace(waveform="hold") if p.drive.waveform == "sawtooth" else p
    plain = held.replace(hold_before=0.0, hold_after=0.0)
    plant_of(plain)
    drive_of(plain)
    before, after = _grid(_HOLDS, _HOLDS)
    width = float(_HOLDS[1])
    step_before = float(elongation_map(plain, np.zeros(1), np.zeros(1))[0])
    best, step = (0.0, 0.0), step_before
    for _ in range(_SEARCHES):
        steps = elongation_map(held, before, after)
        if np.isfinite(steps).any() and np.nanmax(steps) > step + _GAIN:
            k = int(np.nanargmax(steps))
            best, step = (float(before[k]), float(after[k])), float(steps[k])
        around = np.linspace(-width, width, _FINER)
        before, after = _grid(*(np.clip(hold + around, 0.0, _HOLDS[-1]) for hold in best))
        width *= 2.0 / (_FINER - 1)
    return ElongatedStep(*best, step_before, step)


def elongation_map(
    p: Parameters, before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the settled step (m) for each pair of holds (points,); nan where they do not fit."""
    held = p.replace(hold_before=before, hold_after=after)
    batch, possible = batch_of(held, len(before), 1)
    position, _ = batch.run(_CYCLES, possible)
    return np.asarray((position[:, -1] - position[:, -1 - _MEAN]) / _MEAN)


def _grid(
    before: NDArray[np.float64], after: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return all pairs that leave some of the period, each (points,)."""
    a, b = (one.ravel() for one in np.meshgrid(before, after, indexing="ij"))
    fits = a + b <= _MOST
    return a[fits], b[fits]
