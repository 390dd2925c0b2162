# SPDX-License-Identifier: Apache-2.0
"""The limits by which steps are found, measured and doubted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StepSettings:
    """Limits of the analysis; each name ends with the unit, or says what it is a part of."""

    # The search, see `search`.
    largest_change_of_cycles: float = 0.5  #: part of the motion, below which it counts as periodic
    shortest_stretch_periods: float = 0.3  #: that repeats and so is a candidate
    least_quality_of_best: float = 0.4  #: part of the best quality from which a period is tried

    # The match, see `matching`.
    window_before_slip_periods: float = 0.35
    window_after_slip_periods: float = 0.12
    least_amplitude: float = 0.45  #: of a slip, where the mean one has 1
    largest_amplitude: float = 2.0
    least_likeness: float = 0.5  #: squared correlation of a slip with the mean one
    largest_gap_change: float = 0.12  #: part by which distances of slips may change
    least_distance_periods: float = 0.6  #: of two slips
    least_coverage: float = 0.85  #: part of the best coverage for which a shorter period is taken
    largest_alternation: float = 0.06  #: by which cycles of a shorter period may alternate more
    largest_change_above_least: float = 0.25  #: by which they may differ more from each other
    least_persistence: float = 0.6  #: later cycles over earlier ones; ringing fades faster
    least_overtones: float = 0.01  #: part of the motion beside a sinusoid, in cycles with slips

    # Rests, see `rests`; a rise without a slip may follow the last one.
    rest_after_slip_periods: float = 1.0
    rest_before_rise_periods: float = 0.03
    shortest_rest_periods: float = 0.15

    # Ringing.
    least_ringing_to_noise: float = 3.0
    largest_frequency_error: float = 0.01  #: part of the frequency
    least_swings: float = 3.0  #: of the ringing that the fit sees
    largest_damping: float = 0.3  #: decay in an angular period
    bend_in_rest: float = 0.0005  #: part by which a contact rings off its linear frequency
    bend_in_cycle: float = 0.001
    bend_of_decay: float = 0.02  #: part by which sliding makes swings die away otherwise
    decay_error_periods: float = 0.05  #: error of a decay times the period, in which it is seen
    largest_disagreement: float = 0.02  #: part by which both frequencies may differ
    least_swings_in_cycle: float = 8.0  #: from which on a cycle shows the ringing by itself

    # Backstep.
    least_samples_a_swing: float = 4.0  #: three do not show where a swing has its deepest point
    begin_error_swings: float = 0.02  #: by which the begin of the slip may miss
    largest_backstep_error: float = 0.1  #: part of the backstep from which on it is not told

    # Doubts, see `doubts`.
    least_cycles: int = 3  #: two cycles have one distance, which nothing confirms
    least_cycles_without_ringing: int = 10  #: other motions repeat, too
    least_samples_a_cycle: float = 10.0  #: with fewer, faster drives look like slower ones
    largest_unevenness_periods: float = 0.004
    largest_unevenness_samples: float = 2.0
    largest_slip_beyond_ends: float = 0.3  #: amplitude where there should be no slip
    least_slip_at_ends: float = 0.5
    largest_move_in_rest_steps: float = 0.6
    largest_speed_to_slip: float = 1.4  #: forward, where the fastest motion back, the slip, has 1
    least_step_errors: float = 5.0  #: that a step is away from none
    largest_change_in_doubt: float = 0.5  #: part of the motion that differs from cycle to cycle


SETTINGS = StepSettings()
