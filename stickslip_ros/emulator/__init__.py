# SPDX-License-Identifier: Apache-2.0
"""Simulated axes behind the protocols of real controllers, over TCP. Knows no ROS.

A new controller is a file beside these and a line in CONTROLLERS.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from stickslip_ros.base.lazy_names import lazy_names
from stickslip_ros.physics.parameters import ParameterError

if TYPE_CHECKING:
    from stickslip_ros.axis import Axis
    from stickslip_ros.emulator.controller import Controller
    from stickslip_ros.emulator.recorder import Recorder
    from stickslip_ros.emulator.server import OwnAxes, Server, ServerThread

__all__ = [
    "CONTROLLERS",
    "Controller",
    "OwnAxes",
    "Recorder",
    "Server",
    "ServerThread",
    "commands_of",
    "controller_of",
]


class Kind(NamedTuple):
    """A kind of controller."""

    module: str  #: below this room
    name: str  #: of its class, a `Controller`
    port: int  #: that its clients expect
    most_axes: int
    text: str
    tables: str = "OF"  #: how the names of its tables in the module begin


#: What help texts show, which load no controller.
CONTROLLERS = {
    "anc300": Kind(
        "anc300", "Anc300", 7230, 7, "attocube ANC300, console over TCP, password 123456"
    ),
    "scu": Kind("smaract", "Scu", 5001, 3, "SmarAct SCU, ASCII interface", "SCU"),
    "mcs": Kind("smaract", "Mcs", 5000, 18, "SmarAct MCS, ASCII interface", "MCS"),
    "mcs2": Kind("mcs2", "Mcs2", 55551, 18, "SmarAct MCS2, SCPI interface"),
    "amc": Kind("amc", "Amc", 9090, 3, "attocube AMC, JSON interface"),
    "e871": Kind("gcs", "Gcs", 50000, 1, "PI E-871, GCS 2"),
}


def kind_for(name: str, axes: int) -> Kind:
    """Return a kind of controller; ParameterError for an unknown one or too many axes."""
    if name not in CONTROLLERS:
        raise ParameterError(
            f"no controller is called {name!r}; there are: {', '.join(CONTROLLERS)}"
        )
    kind = CONTROLLERS[name]
    if not 1 <= axes <= kind.most_axes:
        raise ParameterError(f"{axes} axes for {name}; it has {kind.most_axes} at most: name fewer")
    return kind


def commands_of(name: str) -> dict[str, bool]:
    """Return every command that is known of a controller, with whether it is emulated."""
    kind = CONTROLLERS[name]
    module = import_module(f"{__name__}.{kind.module}")
    of_all, of_one = (getattr(module, f"{kind.tables}_{n}") for n in ("CONTROLLER", "CHANNEL"))
    return {one: not getattr(r, "lacking", "") for one, r in {**of_all, **of_one}.items()}


def controller_of(name: str, axes: Sequence[Axis]) -> Controller:
    """Return a controller of axes, the simulated ones themselves, not their names.

    Raises ParameterError for an unknown controller, too many axes, or what is none.
    """
    from stickslip_ros.axis import Axis

    kind = kind_for(name, len(axes))
    for axis in axes:
        if not isinstance(axis, Axis):
            raise ParameterError(f"{axis!r} is no axis; make one with stickslip_ros.Axis()")
    make = getattr(import_module(f"{__name__}.{kind.module}"), kind.name)
    return make(axes)


_PLACES = {
    "controller": "Controller",
    "recorder": "Recorder",
    "server": "OwnAxes Server ServerThread",
}
if not TYPE_CHECKING:
    __getattr__ = lazy_names(__name__, _PLACES)
