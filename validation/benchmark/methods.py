# SPDX-License-Identifier: Apache-2.0
"""The methods that are compared: the solver of this package and general ones.

A further one is a class here and a line in `METHODS`. All general solvers are restarted at every
kink of the drive and get the same equations, compiled by numba.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint, solve_ivp

from stickslip_ros.physics.parameters import SolverParameters
from validation.benchmark.cases import Constants, Problem, Scaled, rates

#: Runs the cycles it was made for, once, and returns the displacement, m.
Run = Callable[[], float]
#: Takes (w, z, r) and a number of cycles, returns (w, z, r).
Drive = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
#: Takes (w, z, r) and a duration without a kink, returns (w, z, r).
Piece = Callable[[NDArray[np.float64], float], NDArray[np.float64]]

#: m
DEFAULT_TOLERANCE = SolverParameters().tolerance
#: Settings of a general solver, loosest first: its absolute tolerance in scaled units.
LADDER = tuple(float(f"{10.0 ** (-half / 2):.1e}") for half in range(3, 15))
#: Of the slow ones, whose cost hardly changes from one to the next.
_COARSE_LADDER = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
#: Its relative tolerance is this part of it. What has to be right are absolute lengths; w reaches
#: sixty units in the slip, where a relative tolerance as large as the absolute one would spoil z.
RELATIVE = 0.1
#: Steps that a solver may take over one segment: no limit in practice.
STEPS = 10_000_000
_LOST = np.full(3, np.nan)


class MissingPeer(Exception):
    """A peer that is not installed or cannot run here; the message says why."""


class Method(Protocol):
    """A way to advance the axis over cycles."""

    @property
    def settings(self) -> Sequence[float]:
        """The tolerances to try, loosest first."""

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""


class OwnSolver:
    """`Simulation` at a tolerance in m. Every cycle is integrated, none is replayed."""

    settings = tuple(
        sorted({1e-9, 1e-10, 1e-11, 1e-12, 1e-13, 1e-14, DEFAULT_TOLERANCE}, reverse=True)
    )

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""
        simulation = problem.simulation(cycle)
        simulation.set_plant(problem.plant, setting)
        before = problem.starts[cycle].x

        def run() -> float:
            return float(simulation.run_cycles(count).position[-1]) - before

        return run


class General:
    """A general solver, restarted at every kink: all but ``drive`` of a `Method`."""

    settings: Sequence[float] = LADDER

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        raise NotImplementedError

    def prepare(self, problem: Problem, setting: float, cycle: int, count: int) -> Run:
        """Return a run of count cycles from the start of a measured cycle, ready to be timed."""
        scaled = problem.scaled
        start = scaled.start(problem.starts[cycle])
        drive = self.drive(scaled, setting)

        def run() -> float:
            return scaled.displacement(start, drive(start, count))

        return run


class PieceByPiece(General):
    """A general solver that Python calls for each piece between kinks."""

    settings: Sequence[float] = _COARSE_LADDER

    def piece(self, scaled: Scaled, setting: float) -> Piece:
        """Return what solves one piece of this plant."""
        raise NotImplementedError

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        piece = self.piece(scaled, setting)

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            y = start.copy()
            for _ in range(count):
                for duration, jump in zip(scaled.durations, scaled.jumps, strict=True):
                    y[0] += jump
                    y = piece(y, duration)
            return y

        return drive


class SolveIvp(PieceByPiece):
    """``solve_ivp`` of SciPy with one of its methods."""

    def __init__(self, name: str) -> None:
        """Take the method's name in SciPy."""
        self._name = name

    def piece(self, scaled: Scaled, setting: float) -> Piece:
        """Return what solves one piece of this plant."""
        slope, tolerances = _slope(scaled.constants), _tolerances(setting)

        def solve(y: NDArray[np.float64], duration: float) -> NDArray[np.float64]:
            found = solve_ivp(slope, (0.0, duration), y, method=self._name, **tolerances)
            return np.array(found.y[:, -1] if found.success else _LOST)

        return solve


