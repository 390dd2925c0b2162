# SPDX-License-Identifier: Apache-2.0
"""Waveforms found by search, from parameters in any form."""

from __future__ import annotations

from typing import Any

from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.library.inputs import ParameterSource, full_set
from stickslip_ros.studies import waveform_search
from stickslip_ros.studies.waveform_search import ElongatedStep, ShapedSlip


def shape_slip(parameters: ParameterSource = None, /, **values: Any) -> ShapedSlip:
    """Return the slip in two parts that leaves the least ringing (section 4.2 of the paper).

    parameters and values are as in `simulate`. Raises ParameterError where no slip can be shaped.

    >>> import stickslip_ros as ss
    >>> found = ss.shape_slip(preload=0.4)
    >>> found.ringing_after < 0.1 * found.ringing_before
    True
    >>> run = ss.simulate(waveform="shaped", split=found.split, latency=found.latency)
    """
    with telling_when_compiling():
        return waveform_search.shape_slip(full_set(parameters, values))


def elongate_step(parameters: ParameterSource = None, /, **values: Any) -> ElongatedStep:
    """Return the hold times around the slip that give the largest step (section 4.2).

    parameters and values are as in `simulate`. Raises ParameterError.

    >>> import stickslip_ros as ss
    >>> found = ss.elongate_step(frequency=10e3)
    >>> print(f"{found.step_after / found.step_before:.1f} times the step")
    1.6 times the step
    """
    with telling_when_compiling():
        return waveform_search.elongate_step(full_set(parameters, values))
