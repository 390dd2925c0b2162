# SPDX-License-Identifier: Apache-2.0
"""``stickslip emulate``: simulated axes that answer as a real controller over TCP."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import errno
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stickslip_ros.base.errors import UsageError, ending_signals
from stickslip_ros.base.reporting import format_si
from stickslip_ros.cli.options import add_parameters, flag, option, parameters_from
from stickslip_ros.emulator import CONTROLLERS, kind_for

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis
    from stickslip_ros.emulator import OwnAxes, Server

#: Time (s) after which the page stops at the latest.
_STOPS = 0.1
_HEADS = "axis", "state", "position", "steps", "drive"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the subcommand."""
    kinds = "; ".join(f"{name}: {kind.text}" for name, kind in CONTROLLERS.items())
    parser.epilog = f"{kinds}. Ctrl-C ends it."
    parser.add_argument("controller", choices=list(CONTROLLERS))
    ports = ", ".join(f"{kind.port} for {name}" for name, kind in CONTROLLERS.items())
    option(parser, "--port", "N", f"TCP port, 0 chooses a free one (default: {ports})", int)
    text = "address to listen on; others than loopback allow network access (default: %(default)s)"
    option(parser, "--host", "HOST", text, default="127.0.0.1")
    option(parser, "--axes", "NAMES", "names of the axes (default: x,y,z; x where there is one)")
    flag(parser, "--page", "show the axes on a page of this machine; its address is printed")
    option(parser, "--record", "BAG", "record what programs do, and the axes, into a new bag", Path)
    add_parameters(parser)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    given = args.axes
    if given is None:
        given = ",".join("xyz"[: CONTROLLERS[args.controller].most_axes])
    names = [name.strip() for name in given.split(",")]
    if len(set(names)) < len(names):
        raise UsageError(f"--axes is {given}; give every axis a different name")
    kind = kind_for(args.controller, len(names))
    port = kind.port if args.port is None else args.port
    if not 0 <= port < 65536:
        raise UsageError(f"--port is {port}; it has to lie between 0 and 65535")
    from stickslip_ros.axis import Axis
    from stickslip_ros.base.compiled import report_compilation
    from stickslip_ros.emulator import OwnAxes, Server, controller_of

    axes = [Axis(parameters_from(args, axis_name=name)) for name in names]
    own, asked = OwnAxes(axes), axes[0].status.amplitude
    controller = controller_of(args.controller, axes)
    with report_compilation():
        own.begin()
    what = f"axes {', '.join(names)}: {_setting(args.config, axes[0])}"
    if axes[0].status.amplitude != asked:
        what += f" (the most of an {args.controller}, not {asked:g} V)"
    with contextlib.suppress(KeyboardInterrupt), contextlib.ExitStack() as stack:  # the usual end
        if args.record:
            from stickslip_ros.emulator import Recorder

            controller.recorder = Recorder(args.record, args.controller, axes)
            stack.enter_context(controller.recorder)
            own.forgets = False
        if args.page:
            print(f"the axes are shown at {_show(stack, what, names, own)}", flush=True)
        server = Server(controller, own.run)
        asyncio.run(_serve(server, args.host, port, args.controller, what))
    return 0


def _setting(config: Path | None, axis: Axis) -> str:
    """Return where the parameters are from and those that tell most, as the axis has them."""
    p = axis.parameters
    return (
        f"{config or 'Table 1 of the paper'}, {p.friction.model}, "
        f"preload {p.friction.preload:g} N, mass {1e3 * p.runner.mass:g} g, "
        f"amplitude {axis.status.amplitude:g} V"
    )


async def _serve(server: Server, host: str, port: int, controller: str, what: str) -> None:
    try:
        try:
            host, port = await server.start(host, port)
        except OSError as error:
            of_port = error.errno in (errno.EADDRINUSE, errno.EACCES)
            cure = (
                "--port, or 0 for a free one" if of_port else "--host, an address of this machine"
            )
            raise UsageError(
                f"cannot listen on {host} port {port}: {error.strerror or error}; "
                f"choose another {cure}"
            ) from None
        print(f"{controller} listens on {host} port {port}, {what}", flush=True)
        with _ended_by_signals(), contextlib.suppress(asyncio.CancelledError):
            await server.failed()
    finally:
        await server.close()


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Cancel the running task at the signals that ask to end, and never inside a command."""
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task
    before = {number: signal.getsignal(number) for number in ending_signals()}
    heard = [number for number, handler in before.items() if handler != signal.SIG_IGN]
    for number in heard:
        loop.add_signal_handler(number, task.cancel)
    try:
        yield
    finally:
        for number in heard:
            loop.remove_signal_handler(number)
            signal.signal(number, before[number])


def _show(stack: contextlib.ExitStack, what: str, names: Sequence[str], own: OwnAxes) -> str:
    """Serve a page with the axes until the stack is closed; return its address."""
    from threading import Thread

    from stickslip_ros.cli.workbench.server import AxesPanel, WorkbenchServer

    panel = AxesPanel(what, _HEADS, lambda: _rows(names, own))
    server = stack.enter_context(WorkbenchServer(panel))
    Thread(target=server.serve_forever, args=(_STOPS,), daemon=True).start()
    stack.callback(server.shutdown)
    return server.address


def _rows(names: Sequence[str], own: OwnAxes) -> list[tuple[str, ...]]:
    """Return a row for each axis, with the columns of `_HEADS`."""
    rows: list[tuple[str, ...]] = []
    for name, axis in zip(names, own.axes, strict=True):
        status, place = axis.status, format_si(axis.state.x, "m", 6)
        drive = f"{status.amplitude:g} V, {status.frequency:g} Hz"
        state = f"{axis.mode}, time is dropped, {own.late}" if own.late else axis.mode
        rows.append((name, state, place, str(status.step_count), drive))
    return rows
