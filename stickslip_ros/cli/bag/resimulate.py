# SPDX-License-Identifier: Apache-2.0
"""``stickslip bag resimulate``: run a recorded axis once more, compare or ask what if."""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from stickslip_ros import __version__
from stickslip_ros.axis import Axis
from stickslip_ros.axis.events import event_texts
from stickslip_ros.axis.resimulation import NotRepeatable, Rerun, start_of
from stickslip_ros.cli.options import UsageError, progress_bar
from stickslip_ros.compiled import telling_when_compiling
from stickslip_ros.parameters import parse_assignment
from stickslip_ros.recordings import BagError, BagReader, BagWriter, encoder_for, open_bag
from stickslip_ros.recordings.recorded_runs import (
    Difference,
    RecordedRun,
    Sample,
    recorded_runs,
    samples_of,
)

#: The fields of a JointState, and what they are called where they are compared
_FIELDS = ("position", "velocity", "effort")
_UNITS = {"position": "m", "velocity": "m/s", "effort": "N"}
_DIFFERENT = 1


def add_parser(subparsers: argparse._SubParsersAction) -> None:  # type: ignore[type-arg]
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "resimulate",
        help="run a recorded axis once more and compare every state with the recorded one",
        description="Rebuilds the run from the parameters and commands in the bag. The same "
        "version on the same machine gives every recorded state again, to the last bit; exit code "
        "1 if it does not. With --set it answers 'what if': the same commands, other parameters.",
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of a bag, or one file of it")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="change a parameter"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="write what came out as a new bag")
    parser.add_argument("--json", action="store_true", help="print one JSON object, SI units")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the subcommand; return the exit code."""
    changes = dict(parse_assignment(text) for text in args.set)
    try:
        with open_bag(args.bag) as bag, contextlib.ExitStack() as stack:
            runs = recorded_runs(bag)
            copy = stack.enter_context(_new_bag(bag, args.out, changes)) if args.out else None
            with telling_when_compiling():
                reports = [
                    _rerun(bag, run, end_ns, changes, copy) for run, end_ns in _with_ends(runs)
                ]
    except (BagError, NotRepeatable) as error:
        raise UsageError(str(error)) from None
    if args.json:
        print(json.dumps({"bag": str(args.bag), "changes": changes, "runs": reports}))
    else:
        print("\n\n".join(_text(report, bool(changes)) for report in reports))
        if args.out:
            print(f"\nwritten to {args.out}")
    exact = all(report["bit_for_bit"] for report in reports)
    return 0 if exact or changes else _DIFFERENT


def _with_ends(runs: list[RecordedRun]) -> Iterator[tuple[RecordedRun, int | None]]:
    """Yield each run with the stamp at which the next one of the same node starts."""
    for before, after in pairwise([*runs, None]):
        assert before
        same = after is not None and after.node == before.node
        yield before, after.start_ns if same and after else None


def _rerun(
    bag: BagReader,
    run: RecordedRun,
    end_ns: int | None,
    changes: dict[str, Any],
    copy: _Copy | None,
) -> dict[str, Any]:
    rerun = Rerun(run.events, changes)
    differences: dict[str, Difference] = {}
    count = bag.counts.get(run.joints_topic, 0) + bag.counts.get(run.contact_topic, 0)
    states = last = 0
    with progress_bar(count, run.node) as bar:
        for sample in samples_of(bag, run, end_ns):
            axis = rerun.advance(sample.time_ns * 1e-9)
            values = _values(axis, sample, run)
            for name, index, again in values:
                recorded = getattr(sample.message, name)[index]
                key = f"{sample.message.name[index]} {name}"
                differences.setdefault(key, Difference()).note(recorded, again, sample.time_ns)
            if copy:
                copy.state(sample, values)
                copy.events(run, axis)
            else:
                axis.take_events()
            states, last = states + 1, sample.time_ns
            bar.update()
    if not states:
        raise NotRepeatable(
            f"{bag.path} holds no state of {run.node}; record {run.joints_topic} as well"
        )
    return {
        "axis": run.node,
        "version": start_of(run.events)[1],
        "this_version": __version__,
        "commands": sum(event.outcome == "applied" for event in run.events) - 1,
        "left_out": rerun.left_out,
        "states": states,
        "duration": last * 1e-9,
        "bit_for_bit": not any(d.unequal for d in differences.values()),
        "differences": {
            name: {
                "values": d.values,
                "unequal": d.unequal,
                "largest": d.largest,
                "at": None if d.unequal == 0 else d.at,
                "unit": _UNITS[name.rpartition(" ")[2]],
            }
            for name, d in differences.items()
        },
    }


def _values(axis: Axis, sample: Sample, run: RecordedRun) -> list[tuple[str, int, float]]:
    """Return field, index and value for all that a message says of the axis."""
    state = axis.state
    if sample.topic == run.contact_topic:
        rows = {f"{run.axis_name}_contact": (state.z, state.w, state.force)}
    else:
        rows = {
            f"{run.axis_name}_slider": (state.x, state.v, -state.force),
            f"{run.axis_name}_piezo": (state.u, state.rate, state.force),
        }
    names = list(sample.message.name)
    return [
        (field, names.index(joint), value)
        for joint, values in rows.items()
        if joint in names
        for field, value in zip(_FIELDS, values, strict=True)
    ]


def _text(report: dict[str, Any], changed: bool) -> str:
    lines = [
        f"{report['axis']}: {report['commands']} commands, {report['states']} states "
        f"over {report['duration']:.3f} s"
    ]
    if report["version"] != report["this_version"]:
        lines.append(
            f"recorded by version {report['version'] or '?'}, run again by {report['this_version']}"
        )
    lines += [f"left out: {text}" for text in report["left_out"]]
    if report["bit_for_bit"]:
        lines.append("every recorded state came out again, bit for bit")
        return "\n".join(lines)
    against = "the run as recorded" if changed else "what was recorded"
    lines.append(f"{'largest difference to ' + against:<44}{'at (s)':>12}{'unequal':>20}")
    for name, d in report["differences"].items():
        at = "" if d["at"] is None else f"{d['at']:.6f}"
        lines.append(
            f"  {name:<26}{d['largest']:>12.3e} {d['unit']:<4}{at:>12}"
            f"{d['unequal']:>10} of {d['values']}"
        )
    return "\n".join(lines)


@contextlib.contextmanager
def _new_bag(bag: BagReader, folder: Path, changes: dict[str, Any]) -> Iterator[_Copy]:
    """Give a new bag that is there when all went well, and gone if not."""
    origin = {"resimulated_from": str(bag.path), "changes": json.dumps(changes)}
    writer = BagWriter(folder, custom_data=origin)
    try:
        yield _Copy(bag, writer)
        writer.close()
    except BaseException:
        writer.discard()
        raise


class _Copy:
    """A new bag with the states and events of runs as they came out."""

    def __init__(self, bag: BagReader, writer: BagWriter) -> None:
        self._bag, self._writer = bag, writer
        self._encoders: dict[str, Any] = {}

    def state(self, sample: Sample, values: list[tuple[str, int, float]]) -> None:
        """Write a state message with what came out in place of what was recorded."""
        message = sample.message
        for name, index, value in values:
            getattr(message, name)[index] = value
        self._write(sample.topic, message, sample.log_ns, sample.publish_ns, sample.sequence)

    def events(self, run: RecordedRun, axis: Axis) -> None:
        """Write the events since the last state."""
        for event in axis.take_events():
            ns = run.start_ns + round(event.time * 1e9)
            time = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
            node = run.node.lstrip("/")
            status = SimpleNamespace(
                level=0,
                name=f"{node}: event",
                message=f"{event.name} {event.outcome}",
                hardware_id=node,
                values=[SimpleNamespace(key=k, value=v) for k, v in event_texts(event).items()],
            )
            header = SimpleNamespace(stamp=time, frame_id="")
            self._write(
                f"{run.node}/events", SimpleNamespace(header=header, status=[status]), ns, ns, 0
            )

    def _write(self, topic: str, message: Any, log_ns: int, publish_ns: int, number: int) -> None:
        if topic not in self._encoders:
            description = self._bag.topics[topic]
            self._encoders[topic] = encoder_for(description)
            self._writer.add_topic(description)
        self._writer.write(
            topic,
            self._encoders[topic](message),
            log_ns=log_ns,
            publish_ns=publish_ns,
            sequence=number,
        )