class Odeint(PieceByPiece):
    """``odeint`` of SciPy: LSODA as well, with the steps in compiled code."""

    def piece(self, scaled: Scaled, setting: float) -> Piece:
        """Return what solves one piece of this plant."""
        slope, tolerances = _slope(scaled.constants), _tolerances(setting)

        def solve(y: NDArray[np.float64], duration: float) -> NDArray[np.float64]:
            found = odeint(slope, y, (0.0, duration), tfirst=True, mxstep=STEPS, **tolerances)
            return np.asarray(found[1])

        return solve


class Cvode(PieceByPiece):
    """CVODE of SUNDIALS by scikit-SUNDAE, with a right-hand side that fills its arrays.

    Adams methods: with kinks handled the problem is not stiff, and BDF takes longer.
    """

    def __init__(self) -> None:
        """Load scikit-SUNDAE; raise MissingPeer."""
        self._cvode = peer("sksundae.cvode", "scikit-sundae")

    def piece(self, scaled: Scaled, setting: float) -> Piece:
        """Return what solves one piece of this plant."""
        fill = _filling(scaled.constants)
        solver = self._cvode.CVODE(
            fill, method="Adams", max_num_steps=STEPS, **_tolerances(setting)
        )

        def solve(y: NDArray[np.float64], duration: float) -> NDArray[np.float64]:
            # Two calls instead of solve(): that one keeps what nobody asks for here.
            solver.init_step(0.0, y)
            found = solver.step(duration, tstop=duration)
            return np.array(found.y if found.success else _LOST)

        return solve


class SciJIT(General):
    """SciJIT's ``odeint``: LSODA in Fortran, called from compiled code for whole cycles."""

    settings = (*LADDER, 1e-8, 1e-9)  # an order that varies needs smaller tolerances

    def __init__(self) -> None:
        """Load SciJIT; raise MissingPeer."""
        self._integrate = peer("scijit.integrate", "scijit")

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        cycles, constants = _scijit_cycles(self._integrate), np.array(scaled.constants)

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            end: NDArray[np.float64] = cycles(
                start, scaled.durations, scaled.jumps, count, RELATIVE * setting, setting, constants
            )
            return end

        return drive


class CyRK(General):
    """One of CyRK's methods by its name there: C++, called from compiled code for whole cycles."""

    def __init__(self, name: str) -> None:
        """Load CyRK; raise MissingPeer."""
        self._cyrk = peer("CyRK", "cyrk")
        self._name = name

    def drive(self, scaled: Scaled, setting: float) -> Drive:
        """Return what runs cycles of this plant."""
        cycles, name = _cyrk_cycles(self._cyrk), self._name
        address = _cyrk_function(self._cyrk, scaled.constants).address
        relative, absolute = np.array([RELATIVE * setting]), np.array([setting])

        def drive(start: NDArray[np.float64], count: int) -> NDArray[np.float64]:
            end: NDArray[np.float64] = cycles(
                name, address, start, scaled.durations, scaled.jumps, count, relative, absolute
            )
            return end

        return drive


