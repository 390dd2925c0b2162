# SPDX-License-Identifier: Apache-2.0
"""Where the compiled kernel finds what: indices into its flat arrays."""

# Prepared plant (float64, PLANT_SIZE): `Plant.coefficients`, then what follows from them
(
    MASS,
    FORCE,
    SPRING,
    TOLERANCE,  # error in position allowed per cycle, m
    Z_SLIDE,  # |z| of steady sliding, m; nan if it depends on the speed
    MEMORY,  # 1 / angular frequency, s: what an error in velocity comes to in position
    DELTA,  # of the elastic contact, 1/s
    KAPPA,  # 1/s^2
    OMEGA,  # 1/s, see `swing_rate`
    # -- known ahead, see `known.py`
    KNOWN,  # 0 not tried yet, 1 the tables hold, -1 they cannot be used
    BURST_TOP,  # fastest burst in the table, m/s
    SLIDE_COUNT,  # points of the slide
) = range(10, 22)
# Points on the way from z_ba to steady sliding, each with the path r, z, the integral Z1 of z over
# r, and the integrals of Z1, z^2, r Z1, Z1^2, z^2 Z1 and r z^2 (powers of m)
SLIDE, SLIDE_SIZE, SLIDE_POINTS = 22, 9, 40
# Each of the two sides, z > 0 and z < 0: threshold and range of its swings, then for swings and
# bursts the coefficients of deflection, time and path
SIDES = SLIDE + SLIDE_SIZE * SLIDE_POINTS
NODES = 16
SWING_FROM, SWING_TOP, SWING, BURST = 0, 1, 2, 2 + 3 * NODES
SIDE_SIZE = 2 + 6 * NODES
PLANT_SIZE = SIDES + 2 * SIDE_SIZE

# State (float64, STATE_SIZE). The anchor is the last event; time counts from the cycle's start.
(
    START,  # time at which the pattern began, s
    LEVEL,  # u at the start of the running cycle, m
    SHIFT,  # what u gains over a cycle, m: 0 of a pattern that closes
    TAU,  # time of the anchor since the start of its cycle, s
    X,  # runner position, m
    V,  # runner velocity, m/s
    Z,  # asperity deflection, m
    # -- the running cycle
    Z_MAX,  # largest deflection, m
    Z_MIN,  # smallest deflection, m
    LOST,  # energy lost in the contact, J
    CYCLE_X,  # position at its start, m
    CYCLE_V,  # velocity there, m/s
    CYCLE_Z,  # deflection there, m; nan if the plant has changed since
    # -- the last whole cycle
    LAST_STEP,  # m, nan before the first
    LAST_LOST,  # J, nan before the first
    LAST_Z_MAX,  # m
    LAST_Z_MIN,  # m
    # -- the running segment, at its start or where the plant changed within
    SEG_TAU,  # s since the start of the segment
    SEG_X,
    SEG_V,
    SEG_Z,
    IMPULSE,  # spring impulse since then, N s
    # -- backstep of the last slip
    X_TOP,  # position along the step at the start of the slip, m
    X_LOW,  # lowest position since, m
    BACKSTEP,  # the last one that was complete, m
    # -- travel stops, see `stops.py`
    LOW,  # the lower one, m; -inf if there is none
    HIGH,  # the upper one, m; inf if there is none
    NEAR_LOW,  # no arc that begins and ends above this, m, gets to the lower one
    NEAR_HIGH,  # the same for the upper one, m
    X_MIN,  # lowest and highest position at an event of the running cycle, m
    X_MAX,
    LAST_X_MIN,  # of the last whole cycle, m
    LAST_X_MAX,
    # -- what was asked for: the state at the time asked for
    NOW_TAU,
    NOW_X,
    NOW_V,
    NOW_Z,
    NOW_RATE,  # u', m/s
    NOW_U,  # m
) = range(39)
STATE_SIZE = 39

# Counters (int64, COUNTER_SIZE)
(
    COUNT,  # cycles to run, then rest
    DONE,  # cycles ended
    SEGMENT,  # of the running cycle
    TRACKING,  # 1 while the backstep of a slip is not complete
    SLIP,  # segment in which the slip begins
    SLIP_END,  # segment that follows the slip
    SIGN,  # direction of the step
    REPLAY,  # 1 if cycles that begin alike need not be solved again
    STEADY,  # 1 while they do
    STOPPED,  # which stop holds the runner: -1 the lower, 1 the upper, 0 none
    HITS,  # on stops so far
    NOW_SEGMENT,  # segment and tracking at the time asked for
    NOW_TRACKING,
) = range(13)
COUNTER_SIZE = 13

# One row of results for each cycle (float64, ROW_SIZE)
(
    ROW_X,  # position at the end of the cycle, m
    ROW_BACKSTEP,  # of the last slip whose backstep was complete by then, m (nan before)
    ROW_Z_MAX,  # largest deflection within the cycle, m
    ROW_Z_MIN,  # smallest deflection within the cycle, m
    ROW_LOST,  # energy lost in the contact during the cycle, J
) = range(5)
ROW_SIZE = 5

# One arc (float64, ARC_SIZE), from the anchor to the next event
(
    KIND,  # ELASTIC .. KNOWN_AHEAD
    LENGTH,  # s
    MIRROR,  # +1 or -1: sign that makes w positive
    ARC_X,  # start of the arc, m
    ARC_Z,
    ARC_W,  # m/s
    RATE,  # u', m/s
    LINE,  # a of the elastic arc, m
    LINE_RATE,  # b, m/s
    NET,  # mirrored force at the start of a gliding arc, N
    Z_END,  # at the end, m
    W_END,  # m/s
    PATH,  # integral of w over the arc, m
    PEAK_MAX,  # extremes of z within the arc, m
    PEAK_MIN,
) = range(15)
ARC_SIZE = 15

ELASTIC, SERIES, GLIDE, REST, KNOWN_AHEAD = range(5)
#: FREE: inside a branch; TURN: w = 0 is exact there; BREAKAWAY: |z| = z_ba is exact there
FREE, TURN, BREAKAWAY = range(3)
