# SPDX-License-Identifier: Apache-2.0
"""``stickslip explore``: a local page with sliders; what serves it serves other pages, too."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.base.errors import UsageError
from stickslip_ros.cli.measurement_options import add_measurement_options, measurement_of
from stickslip_ros.cli.options import add_parameters, flag, option, parameters_from
from stickslip_ros.physics.parameters import Parameters

if TYPE_CHECKING:
    from stickslip_ros.cli.workbench.server import Panel


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    parser.epilog = "The page can be reached from this machine only. Ctrl-C ends it."
    add_parameters(parser)
    option(parser, "--measurement", "FILE", "a table or a bag to lay over the step", Path)
    add_page_server(parser)
    add_measurement_options(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.cli.workbench.curves import Overlay, curves
    from stickslip_ros.cli.workbench.server import Workbench

    p, overlay = parameters_from(args), None
    if args.measurement:
        overlay = Overlay.of(measurement_of(args, args.measurement)[0])
        named = any(text.startswith("frequency=") for text in args.assignments)
        if not named and p.drive.frequency == Parameters().drive.frequency:
            p = p.replace(frequency=float(f"{overlay.frequency:.6g}"))
    with report_compilation():
        # Compiles where that was not done, while the browser starts.
        threading.Thread(target=curves, args=(p, overlay), daemon=True).start()
        return serve(Workbench(p, overlay), args, "explore")


def add_page_server(parser: argparse.ArgumentParser) -> None:
    """Add --port and --no-browser."""
    option(parser, "--port", "N", "of the page (default: a free one)", int, default=0)
    flag(parser, "--no-browser", "only print the address of the page")


def serve(panel: Panel, args: argparse.Namespace, name: str) -> int:
    """Serve a page under a name until Ctrl-C; return the exit code. Raises UsageError."""
    if not 0 <= args.port <= 65535:
        raise UsageError(f"--port is {args.port}; it has to lie between 0 and 65535")
    from stickslip_ros.cli.workbench.server import WorkbenchServer

    try:
        server = WorkbenchServer(panel, args.port)
    except OSError as error:
        raise UsageError(
            f"cannot listen on port {args.port}: {error.strerror or error}; choose another --port"
        ) from None
    with server:
        print(f"{name} at {server.address} (Ctrl-C ends it)", flush=True)
        screen = sys.platform in ("win32", "darwin") or any(
            os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
        )
        if not args.no_browser and screen:
            webbrowser.open(server.address)
        try:
            server.serve_forever(poll_interval=0.1)
        except KeyboardInterrupt:  # the usual end
            return 0
    return 0
