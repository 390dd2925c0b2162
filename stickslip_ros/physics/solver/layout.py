# SPDX-License-Identifier: Apache-2.0
"""Memory of the compiled kernel: a plant, an axis and an arc, each a record with named fields.

Compiled and plain code use the same names. Python calls the kernel with float64 buffers, which
costs a tenth of the time of passing a record; `kernel_in` and `plant_in` return the records inside.
A record does not keep its buffer alive: the caller of the kernel has to hold it.

A runner on several contacts has another buffer, an array of CONTACT_RECORD. With one contact it is
None, and the code for several contacts is not compiled, nor that for one where there are several: a
branch of ``if contacts is None`` that the type of an argument excludes falls away.
"""

from __future__ import annotations

from functools import cache
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled, records_in
from stickslip_ros.physics.laws import OWN_CONSTANTS
from stickslip_ros.physics.laws.law import Contact

#: Order of the Taylor polynomials, and the rows that `taylor.expand` fills
ORDER, ROWS = 10, 10
#: Points on the way from z_ba to steady sliding, and numbers of each: the path r, z, the
#: integral Z1 of z over r, and the integrals of Z1, z^2, r Z1, Z1^2, z^2 Z1, r z^2 (powers of m)
SLIDE_POINTS, SLIDE_SIZE = 40, 9
#: Chebyshev coefficients of one function
NODES = 20


def _record(*fields: tuple[Any, ...]) -> np.dtype[Any]:
    names = [name for name, *_ in fields]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(
            f"{', '.join(twice)}: a constant of a law has the name of a field of the solver, or of "
            "a constant of another law; call it otherwise"
        )
    return np.dtype((np.record, list(fields)))