def peer(module: str, package: str) -> Any:
    """Import a peer; raise MissingPeer with the way to install it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingPeer(f"not installed: pip install {package} ({error})") from None
    except (ImportError, OSError) as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise MissingPeer(f"installed, but does not load: {reason[0]}") from None


def _tolerances(setting: float) -> dict[str, float]:
    return {"rtol": RELATIVE * setting, "atol": setting}


@cache
def _slope(constants: Constants) -> Any:
    """Return a compiled right-hand side that returns an array; the constants are compiled in."""
    damping, viscous, pull, z_ss, z_lim = constants

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def slope(t: float, y: NDArray) -> NDArray:
        dy = np.empty(3)
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)
        return dy

    return slope


@cache
def _filling(constants: Constants) -> Any:
    """Return a compiled right-hand side that fills an array."""
    damping, viscous, pull, z_ss, z_lim = constants

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def fill(t: float, y: NDArray, dy: NDArray) -> None:
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)

    return fill


@cache
def _scijit_cycles(integrate: Any) -> Any:
    solve = integrate.odeint

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def slope(t: float, y: NDArray, c: NDArray) -> NDArray:
        dy = np.empty(3)
        dy[0], dy[1], dy[2] = rates(y[0], y[1], c[0], c[1], c[2], c[3], c[4])
        return dy

    @numba.njit  # type: ignore[untyped-decorator, unused-ignore]
    def cycles(
        start: NDArray, durations: NDArray, jumps: NDArray, count: int,
        relative: float, absolute: float, constants: NDArray,
    ) -> NDArray:  # fmt: skip
        y, t = start.copy(), np.zeros(2)
        for _ in range(count):
            for k in range(len(durations)):
                y[0] += jumps[k]
                t[1] = durations[k]
                found = solve(
                    slope, y, t, args=(constants,), rtol=relative, atol=absolute, tfirst=True,
                    mxstep=STEPS,
                )  # fmt: skip
                y[:] = found[1]
        return y

    return cycles


@cache
def _cyrk_function(cyrk: Any, constants: Constants) -> Any:
    """Return a C function; the constants are compiled in."""
    damping, viscous, pull, z_ss, z_lim = constants

    def fill(dy: Any, t: float, y: Any, args: Any) -> None:
        dy[0], dy[1], dy[2] = rates(y[0], y[1], damping, viscous, pull, z_ss, z_lim)

    return cyrk.cyjit(fill)


@cache
def _cyrk_cycles(cyrk: Any) -> Any:
    solve = cyrk.nbsolve2_ivp

    @numba.njit(nogil=True)  # type: ignore[untyped-decorator, unused-ignore]
    def cycles(
        name: str, address: int, start: NDArray, durations: NDArray, jumps: NDArray, count: int,
        relative: NDArray, absolute: NDArray,
    ) -> NDArray:  # fmt: skip
        y = start.copy()
        for _ in range(count):
            for k in range(len(durations)):
                y[0] += jumps[k]
                solution = solve(
                    address, (0.0, durations[k]), y, name, rtols=relative, atols=absolute,
                    max_num_steps=STEPS, force_retain_solver=False,
                )  # fmt: skip
                if solution.success:
                    found = solution.y
                    last = found.shape[1] - 1
                    for i in range(3):
                        y[i] = found[i, last]
                else:
                    y[:] = np.nan
                solution.free()
        return y

    return cycles


@dataclass(frozen=True)
class Registered:
    """A method that may or may not be installed."""

    title: str  #: for people
    load: Callable[[], Method]  #: raises MissingPeer


OURS, SCIPY_LSODA = "ours", "scipy-lsoda"
#: By the names used on the command line.
METHODS: Mapping[str, Registered] = {
    OURS: Registered("stickslip_ros", OwnSolver),
    "cyrk-dop853": Registered("CyRK DOP853", lambda: CyRK("DOP853")),
    "cyrk-vern7": Registered("CyRK Vern7", lambda: CyRK("VERN7")),
    "cyrk-lsoda": Registered("CyRK LSODA", lambda: CyRK("LSODA")),
    "scijit-lsoda": Registered("SciJIT LSODA", SciJIT),
    SCIPY_LSODA: Registered("SciPy LSODA", lambda: SolveIvp("LSODA")),
    "scipy-odeint": Registered("SciPy odeint", Odeint),
    "scipy-dop853": Registered("SciPy DOP853", lambda: SolveIvp("DOP853")),
    "sundae-cvode": Registered("SUNDAE CVODE", Cvode),
}
PEERS = tuple(name for name in METHODS if name != OURS)
