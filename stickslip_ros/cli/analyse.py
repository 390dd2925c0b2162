# SPDX-License-Identifier: Apache-2.0
"""``stickslip analyse``: what a trace of steps says."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.cli.options import UsageError
from stickslip_ros.traces import StepAnalysis, TraceError, analyse_steps, read_csv


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser("analyse")
    parser.add_argument("trace", type=Path, metavar="TRACE.csv")
    parser.add_argument(
        "--runner-only", action="store_true", help="leave the actuator out, as if not measured"
    )
    parser.add_argument(
        "--frequency", type=float, metavar="HZ", help="of the drive (default: found)"
    )
    parser.add_argument(
        "--start", type=float, metavar="S", help="of the first cycle (default: found)"
    )
    parser.add_argument(
        "--zero-amplitude", type=float, metavar="M", help="measured on its own, for Eq. 9"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    if args.frequency is not None and not 0.0 < args.frequency < math.inf:
        raise UsageError(f"--frequency is {args.frequency:g} Hz; it has to be above 0")
    if args.zero_amplitude is not None and not 0.0 <= args.zero_amplitude < math.inf:
        raise UsageError(f"--zero-amplitude is {args.zero_amplitude:g} m; it has to be 0 or more")
    try:
        trace = read_csv(args.trace)
        found = analyse_steps(
            trace.t,
            trace.x,
            None if args.runner_only else trace.u,
            frequency=args.frequency,
            start=args.start,
            zero_amplitude=args.zero_amplitude,
        )
    except OSError as error:
        raise UsageError(f"cannot read {args.trace}: {error.strerror or error}") from None
    except TraceError as error:
        raise UsageError(f"{args.trace}: {error}") from None
    except ValueError as error:
        raise UsageError(str(error)) from None
    print(json.dumps(_plain(asdict(found)), allow_nan=False) if args.json else _table(found))
    return 0


def _plain(value: Any) -> Any:
    """Return what JSON can hold: lists for arrays, null for nan."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray | list):
        return [_plain(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def _table(found: StepAnalysis) -> str:
    balance = found.balance

    def nano(length: float) -> str:
        return "not measurable" if math.isnan(length) else f"{1e9 * length:.3f} nm"

    rings = not math.isnan(found.ringing_frequency)
    rows = [
        ("cycles", f"{len(found.starts)} of {found.period:g} s, from {found.starts[0]:g} s"),
        ("step size", nano(found.step_size)),
        ("backstep", nano(found.backstep)),
        ("ringing", f"{found.ringing_frequency:.1f} Hz" if rings else "none visible"),
        (
            "decay",
            f"{found.decay:.1f} 1/s, {found.damping_ratio:.4f} of critical" if rings else "-",
        ),
        ("mean speed", f"{1e6 * found.mean_speed:.3f} um/s"),
        ("excitation", nano(balance.excitation)),
        ("regained", nano(balance.regained)),
        ("left (Eq. 9)", nano(balance.left)),
        ("0-amplitude", nano(balance.zero_amplitude)),
        ("remainder", nano(balance.remainder)),
    ]
    return "\n".join(f"{name:<12} {value}" for name, value in rows)
