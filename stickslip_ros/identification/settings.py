# SPDX-License-Identifier: Apache-2.0
"""Every threshold of an identification, with its unit and its reason, by the stage that uses it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class RecordSettings:
    """What is told of records, how they are put into bins, and the noise and hum in them."""

    repeated: float = 1e-4  #: chance that a record of fresh samples repeats a value as often
    least_noise: float = 1e-12  #: m, of a sensor: simulated records have less, and rest at 0
    same_frequency: float = 0.01  #: part that clocks of a drive and a recorder may differ by
    ringing_over_drive: float = 2.0  #: least ratio of ringing to drive frequency
    near_hum: float = 0.05  #: part of a harmonic of the mains within which ringing may be hum
    rest_before: float = 0.05  #: periods without which the axis may have stepped before
    sensor_rate: float = 1e6  #: Hz, of a sensor with a bandwidth: lines between bend by 0.01 %
    lead_in: int = 10  #: cycles simulated before the start of the record
    changed_part: float = 0.08  #: of a step, by which alike runs differ if the axis changed
    changed_errors: float = 5.0  #: standard errors, likewise
    samples_a_swing: float = 4.0  #: of ringing: two are the least, means over slips take as many
    few_steps: int = 4  #: below which frequency and size of a run scatter too much to be trusted
    noise_factor: float = 3.0  #: a stated noise may differ so: filters of sensors do that
    beyond: float = 1.1  #: periods after a run within which a record may end with another cycle
    about_slips: float = 1.5  #: bins before and after a slip that are computed finely
    longest_step: float = 1.1  #: of the way of the actuator; no step is longer
    shortest_step: float = 1e-3  #: of that way; no drive that steps makes shorter ones
    bins_a_swing: float = 12.0  #: bins in a swing, which show its shape
    bins_a_period: float = 400.0  #: bins in a drive period where no ringing is seen
    fewest_bins: int = 3000  #: bins of a trace
    most_bins: int = 12_000  #: bins of a trace: time of a fit grows with them
    looks: int = 12  #: samples of a bin about a slip that the model is computed for
    fine_bins_a_swing: float = 16.0  #: of bins that show the noise: motion hardly differs in one
    whole: float = 0.25  #: of the usual samples of a bin; noise of fewer is more than twice as much
    spike: float = 6.0  #: robust standard deviations beyond which a residual is not noise
    rate_deviation: float = 5e-4  #: s/s, of clocks of recorders
    corner_factor: float = 3.0  #: between corner frequencies tried: a filter off by less is as good
    highest_corner: float = 5.0  #: of those of the bins: hardly any white noise is left
    order: int = 12  #: highest of the autoregressive model of what is left
    per_order: int = 50  #: residuals at least for each order
    order_gain: float = 4.0  #: by which Akaike's criterion has to fall for another order
    hum_chance: float = 1e-4  #: of a likelihood as high without hum
    hum_width: float = 1.5  #: prior deviation of its amplitudes, in terms of the amplitude found
    mains_off: float = 0.05  #: Hz, prior deviation of the frequency of the mains


@dataclass(frozen=True)
class SearchSettings:
    """Bounds and priors; where runs began, by models laid over a record; differential evolution."""

    bounds_factor: float = 10.0  #: about its starting value, a parameter without bounds
    lag_start: float = 3e-7  #: s
    lag_low: float = 1e-8  #: s
    lag_high: float = 2e-5  #: s
    lag_knee: float = 3e-7  #: s; log(lag + knee) is searched for, since a lag may be none
    lag_deviation: float = 1.15e-6  #: s, root mean square of lags up to 2 us, which are ordinary
    determined: float = 4.0  #: largest ratio of the ends of a determined interval
    on_bound: float = 1e-3  #: distance, as a logarithm, that counts as on a bound
    laid_bins: int = 600  #: evaluated
    density: float = 16.0  #: samples of the model in a swing of the ringing
    shifts: float = 16.0  #: tried in a swing
    most_shifts: int = 4000  #: in all
    at_once: int = 256  #: shifts, to bound the memory
    most_samples: int = 40_000  #: of the model
    least_ringing: float = 10.0  #: times the drive, by which models without ringing are sampled
    within: float = 0.45  #: periods that the start may be off by at most
    swings: float = 2.0  #: that the start may be off by
    periods: float = 0.06  #: of the drive, likewise
    far: float = 1.3  #: periods, where the steps were not separated well
    clearly_better: float = 0.9  #: part of the squares that another number of steps has to leave
    bins: int = 360  #: of a record that are evaluated
    cycles: float = 8.5  #: of it
    noise: float = 3e-9  #: m, that is assumed
    guard: float = 5e-6  #: s about a slip that are left out
    frequency: float = 0.02  #: part that the frequency of the ringing is known to
    decay: float = 0.7  #: logarithm, likewise
    members: int = 15  #: for each parameter
    generations: int = 100  #: at most
    impossible: float = 1e12  #: cost of parameters that make no contact
    tolerance: float = 0.01  #: part of the mean cost by which costs spread in the end
    agree: float = 3.0  #: spread of costs at which all members lie about one minimum
    distinct: float = 0.2  #: logarithm by which members differ that are handed on
    handed_on: int = 6  #: members


@dataclass(frozen=True)
class DescentSettings:
    """Least squares by Levenberg and Marquardt, profiles of the deviance, and tables of metrics."""

    damping: float = 1e-3  #: at first
    easier: float = 5.0  #: that it is divided by after a step that helped
    harder: float = 4.0  #: that it is multiplied by after one that did not
    tries: int = 8  #: of a step
    converged: float = 0.01  #: change of the deviance that ends it
    stride: float = 0.7  #: largest change of a logarithm in a step
    short: int = 4  #: rounds from every start
    followed: int = 2  #: ends that are followed on
    near: float = 0.02  #: distance (logarithm) of ends that lead to one optimum
    first: int = 15  #: rounds of those
    then: int = 10  #: rounds with the noise learnt
    learnt: int = 3  #: times that the noise is learnt
    too_much: float = 1.25  #: structure of the noise from which on it is searched for again
    searches: int = 3  #: at most
    again: int = 3  #: descents from better optima that profiles have met
    level: float = 0.95  #: of intervals
    parts: tuple[float, float] = (1.0, 0.3)  #: of a step with one parameter held that are tried
    #: Part of the rise that the next look aims at; factors by which it goes on from an end that is
    #: below the rise; parts of the way between two ends that it keeps to.
    beyond: float = 1.05
    onward: tuple[float, float] = (1.1, 2.0)
    within: tuple[float, float] = (0.1, 0.9)
    end_accuracy: float = 0.04  #: of the rise at an end, as a part of it
    profile_looks: int = 14  #: at a side
    steep: float = 1.1  #: times the root of the rise; beyond, a look is taken again from nearer by
    held_rounds: int = 12  #: of a descent with one parameter held
    held_converged: float = 0.002  #: part of the rise; a smaller decrease ends that descent
    furthest: float = math.log(30.0)  #: distance looked at, as a logarithm
    better_optimum: float = 0.5  #: deviance below the optimum that makes a better one
    unknown: float = 0.7  #: standard deviation (logarithm) of a direction that is not known
    share_named: float = 0.25  #: share of a parameter in a direction from which on it is named
    curve_deviation: float = 0.02  #: part of the median, where the table states none, to begin with
    least_deviation: float = 1e-4  #: part of the largest value, where residuals tell it
    no_value: float = 100.0  #: standard deviations that a point without a value counts
    curve_difference: float = 3e-3  #: logarithm: searches for a 0-amplitude are not smooth
    trace_difference: float = 3e-4  #: the same for traces


@dataclass(frozen=True)
class MisfitSettings:
    """Limits for tests of residuals and for messages about misfits, and the ranking of laws."""

    chance: float = 1e-3  #: probability over all tests of a fit
    phases: tuple[int, int] = (8, 120)  #: of a cycle at least and at most
    bins: int = 10  #: of a cycle at least
    per_fitted: int = 4  #: means at least for each parameter that is fitted
    fewest: int = 3  #: cycles
    parts: int = 3  #: of a run
    of_a_part: int = 2  #: cycles at least
    changed: float = 1.5  #: ratio of changing to repeating residuals from which on the axis changed
    part_changed: float = 1.0  #: parts of a run, likewise
    takes_up: float = 0.3  #: part of the residuals that an effect has to explain to be named
    named: int = 2  #: effects at most: the third best hardly ever is the cause
    sensor_bandwidth: float = 1e5  #: Hz, of a slow sensor: its effect grows with the square
    louder: float = 1.5  #: ratio of residuals in motion to those at rest that sensors may have
    at_rest: int = 100  #: bins, below which a record shows no rest
    left_out_parts: int = 3  #: of the cycles of a single run, each left out in turn
    rounds_without: int = 6  #: of a descent without one of them
    halvings: int = 8  #: of a breakaway distance above the limit
    for_a_constant: float = 4.0  #: that the score falls by for a further one, hardly by chance
    #: score above which nothing speaks for a law (K. P. Burnham, D. R. Anderson, Model Selection
    #: and Multimodel Inference, Springer 2002, section 2.6)
    unlikely: float = 10.0


@dataclass(frozen=True)
class NextSettings:
    """The runs that are candidates for the next measurement."""

    #: Parts of the largest amplitude.
    amplitudes: tuple[float, ...] = (0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
    #: Parts of the ringing's: a drive about as fast slips most of the time and shows its sliding.
    frequencies: tuple[float, ...] = (0.02, 0.04, 0.08, 0.12, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.1)
    preloads: tuple[float, ...] = (0.4, 0.7, 1.5, 2.5)  #: parts of the preload
    payloads: tuple[float, ...] = (3.0,)  #: parts of the mass
    springs: tuple[float, ...] = (0.1,)  #: parts of sigma_0
    slewrates: tuple[float, ...] = (0.2, 0.02)  #: parts of it; more may be beyond the amplifier
    rates: tuple[float, ...] = (0.5, 0.25)  #: parts of the highest sampling rate so far
    densest: float = 24.0  #: samples of a period at least
    most: int = 200  #: steps
    rest: float = 0.06  #: part of the record before and after the steps
    least_rest: float = 1.0  #: periods
    near: float = 0.25  #: of a period by which the start of a run may be found wrong
    alike: float = 1.7  #: factor that drives differ by
    samples: int = 10_000  #: of a record, where no trace was measured
    noise: float = 1e-9  #: m, likewise
    rate: float = 5e5  #: Hz, likewise
    clearly: float = 0.8  #: part of the width that another load or rate has to leave


RECORD = RecordSettings()
SEARCH = SearchSettings()
DESCENT = DescentSettings()
MISFIT = MisfitSettings()
NEXT = NextSettings()
