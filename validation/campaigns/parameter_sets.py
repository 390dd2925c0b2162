# SPDX-License-Identifier: Apache-2.0
"""Sets of random parameters over all of every range: each gives a result, or a word why not.

    python -m validation.campaigns.parameter_sets [--count 20000] [--first 0]

Every row of the table takes part: law, waveform, loads, contacts, effects of the actuator and of
the surface, sensor. Numbers are drawn evenly in their logarithm, at an end of their range, as the
least that is allowed and, where nothing forbids it, as the least that a float can hold. Each set
runs three steps and a little of an axis. Within five seconds of the processor it has to give a
finite result, be refused, or end with the error of the solver's budget; and the contacts may not
give back energy, but for what rounding makes of the work done on them and, where explicit steps
integrate the law, for what its force does over the tolerance of a position: without any damping
(sigma_1 of 1e-30), `ceim_ageing` gave 0.2 of that back. A contact that weakens while it slides may
give back more (docs/friction.md).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from stickslip_ros.axis import Axis, CommandRefused
from stickslip_ros.physics.laws import LAWS
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.model.friction import has_own_rate
from stickslip_ros.physics.model.surface import Surface
from stickslip_ros.physics.model.waveforms import command_of
from stickslip_ros.physics.parameters import PARAMETERS, ParameterError, Parameters
from stickslip_ros.physics.solver import SolverError
from stickslip_ros.physics.solver.driven import simulation_of
from stickslip_ros.physics.waveforms import WAVEFORMS
from validation.campaigns.arguments import arguments
from validation.campaigns.judging import study, within
from validation.draws import corner

STEPS = 3
SECONDS = 5.0  #: of the processor, for a set
ROUNDING = 1e-9  #: of the work, that a contact may seem to give back
#: Texts that are no file and no name: what they may be
CHOICES = {
    "model": tuple(LAWS),
    "waveform": tuple(name for name in WAVEFORMS if name != "table"),
    "alpha_form": ("dupont", "printed"),
    "contact_shares": ("equal", "guide"),
    "actuator": ("linear", "hysteresis"),
}
NUMBERS = [row for row in PARAMETERS.values() if row.kind in (float, int)]
SWITCHES = [row.name for row in PARAMETERS.values() if row.kind is bool]
#: Rows of an axis that only a node reads
OF_NODE = {
    *("publish_rate", "real_time_factor", "real_time_priority", "overload_limit"),
    *("step_time", "step_cycles"),
}


def drawn(number: int) -> dict[str, Any]:
    """Return the set of a number: it follows from that alone."""
    draw = np.random.default_rng((27, number))
    values: dict[str, Any] = {
        name: str(draw.choice(choices)) for name, choices in CHOICES.items() if draw.random() < 0.5
    }
    if draw.random() < 0.4:
        values |= {"contacts": int(draw.integers(2, 17)), "contact_spread": float(draw.random())}
    values |= {name: bool(draw.integers(2)) for name in SWITCHES if draw.random() < 0.3}
    share = draw.choice([0.02, 0.05, 0.1, 0.2])
    for row in NUMBERS:
        if row.name not in OF_NODE | values.keys() and draw.random() < share:
            values[row.name] = corner(draw, row)
    return values


def outcome(values: dict[str, Any]) -> str:
    """Return "result", "refused" or "budget"; anything else is a fault of the package."""
    try:
        p = Parameters.of(values)
        simulation = simulation_of(p, Plant.of(p))
        drive_cycle = command_of(p)
        simulation.start(drive_cycle, STEPS)
        cycles = simulation.run_cycles(STEPS)
        if not np.isfinite(cycles.position).all():
            return f"positions {cycles.position}"
        # What moved through runner, load and springs: differences of it are what the heat is.
        way = float(np.abs(np.diff(cycles.position, prepend=0.0)).max())
        reach = float(np.abs(np.cumsum(drive_cycle.durations * drive_cycle.rates)).max()) + way
        speed = float(np.abs(drive_cycle.rates).max()) + way / drive_cycle.period
        plant = simulation.plant
        work = (
            plant.mass * speed**2
            + abs(plant.force) * reach
            + plant.spring * (np.abs(cycles.position).max() + reach) ** 2
            + p.friction.mu * p.friction.preload * reach
            + float(np.abs(cycles.lost).max())
        )
        contact = Plant.column(p).contact
        weakens = contact.z_s > contact.z_k or Surface.of(p.friction) is not None
        force = p.friction.mu * p.friction.preload if has_own_rate(p.friction) else 0.0
        allowed = ROUNDING * work + force * p.solver.tolerance  # in each cycle
        if cycles.lost.min() < -allowed and not weakens:
            return f"heat {cycles.lost.min():g} J of a work of {work:g} J"
        axis = Axis(p)
        axis.command("steps", STEPS)
        axis.advance(min(STEPS / p.drive.frequency, 0.01))
        if not math.isfinite(axis.state.x):
            return f"position {axis.state.x}"
    except (ParameterError, CommandRefused):
        return "refused"
    except SolverError:
        return "budget"
    return "result"


def judged(values: dict[str, Any]) -> str:
    """Return the outcome of a set, within its time; an exception is a fault."""
    return within(SECONDS, lambda: outcome(values))


def main(argv: Sequence[str] | None = None) -> int:
    """Judge sets, print the faults and how many of each outcome there were; 1 for a fault."""
    args = arguments(__doc__, argv, count=20_000, first=0)
    numbers = range(args.first, args.first + args.count)
    return study(judged, drawn, numbers, ("result", "refused", "budget"), 120.0, str)


if __name__ == "__main__":
    sys.exit(main())
