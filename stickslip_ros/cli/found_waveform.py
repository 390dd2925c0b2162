# SPDX-License-Identifier: Apache-2.0
"""What subcommands that search a waveform share: options, and how they tell what they found."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from stickslip_ros.cli.options import (
    add_parameters,
    add_yaml,
    parameters_of,
    save_parameters,
    yaml_lines,
)
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.parameters import Parameters
from stickslip_ros.studies.slip_shaping import ShapedSlip
from stickslip_ros.studies.step_elongation import ElongatedStep
from stickslip_ros.traces import run_steps


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the parameters to begin with and the ways to hand on those that were found."""
    add_parameters(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    add_yaml(parser)


def parameters_to_begin_with(args: argparse.Namespace) -> Parameters:
    """Return the parameters asked for, once the solver is ready for them."""
    p = parameters_of(args)
    with telling_when_compiling():
        run_steps(p, 1)
    return p


def hand_on(
    args: argparse.Namespace,
    found: ShapedSlip | ElongatedStep,
    p: Parameters,
    wanted: Mapping[str, Any],
    rows: Sequence[tuple[str, str, str]],
) -> None:
    """Write and print what was found; wanted: the parameters to change, rows: for people."""
    whole = p.replace(**wanted)
    if args.yaml:
        save_parameters(whole, args.yaml)
    if args.json:
        print(json.dumps({**asdict(found), "parameters": whole.flat()}, allow_nan=False))
        return
    lines = [f"{name:<14}{before:<16}{after}".rstrip() for name, before, after in rows]
    print("\n".join([*lines, "", yaml_lines(wanted)]))
