# SPDX-License-Identifier: Apache-2.0
"""Where the compiled kernel finds what: indices into its flat arrays."""

# Prepared plant (float64, PLANT_SIZE): `Plant.coefficients`, then these
MASS, FORCE, SPRING, TOLERANCE, Z_SLIDE, MEMORY = range(9, 15)
PLANT_SIZE = 15

# State (float64, STATE_SIZE). The anchor is the last event; time counts from the cycle's start.
(
    START,  # time at which the pattern began, s
    TAU,  # time of the anchor since the start of its cycle, s
    X,  # runner position, m
    V,  # runner velocity, m/s
    Z,  # asperity deflection, m
    # -- the running cycle
    Z_MAX,  # largest deflection, m
    Z_MIN,  # smallest deflection, m
    LOST,  # energy lost in the contact, J
    CYCLE_X,  # position at its start, m
    # -- the last whole cycle
    LAST_STEP,  # m, nan before the first
    LAST_LOST,  # J, nan before the first
    # -- the running segment, at its start
    SEG_X,
    SEG_V,
    SEG_Z,
    IMPULSE,  # spring impulse since then, N s
    # -- backstep of the last slip
    X_TOP,  # position along the step at the start of the slip, m
    X_LOW,  # lowest position since, m
    BACKSTEP,  # the last one that was complete, m
    # -- what was asked for: the state at the time asked for
    NOW_TAU,
    NOW_X,
    NOW_V,
    NOW_Z,
    NOW_RATE,  # u', m/s
    NOW_U,  # u since the start of the cycle, m
) = range(24)
STATE_SIZE = 24

# Counters (int64, COUNTER_SIZE)
(
    COUNT,  # cycles to run, then rest
    DONE,  # cycles ended
    SEGMENT,  # of the running cycle
    TRACKING,  # 1 while the backstep of a slip is not complete
    SLIP,  # segment in which the slip begins
    SIGN,  # direction of the step
) = range(6)
COUNTER_SIZE = 6

# One row of results for each cycle (float64, ROW_SIZE)
(
    ROW_X,  # position at the end of the cycle, m
    ROW_V,  # velocity there, m/s
    ROW_Z,  # deflection there, m
    ROW_BACKSTEP,  # of the last slip whose backstep was complete by then, m (nan before)
    ROW_Z_MAX,  # largest deflection within the cycle, m
    ROW_Z_MIN,  # smallest deflection within the cycle, m
    ROW_LOST,  # energy lost in the contact during the cycle, J
) = range(7)
ROW_SIZE = 7

# One arc (float64, ARC_SIZE), from the anchor to the next event
(
    KIND,  # ELASTIC .. REST
    LENGTH,  # s
    ENDING,  # FREE .. KINK
    MIRROR,  # +1 or -1: sign that makes w positive
    ARC_X,  # start of the arc, m
    ARC_Z,
    ARC_W,  # m/s
    RATE,  # u', m/s
    LINE,  # a of the elastic arc, m
    LINE_RATE,  # b, m/s
    DELTA,  # 1/s
    KAPPA,  # 1/s^2
    NET,  # mirrored force at the start of a gliding arc, N
    LEVEL,  # z at the end where the ending fixes it, m
    PEAK_MAX,  # extremes of z within the arc, m
    PEAK_MIN,
) = range(16)
ARC_SIZE = 16

ELASTIC, SERIES, GLIDE, REST = range(4)
#: FREE: inside a branch; TURN: w = 0 is exact there; BREAKAWAY: |z| = z_ba is exact there
FREE, TURN, BREAKAWAY = range(3)
