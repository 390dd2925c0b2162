# SPDX-License-Identifier: Apache-2.0
"""The values that a sweep gives to a parameter: an even grid, or a list."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickslipError
from stickslip_ros.parameters import parameter

_FORM = "NAME=START:STOP:COUNT[:log], such as preload=0.1:6:60"


class SweepError(StickslipError, ValueError):
    """The sweep is impossible; the message says what to change."""


@dataclass(frozen=True)
class _Axis:
    """A parameter that varies."""

    name: str

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return parameter(self.name).unit

    def check(self, values: Iterable[float]) -> None:
        """Raise SweepError or ParameterError if these are no values of the parameter."""
        row = parameter(self.name)
        if row.kind is not float:
            raise SweepError(f"{self.name} is not a number and cannot be varied; use --set")
        for value in values:
            row.check(value)


@dataclass(frozen=True)
class GridAxis(_Axis):
    """``count`` values of a parameter from start to stop (both included), in its unit.

    >>> import numpy as np
    >>> GridAxis.parse("preload=0.5:1.5:3").values(np.arange(3)).tolist()
    [0.5, 1.0, 1.5]
    >>> str(GridAxis.parse("preload=500mN:1.5N:3"))
    'preload=0.5:1.5:3'
    """

    start: float
    stop: float
    count: int
    log: bool = False

    def __post_init__(self) -> None:
        """Raise SweepError or ParameterError if that is no range of a parameter."""
        self.check((self.start, self.stop))
        if self.count < 1 or (self.count == 1) != (self.start == self.stop):
            raise SweepError(
                f"{self.name} from {self.start:g} to {self.stop:g} in {self.count} values is an "
                "empty range; two different ends need two values or more"
            )
        if self.log and not min(self.start, self.stop) > 0.0:
            raise SweepError(f"{self.name} varies by factors (log); both ends have to be above 0")

    @classmethod
    def parse(cls, text: str) -> GridAxis:
        """Read ``NAME=START:STOP:COUNT[:log]``; raise SweepError or ParameterError.

        Both ends may have a unit, such as in ``preload=100mN:6N:60``.
        """
        name, _, values = text.partition("=")
        *ends, count = values.removesuffix(":log").split(":")
        if len(ends) != 2 or not count.strip().isdecimal():
            raise SweepError(f"{text!r} is not of the form {_FORM}")
        row = parameter(name.strip())
        start, stop = (row.read(end.strip()) for end in ends) if row.kind is float else (0.0, 0.0)
        return cls(row.name, float(start), float(stop), int(count), values.endswith(":log"))

    def __str__(self) -> str:
        """Return the text that `parse` reads."""
        scale = ":log" if self.log else ""
        return f"{self.name}={self.start!r}:{self.stop!r}:{self.count}{scale}"

    def values(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the values with these indices (0 .. count - 1), shape as index."""
        pieces = max(self.count - 1, 1)
        between: NDArray[np.floating]
        if self.log:
            between = self.start * (self.stop / self.start) ** (index / pieces)
        else:
            between = self.start + (self.stop - self.start) / pieces * index
        return np.where(index == self.count - 1, self.stop, between).astype(np.float64, copy=False)


@dataclass(frozen=True)
class ListedAxis(_Axis):
    """Values of a parameter, in its unit, one by one."""

    listed: tuple[float, ...]
    log: bool = False  #: whether plots have a logarithmic axis

    def __post_init__(self) -> None:
        """Raise SweepError or ParameterError if these are no values of a parameter."""
        self.check(self.listed)
        if not self.listed:
            raise SweepError(f"{self.name} has no values; give one or more")

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self.listed)

    def values(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the values with these indices (0 .. count - 1), shape as index."""
        return np.array(self.listed)[index]


SweepAxis = GridAxis | ListedAxis
