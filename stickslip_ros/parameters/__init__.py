# SPDX-License-Identifier: Apache-2.0
"""The one table of parameters: name, default, unit, range, description, mutability.

Command line, YAML files, ROS descriptors, documentation and bag snapshots all read it. It knows no
physics and no ROS: what a value means is said in ``model/``, how it is declared in ``ros/``.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from stickslip_ros.errors import StickslipError

Value = float | int | str | bool
Values = dict[str, Any]


class ParameterError(StickslipError, ValueError):
    """A parameter that cannot be used; the message names the value, the limit and the cure."""


@dataclass(frozen=True)
class Parameter:
    """One row of the table.

    ``low`` and ``high`` bound numbers (both included); ``mutable`` says whether a running axis
    takes a new value with its next cycle; a text has to match ``pattern``, if there is one.
    """

    name: str
    default: Value
    unit: str
    low: float
    high: float
    description: str
    mutable: bool = True
    pattern: str = ""

    def check(self, value: object) -> Value:
        """Return ``value`` in the type of the default, or raise ParameterError."""
        wanted = type(self.default)
        if wanted is float and type(value) is int:
            value = _as_float(value)
        if type(value) is not wanted:
            raise ParameterError(self._type_message(value))
        if isinstance(value, int | float) and not isinstance(value, bool):
            if not math.isfinite(value):
                raise ParameterError(f"{self.name} is {value}; it has to be a finite number")
            if not self.low <= value <= self.high:
                unit = f" {self.unit}" if self.unit else ""
                raise ParameterError(
                    f"{self.name} is {value:g}{unit}; "
                    f"it has to lie between {self.low:g} and {self.high:g}{unit}"
                )
        if self.pattern and not re.fullmatch(self.pattern, str(value)):
            raise ParameterError(
                f"{self.name} is {value!r}; it has to be a letter, then letters, digits and _"
            )
        return value  # type: ignore[return-value]

    def parse(self, text: str) -> Value:
        """Read a value from text as typed on a command line; raise ParameterError."""
        if isinstance(self.default, str):
            return self.check(text)
        try:
            if isinstance(self.default, bool):
                return {"true": True, "false": False}[text.lower()]
            return self.check(int(text) if isinstance(self.default, int) else float(text))
        except (KeyError, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            raise ParameterError(self._type_message(text)) from None

    def _type_message(self, value: object) -> str:
        wanted = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
        hint = ""
        if isinstance(self.default, float) and isinstance(value, str):
            hint = " (in YAML write 1.0e-6, not 1e-6)"
        return f"{self.name} is {value!r}; it has to be {wanted[type(self.default)]}{hint}"


_INF = math.inf
_TABLE = (
    # Friction law
    Parameter("model", "ceim", "", 0, 0, "friction law: see stickslip simulate --help"),
    Parameter("preload", 0.4, "N", 1e-3, 1e3, "normal force f that a load cell reads"),
    Parameter("mu", 0.2, "", 1e-3, 10.0, "friction coefficient of the CEIM, Eq. 16"),
    Parameter(
        "preload_ratio",
        1.0,
        "",
        1e-3,
        1e3,
        "normal force of the law per preload (section 5.2): 1 as in the paper, 2.83 as in Table 5",
    ),
    Parameter("mu_s", 0.3, "", 1e-3, 10.0, "static friction coefficient, Eq. 4"),
    Parameter("mu_k", 0.2, "", 1e-3, 10.0, "kinetic friction coefficient, Eq. 4"),
    Parameter("v_stribeck", 1e-3, "m/s", 1e-6, 1e3, "Stribeck velocity, Eq. 4"),
    Parameter("sigma_0", 0.0, "N/m", 0.0, 1e12, "asperity stiffness; 0 takes the law's own value"),
    Parameter("sigma_0_slope", 5e6, "1/m", 0.0, 1e12, "o of Eq. 14, stiffness per preload"),
    Parameter("sigma_0_offset", 7e6, "N/m", 0.0, 1e12, "p of Eq. 14, stiffness without preload"),
    Parameter(
        "sigma_0_cap", 0.0, "N", 0.0, 1e3, "preload above which Eq. 14 stays constant; 0 for never"
    ),
    Parameter(
        "sigma_0ss", 0.0, "N/m", 0.0, 1e12, "sigma_0,ss of Eq. 16; 0 takes the law's own value"
    ),
    Parameter("sigma_1", 5.0, "N s/m", 0.0, 1e6, "asperity damping, Eq. 1"),
    Parameter("sigma_2", 0.0, "N s/m", 0.0, 1e6, "viscous friction, Eq. 1"),
    Parameter("z_ba", 0.0, "m", 0.0, 1e-3, "breakaway distance; 0 takes the law's own value"),
    Parameter("z_ba_slope", 2e-8, "m/N", 0.0, 1e-3, "a of Eq. 13, breakaway distance per preload"),
    Parameter("z_ba_offset", 1e-8, "m", 0.0, 1e-3, "b of Eq. 13, breakaway without preload"),
    Parameter("z_ss", 0.0, "m", 0.0, 1e-3, "steady-state deflection; 0 takes the law's own value"),
    Parameter(
        "alpha_form",
        "dupont",
        "",
        0,
        0,
        "dupont: sine of |z| in alpha; printed: of z, as the paper prints it",
        pattern="dupont|printed",
    ),
    # Runner and loads
    Parameter("mass", 4e-3, "kg", 1e-6, 1e3, "mass of the runner"),
    Parameter("payload", 0.0, "kg", 0.0, 1e3, "mass carried by the runner"),
    Parameter("force", 0.0, "N", -1e3, 1e3, "constant external force on the runner"),
    Parameter(
        "spring",
        0.0,
        "N/m",
        0.0,
        1e9,
        "spring (force sensor) pushed from 0; below 1e-3 counts as none",
    ),
    Parameter("inclination", 0.0, "rad", -math.pi, math.pi, "angle of +x above the horizontal"),
    # Actuator and drive
    Parameter("gain", 160e-9 / 300.0, "m/V", 1e-12, 1e-3, "actuator deflection per volt"),
    Parameter("max_voltage", 300.0, "V", 1e-3, 1e4, "largest amplitude the amplifier gives"),
    Parameter(
        "min_voltage", 0.0, "V", -1e4, 0.0, "lowest level that does not depolarise the actuator"
    ),
    Parameter("actuator", "linear", "", 0, 0, "linear or hysteresis"),
    Parameter(
        "hysteresis", 0.15, "", 0.0, 0.4, "width of the actuator's full loop, share of its stroke"
    ),
    Parameter("hysteresis_file", "", "", 0, 0, "identified loop, instead of hysteresis"),
    Parameter("max_frequency", 1e5, "Hz", 1e-3, 1e7, "highest drive frequency"),
    Parameter("slewrate", 100.0, "V/us", 1e-3, 1e6, "slope of the slip"),
    Parameter("amplitude", 300.0, "V", 1e-9, 1e4, "amplitude at the start, peak to peak", False),
    Parameter("frequency", 100.0, "Hz", 1e-6, 1e7, "drive frequency at the start", False),
    Parameter("waveform", "sawtooth", "", 0, 0, "sawtooth, hold, shaped, triangle or table"),
    Parameter("hold_before", 0.0, "", 0.0, 0.95, "share of the period held before the slip"),
    Parameter("hold_after", 0.0, "", 0.0, 0.95, "share of the period held after the slip"),
    Parameter("split", 0.5, "", 0.0, 1.0, "share of the first part of a shaped slip"),
    Parameter("latency", 0.0, "s", 0.0, 1.0, "time between the parts of a shaped slip"),
    Parameter("waveform_table", "", "", 0, 0, "CSV file of the waveform table, see docs/drive.md"),
    Parameter("min_frequency", 0.0, "Hz", 0.0, 1e7, "lowest drive frequency"),
    Parameter(
        "amplitude_levels",
        0,
        "",
        0,
        2**31 - 1,
        "levels from 0 to max_voltage that voltages are rounded to; 0: any voltage",
    ),
    Parameter("max_steps", 0, "", 0, 2**31 - 1, "largest number of steps a command; 0: no limit"),
    Parameter("scan_rate", 1e4, "V/s", 1e-3, 1e9, "how fast the level of the actuator is moved"),
    # Sensor
    Parameter("sensor_rate", 1e3, "Hz", 1.0, 1e5, "readings of the position a second", False),
    Parameter("sensor_resolution", 1e-9, "m", 0.0, 1e-3, "grid of the readings; 0: none"),
    Parameter("sensor_noise", 1e-9, "m", 0.0, 1e-3, "standard deviation of a reading"),
    Parameter("sensor_seed", 1, "", 0, 2**31 - 1, "seed of the noise"),
    Parameter(
        "sensor_latency", 1e-3, "s", 0.0, 1.0, "age of a reading when it arrives, in whole readings"
    ),
    # Closed loop
    Parameter("target_tolerance", 2e-9, "m", 1e-12, 1e-3, "distance that counts as on the target"),
    Parameter("hold_time", 0.05, "s", 0.0, 1e3, "time within the tolerance until it is reached"),
    Parameter("settle_time", 5e-3, "s", 0.0, 10.0, "rest after steps before the position is read"),
    Parameter(
        "target_timeout",
        60.0,
        "s",
        0.0,
        1e6,
        "time without coming nearer to the target that is a fault; 0: any",
    ),
    # Limits
    Parameter("travel_low", -0.01, "m", -1.0, 0.0, "stop at the lower end of the travel", False),
    Parameter("travel_high", 0.01, "m", 0.0, 1.0, "stop at the upper end of the travel", False),
    Parameter("soft_low", -1.0, "m", -1.0, 1.0, "measured position below which no cycle starts"),
    Parameter("soft_high", 1.0, "m", -1.0, 1.0, "measured position above which no cycle starts"),
    Parameter("max_velocity", 0.0, "m/s", 0.0, 1e3, "mean velocity that is a fault; 0: any"),
    Parameter(
        "max_following_error",
        0.0,
        "m",
        0.0,
        1.0,
        "distance from a trajectory or a held target that is a fault; 0: any",
    ),
    # Solver
    Parameter("tolerance", 1e-11, "m", 1e-15, 1e-9, "error in position allowed per cycle"),
    # Node
    Parameter(
        "axis_name",
        "axis",
        "",
        0,
        0,
        "joints are <axis_name>_slider and _piezo",
        mutable=False,
        pattern="[A-Za-z][A-Za-z0-9_]*",
    ),
    Parameter("publish_rate", 100.0, "Hz", 0.1, 1e3, "rate of the published state", False),
    Parameter(
        "real_time_factor",
        1.0,
        "",
        0.0,
        1e4,
        "simulated time by real time; 0: as fast as it can",
        mutable=False,
    ),
    Parameter(
        "real_time_priority",
        0,
        "",
        0,
        99,
        "of the scheduler's class FIFO, attempted at the start; 0: as other processes",
        mutable=False,
    ),
    Parameter("publish_clock", False, "", 0, 1, "publish the simulated time on /clock", False),
)

#: Beginnings of the names of parameters that every ROS node has; not ours to judge.
OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides.")

#: All parameters by name, in the order of the table.
PARAMETERS: Mapping[str, Parameter] = {row.name: row for row in _TABLE}


def parameter(name: str) -> Parameter:
    """Return the row of ``name``; raise ParameterError with the nearest names."""
    try:
        return PARAMETERS[name]
    except KeyError:
        near = difflib.get_close_matches(name, PARAMETERS, n=3)
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(PARAMETERS)}"
        raise ParameterError(f"there is no parameter {name!r}; {hint}") from None


def defaults() -> Values:
    """Return a fresh mapping of every name to its default."""
    return {name: row.default for name, row in PARAMETERS.items()}


def check(values: Mapping[str, object]) -> Values:
    """Return a full set: the defaults with ``values`` laid over them, each one checked.

    Raises ParameterError for an unknown name, a wrong type or a value out of range.
    """
    full = defaults()
    for name, value in values.items():
        full[name] = parameter(name).check(value)
    return full


def parse_assignment(text: str) -> tuple[str, Value]:
    """Read ``name=value`` as given to ``--set``; raise ParameterError."""
    name, sign, value = text.partition("=")
    if not sign:
        raise ParameterError(f"{text!r} is not of the form NAME=VALUE, such as preload=1.0")
    row = parameter(name.strip())
    return row.name, row.parse(value.strip())


def read_yaml(path: Path) -> Values:
    """Read the parameters of a ROS parameter file (``/**: ros__parameters: ...``).

    Only values that the file names are returned, each one checked. Raises ParameterError that
    names the file.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read {path}: {error.strerror or error}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise ParameterError(f"{path} is not a YAML file: {reason}") from None
    values: Values = {}
    for node, body in _as_mapping(content, path).items():
        inner = body.get("ros__parameters") if isinstance(body, dict) else None
        if inner is None:
            raise ParameterError(
                f"{path}: {node!r} holds no ros__parameters; a file starts with "
                "'/**:' and below it 'ros__parameters:'"
            )
        for name, value in _as_mapping(inner, path).items():
            if str(name).startswith(OF_EVERY_NODE):
                continue
            try:
                values[str(name)] = parameter(str(name)).check(value)
            except ParameterError as error:
                raise ParameterError(f"{path}: {error}") from None
    return values


def _as_float(value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _as_mapping(content: object, path: Path) -> dict[object, Any]:
    if not isinstance(content, dict):
        raise ParameterError(
            f"{path} holds no names with values; a file starts with '/**:' and below it "
            "'ros__parameters:'"
        )
    return content
