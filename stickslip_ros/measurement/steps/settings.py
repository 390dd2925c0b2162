# SPDX-License-Identifier: Apache-2.0
"""The limits by which steps are found, measured and doubted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StepSettings:
    """Limits of the analysis; each name ends with the unit, or says what it is a part of."""

    # Slips, see `slips`.
    period_error: float = 0.02  #: part by which a period may be off; a clock by half of it
    least_amplitude: float = 0.45  #: of a slip, where the mean one has 1
    slip_scatter: float = 0.2  #: standard deviation of their sizes, at least, as part of one
    rise_scatter: float = 0.25  #: the same of the rises before them
    sure: float = 5.5  #: logarithm of how much likelier a count is than another one

    # Rests, see `fold`; a rise without a slip may follow the last one.
    rest_after_slip_periods: float = 1.0
    rest_before_rise_periods: float = 0.03
    shortest_rest_periods: float = 0.15

    # Ringing and backstep, see `ringing` and `backstep`.
    ringing_to_noise: float = 3.0
    frequency_error: float = 0.01  #: part of the frequency, at most
    least_swings: float = 3.0  #: of the ringing that the fit sees
    largest_damping: float = 0.3  #: decay in an angular period
    samples_a_swing: float = 4.0  #: three do not show where a swing has its deepest point
    backstep_error: float = 0.1  #: part of the backstep from which on it is not determined

    # Steps, see `step_fit`.
    periods_of_hum: float = 2.0  #: of the mains that a record holds where hum is allowed for
    information_of_change: float = 12.0  #: by which a change of the steps is likelier than none
    least_change: float = 0.02  #: part of a step

    # Doubts, see `doubts`.
    least_cycles: int = 3  #: two cycles have one distance, which nothing confirms
    samples_a_cycle: float = 10.0  #: with fewer, faster drives look like slower ones
    samples_a_cycle_told: float = 5.0  #: where the frequency is known
    unevenness_periods: float = 0.004
    change_of_cycles: float = 0.5  #: part of the motion, below which it counts as periodic
    step_errors: float = 5.0  #: that a step, a drift or hum is away from none
    step_error: float = 0.1  #: part of a step from which on it is not determined
    moves_in_rest: float = 0.6  #: part of a step


SETTINGS = StepSettings()
