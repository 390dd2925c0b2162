# SPDX-License-Identifier: Apache-2.0
"""``stickslip explore``: a local page with sliders for the parameters of a drive."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path

from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.cli.options import add_parameters, option, parameters_from
from stickslip_ros.cli.page_server import add_page_server, serve
from stickslip_ros.parameters import Parameters


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "The page can be reached from this machine only. Ctrl-C ends it."
    add_parameters(parser)
    text = "the same as --config, such as the file that identify wrote"
    option(parser, "--params-file", "FILE.yaml", text, Path, dest="config")
    option(parser, "--measurement", "FILE", "a table or a bag to lay over the step", Path)
    add_page_server(parser)
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.compiled import report_compilation
    from stickslip_ros.workbench.curves import curves
    from stickslip_ros.workbench.overlay import Overlay
    from stickslip_ros.workbench.server import Workbench

    p, overlay = parameters_from(args), None
    if args.measurement:
        overlay = Overlay.of(measurement_of(args, args.measurement))
        named = any(text.startswith("frequency=") for text in args.assignments)
        if not named and p.drive.frequency == Parameters().drive.frequency:
            p = p.replace(frequency=float(f"{overlay.frequency:.6g}"))
    with report_compilation():
        # Compiles where that was not done, while the browser starts.
        threading.Thread(target=curves, args=(p, overlay), daemon=True).start()
        return serve(Workbench(p, overlay), args, "explore")
