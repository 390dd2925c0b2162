# SPDX-License-Identifier: Apache-2.0
"""Serving a page on this machine until Ctrl-C, for the subcommands that have one."""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from typing import TYPE_CHECKING

from stickslip_ros.cli.options import flag, option
from stickslip_ros.errors import UsageError

if TYPE_CHECKING:
    from stickslip_ros.workbench.server import Panel


def add_page_server(parser: argparse.ArgumentParser) -> None:
    """Add --port and --no-browser."""
    option(parser, "--port", "N", "of the page (default: a free one)", int, default=0)
    flag(parser, "--no-browser", "only print the address of the page")


def serve(panel: Panel, args: argparse.Namespace, name: str) -> int:
    """Serve a page under a name until Ctrl-C; return the exit code. Raises UsageError."""
    if not 0 <= args.port <= 65535:
        raise UsageError(f"--port is {args.port}; it has to lie between 0 and 65535")
    from stickslip_ros.workbench.server import WorkbenchServer

    try:
        server = WorkbenchServer(panel, args.port)
    except OSError as error:
        raise UsageError(
            f"cannot listen on port {args.port}: {error.strerror or error}; choose another --port"
        ) from None
    with server:
        print(f"{name} at {server.address} (Ctrl-C ends it)", flush=True)
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
