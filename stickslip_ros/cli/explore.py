# SPDX-License-Identifier: Apache-2.0
"""``stickslip explore``: a local page with sliders for the parameters of a drive."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import webbrowser
from pathlib import Path

from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.cli.options import add_parameters, flag, option, parameters_from
from stickslip_ros.errors import UsageError
from stickslip_ros.parameters import Parameters


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "The page can be reached from this machine only. Ctrl-C ends it."
    add_parameters(parser)
    text = "the same as --config, such as the file that identify wrote"
    option(parser, "--params-file", "FILE.yaml", text, Path, dest="config")
    option(parser, "--measurement", "FILE", "a table or a bag to lay over the step", Path)
    option(parser, "--port", "N", "(default: a free one)", int, default=0)
    flag(parser, "--no-browser", "only print the address")
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if not 0 <= args.port <= 65535:
        raise UsageError(f"--port is {args.port}; it has to lie between 0 and 65535")
    from stickslip_ros.compiled import report_compilation
    from stickslip_ros.workbench.curves import curves
    from stickslip_ros.workbench.overlay import Overlay
    from stickslip_ros.workbench.server import Workbench, WorkbenchServer

    p, overlay = parameters_from(args), None
    if args.measurement:
        overlay = Overlay.of(measurement_of(args, args.measurement))
        named = any(text.startswith("frequency=") for text in args.assignments)
        if not named and p.drive.frequency == Parameters().drive.frequency:
            p = p.replace(frequency=float(f"{overlay.frequency:.6g}"))
    try:
        server = WorkbenchServer(Workbench(p, overlay), args.port)
    except OSError as error:
        raise UsageError(
            f"cannot listen on port {args.port}: {error.strerror or error}; choose another --port"
        ) from None
    with server, report_compilation():
        print(f"explore at {server.address} (Ctrl-C ends it)", flush=True)
        # Compiles where that was not done, while the browser starts.
        threading.Thread(target=curves, args=(p, overlay), daemon=True).start()
        if not args.no_browser and _has_screen():
            webbrowser.open(server.address)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:  # the usual end
            return 0
    return 0


def _has_screen() -> bool:
    return sys.platform in ("win32", "darwin") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