def open_record(buffer: Array, record: np.dtype[Any]) -> np.void:
    """Return the record at the start of a buffer, for Python: fields by ["name"]."""
    return buffer[: record.itemsize // 8].view(plain_dtype(record))[0]


@cache
def plain_dtype(record: np.dtype[Any]) -> np.dtype[Any]:
    """Return the dtype of the same fields that Python reads quickly."""
    return np.dtype([(name, record[name]) for name in record.names or ()])


def _numbers(kind: str, names: str) -> list[tuple[str, str]]:
    return [(name, kind) for name in names.split()]


#: The constants of a contact, under the names that `Contact` has for them
_CONTACT = list(get_type_hints(Contact).items())

#: Inputs, filled by name, then the constants that `plants.derive_constants` fills
PLANT = _record(
    *_CONTACT,
    # the runner: kg, N, N/m
    *_numbers("f8", "mass force spring"),
    ("tolerance", "f8"),  # error in position allowed per cycle, m
    ("z_slide", "f8"),  # |z| of fast steady sliding, m; nan if it depends on the side
    # nearing it along the path: the rate, 1/m, and the distance from where on that rate holds, m
    *_numbers("f8", "approach_rate approach_reach"),
    ("v_edge", "f8"),  # speed above which the Stribeck curve is flat, m/s; 0 if there is none
    ("slides", "i8"),  # 1 if the load can keep the runner sliding
    ("inv_omega", "f8"),  # 1 / angular frequency, s: error in position for an error in speed
    # the elastic contact as an oscillator, see `oscillator.Oscillator`: 1/s, 1/s^2, 1/s
    *_numbers("f8", "delta kappa omega"),
    # -- precomputed, see `tables.py`
    ("precomputed", "i8"),  # 0 not tried yet, 1 the tables hold, -1 they cannot be used
    ("burst_top", "f8"),  # fastest burst in the table, m/s
    ("slide_count", "i8"),  # points of the slide in use
    ("slide", "f8", (SLIDE_POINTS, SLIDE_SIZE)),
    # swings and bursts: deflection, time and path; [0] for z > 0, [1] for z < 0. A law that is
    # plastic throughout has swings only, from any distance to rest: [0] above it, [1] below
    ("swing_from", "f8", (2,)),  # least |z| of a swing that goes plastic, m
    ("swing_top", "f8", (2,)),  # root of the range of |z| above it; or the range of distances, m
    ("swing", "f8", (2, 3, NODES)),
    ("burst", "f8", (2, 3, NODES)),
)

#: The state of one axis. The anchor is the last event; time counts from the cycle's start.
STATE = _record(
    ("start", "f8"),  # time at which the drive cycle began, s
    ("level", "f8"),  # u at the start of the running cycle, m
    ("shift", "f8"),  # change of u over a cycle, m: 0 for a closed drive cycle
    # -- the anchor
    ("tau", "f8"),  # time since the start of its segment, s
    ("since", "f8"),  # time from the start of the cycle to that of the segment, s
    *_numbers("f8", "x v z"),  # runner position, m, velocity, m/s, asperity deflection, m
    *_numbers("f8", "rate bend"),  # u', m/s, and u'', m/s^2
    # -- the running cycle
    *_numbers("f8", "z_max z_min"),  # extreme deflections, m
    ("friction_work", "f8"),  # friction work: energy lost in the contact, J
    *_numbers("f8", "cycle_x cycle_v cycle_z"),  # at its start; cycle_z nan if the plant changed
    *_numbers("f8", "x_min x_max"),  # extreme positions at its events, m
    ("slid", "f8"),  # distance (m) that the contact has slid, in solved cycles, since the start
    ("v_most", "f8"),  # largest speed at an event since this was set to 0, m/s
    # -- the last whole cycle; step and friction work are nan before the first
    *_numbers("f8", "last_step last_friction_work last_z_max last_z_min last_x_min last_x_max"),
    # -- the account of energy, opened at the start of the segment or where the plant changed
    *_numbers("f8", "open_tau open_x open_v open_z"),
    ("impulse", "f8"),  # of the spring since then, N s
    # -- backstep of the last slip, along the step
    ("x_top", "f8"),  # position at the start of the slip, m
    ("x_low", "f8"),  # lowest position since, m
    ("backstep", "f8"),  # the last one that was complete, m
    # -- results: the state at t_end
    *_numbers("f8", "now_x now_v now_z now_rate now_u"),
    # -- counters
    *_numbers("i8", "count done segment"),  # cycles to run, cycles ended, segment of the cycle
    ("tracking", "i8"),  # 1 while the backstep of a slip is not complete
    *_numbers("i8", "slip slip_end"),  # segment in which the slip begins, segment that follows it
    ("sign", "i8"),  # direction of the step
    ("steady", "i8"),  # 1 while cycles are equal
    ("stopped", "i8"),  # which stop holds the runner: -1 the lower, 1 the upper, 0 none
    ("hits", "i8"),  # on stops so far
    *_numbers("i8", "now_segment now_tracking"),  # at the time asked for
    ("trial", "f8"),  # see ARC
    ("stalled", "i8"),  # arcs without a length, one after the other
)

#: What a call of the kernel is asked for, and its budget
REQUEST = _record(
    ("t_end", "f8"),  # advance to this time, s
    ("stop_cycle", "i8"),  # or to the end of this cycle
    ("cut", "i8"),  # 1: t_end becomes an event itself
    ("replay", "i8"),  # 1 if equal cycles are repeated without solving
    # arcs are counted in ``spent``; at ``allowance`` a call returns unfinished
    *_numbers("i8", "spent allowance unfinished"),
    ("previewing", "i8"),  # 1 while the copy of the state is on its way to t_end
)

#: Travel stops, see `stops.py`: m, infinite where there is none
STOPS = _record(
    *_numbers("f8", "low high"),
    *_numbers("f8", "near_low near_high"),  # no arc that begins between these can reach a stop
)

#: Numbers in the row of results of a cycle, see `event_loop.write_row`
ROW_SIZE = 5

#: One arc: the motion from the anchor to the next event
ARC = _record(
    ("kind", "i8"),  # ELASTIC .. STIFF
    ("cost", "i8"),  # cost in the budget, in arcs
    ("length", "f8"),  # s
    ("mirror", "f8"),  # +1 or -1: sign that makes w positive
    *_numbers("f8", "x z w rate"),  # at its start: m, m, m/s, and u' in m/s
    # u'', m/s^2, the load less what accelerates the runner along with the actuator, N, and the rate
    # of the line that stands for the actuator at the spring, m/s
    *_numbers("f8", "bend force pulled"),
    *_numbers("f8", "line line_rate"),  # a (m) and b (m/s) of an elastic arc
    # of a gliding arc: mirrored force at the start, N; where z tends to, m, and how fast, 1/m
    *_numbers("f8", "net z_slide approach_rate"),
    *_numbers("f8", "z_end w_end"),  # m, m/s
    ("path", "f8"),  # integral of w over the arc, m
    *_numbers("f8", "z_max z_min"),  # extremes of z within the arc, m
    # step (s) to try where the way is stiff; below 0, so many arcs until the next try
    ("trial", "f8"),
    ("weight", "f8"),  # time by which an error in speed counts as one in position, s
    ("holds", "i8"),  # 1: it is the motion from the anchor on, and need not be found again
    ("hit", "i8"),  # the stop it ends at: -1 the lower, 1 the upper, 0 none
    ("work", "f8", (ROWS, ORDER + 1)),  # coefficients of a Taylor arc
)

ELASTIC, TAYLOR, GLIDE, REST, TABULATED, STIFF = range(6)
#: FREE: inside a branch; TURN: w = 0 is exact there; BREAKAWAY: |z| = z_ba is exact there
FREE, TURN, BREAKAWAY = range(3)

#: Functions of time that a series keeps for a contact: z, cosine and sine of alpha, z'/w
CONTACT_SERIES = 4

#: One of several contacts under the runner
CONTACT_RECORD = _record(
    *_CONTACT,
    *_numbers("f8", " ".join(OWN_CONSTANTS)),  # that laws have alone
    # its deflection, m: at the anchor, at the end of the arc, at the time asked for, and at the
    # start of the cycle; the same of the second state of its law
    *_numbers("f8", "z z_end now_z cycle_z"),
    *_numbers("f8", "second second_end now_second cycle_second"),
    ("branch", "i8"),  # within the arc: STICKS, GRADED or PLASTIC
    ("series", "f8", (CONTACT_SERIES, ORDER + 1)),  # coefficients within the arc, mirrored
)

STICKS, GRADED, PLASTIC = range(3)

#: An axis's buffer: its state, what is asked of it, its stops, the present arc, a part of a
#: tabulated one, the plant of a runner that a stop holds, and a copy of the state for a preview
KERNEL = _record(
    ("state", STATE),
    ("request", REQUEST),
    ("stops", STOPS),
    ("arc", ARC),
    ("part", ARC),
    ("held", PLANT),
    ("preview", STATE),
)

PLANT_SIZE, CONTACT_SIZE, KERNEL_SIZE = (d.itemsize // 8 for d in (PLANT, CONTACT_RECORD, KERNEL))

#: Whether a field of state, request or stops is a whole number, and its place in the buffer
_PLACES = {
    name: (kind == np.int64, (start + place) // 8)
    for part, (record, start, *_) in (KERNEL.fields or {}).items()
    if part in ("state", "request", "stops")
    for name, (kind, place, *_) in (record.fields or {}).items()
}


class Fields:
    """The fields of state, request and stops of an axis by ["name"], for Python.

    They cost 0.1 us each, a quarter of those of a record of NumPy.
    """

    __slots__ = ("_views",)

    def __init__(self, buffer: Array) -> None:
        """Look into the buffer of an axis (KERNEL_SIZE,)."""
        self._views: tuple[Any, Any] = buffer.data, buffer.view(np.int64).data

    def __getitem__(self, name: str) -> Any:
        """Return a field: a float or an int."""
        whole, place = _PLACES[name]
        return self._views[whole][place]

    def __setitem__(self, name: str, value: float) -> None:
        """Change a field."""
        whole, place = _PLACES[name]
        self._views[whole][place] = value


@compiled
def plant_in(buffer: NDArray) -> np.record:
    """Return the plant in a buffer (PLANT_SIZE,)."""
    return records_in(buffer, PLANT)[0]


@compiled
def kernel_in(buffer: NDArray) -> np.record:
    """Return what a KERNEL record says of an axis, in its buffer (KERNEL_SIZE,)."""
    return records_in(buffer, KERNEL)[0]


@compiled
def contacts_in(buffer: NDArray | None, preview: bool) -> Any:
    """Return the contacts in their buffer (2 contacts CONTACT_SIZE,), or their preview copies.

    None for one contact.
    """
    if buffer is None:
        return None
    half = len(buffer) // 2
    part = buffer[half:] if preview else buffer[:half]
    return records_in(part, CONTACT_RECORD)
