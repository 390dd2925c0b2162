# SPDX-License-Identifier: Apache-2.0
"""``stickslip twin``: the model beside a recorded axis: what changed, where the next move ends."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.reporting import format_si
from stickslip_ros.cli.explore import add_page_server, serve
from stickslip_ros.cli.measurement_options import add_reading_options, reading_of
from stickslip_ros.cli.options import (
    add_parameters,
    flag,
    option,
    parameters_from,
    progress_bar,
    quantity,
    require_ros,
)
from stickslip_ros.cli.outputs import add_outputs, check_outputs, put_out
from stickslip_ros.measurement.twin.settings import ASKED, TwinSettings

if TYPE_CHECKING:
    from stickslip_ros.measurement.twin import Forecast, Twin, Update


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = (
        "Exit code 1 if the axis has changed, drifts or is unlike the model. docs/twin.md explains "
        "the method, and what it cannot know."
    )
    text = "a bag, or a table of time and position with the columns steps, amplitude, frequency"
    option(parser, "recording", "RECORDING", text, Path, nargs="?")
    flag(parser, "--page", "show it on a page of this machine; live, if there is no RECORDING")
    option(parser, "--node", "NODE", "the twin of a live page", default="/stickslip_twin")
    add_page_server(parser)
    option(parser, "--drive", "FILE.csv", "commands as a table: time,command,value", Path)
    option(parser, "--joint", "NAME", "joint to use in a bag (default: the only slider)")
    add_parameters(parser)
    for name, (unit, about) in ASKED.items():
        text = f"{about} (default: {getattr(TwinSettings, name):g} {unit})"
        option(parser, f"--{name.replace('_', '-')}", unit.upper(), text, quantity(unit))
    option(parser, "--predict-steps", "N", "say where N steps would end", int)
    option(parser, "--predict-position", "M", "say which steps would lead there", quantity("m"))
    text = "readings and what was expected"
    add_outputs(parser, "residual, step size and parameters", text)
    add_reading_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.cli.pages.twin import twin_page
    from stickslip_ros.measurement.identification.posterior import find_posterior
    from stickslip_ros.measurement.twin import Twin, TwinCommand
    from stickslip_ros.measurement.twin.recording import read_log
    from stickslip_ros.measurement.twin.story import TwinStory

    if args.recording is None:
        return _live(args)
    check_outputs(args)
    p = parameters_from(args)
    given = {name: getattr(args, name) for name in ASKED if getattr(args, name) is not None}
    settings = TwinSettings(**given)
    posterior = find_posterior(args.config) if args.config else None
    log = read_log(args.recording, reading_of(args), args.drive, args.joint)
    twin = Twin(p, settings, posterior)
    updates: list[Update] = []
    with report_compilation(), progress_bar(len(log), "following the axis") as bar:
        for one in log:
            bar.update()
            if isinstance(one, TwinCommand):
                twin.command(one)
            elif update := twin.measure(*one):
                updates.append(update)
        twin.settle()
    if not updates:
        raise UsageError(
            f"{args.recording} has no two readings that follow each other; see --units"
        )
    forecasts = _forecasts(args, twin)
    heading, name = ("time", "measured", "expected", "deviation"), args.recording.name
    rows = [update[:4] for update in updates]
    story = TwinStory.of(twin, updates, name)
    put_out(
        args, _content(twin, forecasts), lambda: "\n".join(_lines(twin, forecasts)), name,
        (heading, rows), page=lambda: twin_page(story),
    )  # fmt: skip
    if args.page:
        from stickslip_ros.cli.workbench.server import TwinPanel

        serve(TwinPanel(story), args, "twin")
    fine = twin.level[0] in ("ok", "blind") and not twin.departs and not twin.changes
    return 0 if fine else 1


def _live(args: argparse.Namespace) -> int:
    if not args.page:
        raise UsageError("give a RECORDING, or --page to see a twin that runs")
    with require_ros():
        from stickslip_ros.ros.nodes.twin_listener import TwinListener
    from stickslip_ros.cli.workbench.server import TwinPanel

    with closing(TwinListener(args.node)) as twin:
        return serve(TwinPanel(twin.story), args, "twin")


def _forecasts(args: argparse.Namespace, twin: Twin) -> list[Forecast]:
    found = []
    if args.predict_steps is not None:
        found.append(twin.predict_steps(args.predict_steps))
    if args.predict_position is not None:
        found.append(twin.predict_position(args.predict_position))
    return found


def _content(twin: Twin, forecasts: list[Forecast]) -> dict[str, Any]:
    level, reason = twin.level
    rate, deviation = twin.drift
    return {
        "level": level,
        "reason": reason,
        "stepping": twin.driven,
        "drift": {"rate": rate, "standard_error": deviation},
        "estimates": {one.name: one._asdict() for one in twin.estimates()},
        "changes": [
            {
                "told": one.told,
                "onset": one.onset,
                "step_before": one.step_before,
                "step_after": one.step_after,
                "from_the_start": one.at_start,
                "cause": one.verdict.cause if one.verdict else None,
                "posterior": dict(one.verdict.posterior) if one.verdict else {},
                "text": one.text,
            }
            for one in twin.changes
        ],
        "troubles": dict(twin.troubles),
        "predictions": [one._asdict() for one in forecasts],
    }


def _lines(twin: Twin, forecasts: list[Forecast]) -> list[str]:
    """Return the report for people."""
    level, reason = twin.level
    lines = [f"{level}: {reason}", f"seen: {format_si(twin.driven, 's')} of stepping"]
    for one in twin.estimates():
        low, high = (format_si(end, one.unit, 4, one.value) for end in (one.low, one.high))
        held = "" if one.seen else "; held, these data show too little of it"
        lines.append(f"{one.name}: {format_si(one.value, one.unit)}, {low} to {high}{held}")
    lines += [f"change: {one.text}" for one in twin.changes]
    lines += [f"{name}: {count}" for name, count in twin.troubles.items()]
    for there in forecasts:
        ends = " to ".join(format_si(end, "m", 6) for end in (there.low, there.high))
        lines.append(
            f"{there.steps} steps end at {there.end:.6g} s, {format_si(there.position, 'm', 6)} "
            f"({ends})"
        )
    return lines
