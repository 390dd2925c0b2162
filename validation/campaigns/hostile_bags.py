# SPDX-License-Identifier: Apache-2.0
"""Mutated bags, each read, recovered, and given to every command, in a process of little memory.

A bag that takes more CPU time than :data:`PATIENCE` counts as hanging. A third of them are whole as
files, and their messages are wrong: bytes, times, order, number.
"""

import contextlib
import io
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from bags import EVENTS, JOINTS, STEPS, foreign, record, samples
from child import python
from mcap.opcode import Opcode
from mcap.writer import CompressionType
from test_bag_resimulation import record_axis

from stickslip_ros.cli.main import main as main_of_stickslip
from stickslip_ros.recordings import BagError, BagWriter, decoder_for, open_bag, recover

PATIENCE = 10.0  # s of CPU time for one bag
MEMORY = 1000 * 1000 * 1000  # bytes of data of the process; the libraries take a half
COMMANDS = ("info", "info --json", "export", "export --out {}.csv", "resimulate", "recover")

EVIL = [0, 1, 8, 21, 22, 255, 2**15, 2**16 - 1, 2**24, 2**26, 2**26 + 1, 2**31 - 1, 2**31]
TYPES = [JOINTS.type, EVENTS.type, STEPS.type, "a/msg/B"]
EVIL += [2**32 - 1, 2**32, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 2, 2**64 - 1]


Message = tuple[Any, ...]


class Hanging(Exception):
    """A bag takes too long."""


def originals(folder: Path) -> list[Path]:
    """Make the bags to mutate: folders and single files."""
    for compression in ("none", "lz4", "zstd"):
        record(folder / compression, 120, flush_every=40, compression=compression)
    record(folder / "split", 120, flush_every=40, max_duration_ns=50_000_000)
    record_axis(folder / "axis")
    foreign(folder / "plain.mcap", list(samples(60)), use_chunking=False)
    foreign(folder / "bare.mcap", list(samples(60)), enable_crcs=False, chunk_size=3000)
    foreign(
        folder / "zstd.mcap",
        list(samples(60)),
        enable_crcs=False,
        chunk_size=3000,
        compression=CompressionType.ZSTD,
    )
    return [
        *(folder / name for name in ("none", "lz4", "zstd", "split", "axis")),
        *(folder / f"{name}.mcap" for name in ("plain", "bare", "zstd")),
    ]


def mutated(data: bytes, dice: random.Random) -> bytes:
    """Return the contents of a file with something wrong."""
    found = bytearray(data)
    for _ in range(dice.choice([1, 1, 1, 2, 5])):
        at = dice.randrange(len(found) + 1)
        kind = dice.randrange(9)
        if kind == 0:  # bits
            for _ in range(dice.choice([1, 1, 8])):
                if found:
                    found[dice.randrange(len(found))] ^= 1 << dice.randrange(8)
        elif kind == 1:  # cut
            del found[at:]
        elif kind == 2:  # a part missing
            del found[at : at + dice.choice([1, 9, 100, 5000])]
        elif kind == 3:  # a part twice, or somewhere else
            part = found[at : at + dice.choice([1, 9, 100, 5000])]
            found[(to := dice.randrange(len(found) + 1)) : to] = part
        elif kind == 4:  # zeros, as after a power failure
            length = min(dice.choice([4, 512, 4096]), len(found) - at)
            found[at : at + length] = bytes(length)
        elif kind == 5:  # noise
            length = min(dice.choice([1, 8, 300]), len(found) - at)
            found[at : at + length] = dice.randbytes(length)
        elif kind == 6:  # any number wrong
            width = dice.choice([2, 4, 8])
            number = dice.choice(EVIL) % 2 ** (8 * width)
            found[at : at + width] = number.to_bytes(width, "little")
        else:  # a number in a record wrong, or its kind, with the checksum of the index off
            _break_record(found, dice)
    return bytes(found)


def _break_record(found: bytearray, dice: random.Random) -> None:
    at, places = 8, []
    while at + 9 <= len(found) - 8:
        places.append(at)
        at += 9 + int.from_bytes(found[at + 1 : at + 9], "little")
    if not places:
        return
    place = dice.choice(places)
    length = int.from_bytes(found[place + 1 : place + 9], "little")
    what = dice.randrange(4)
    if what == 0:
        found[place] = dice.choice([*(int(opcode) for opcode in Opcode), 0, 16, 200])
    elif what == 1:
        number = dice.choice([*EVIL, length - 1, length + 1]) % 2**64
        found[place + 1 : place + 9] = number.to_bytes(8, "little")
    else:
        width = dice.choice([2, 4, 8])
        inside = place + 9 + dice.randrange(min(length, 64) + 1)
        number = dice.choice(EVIL) % 2 ** (8 * width)
        found[inside : inside + width] = number.to_bytes(width, "little")
    if dice.random() < 0.7 and len(found) > 12:
        found[-12:-8] = bytes(4)


def mutate(original: Path, copy: Path, dice: random.Random) -> None:
    """Make a copy of a bag with something wrong in one of its files."""
    if original.is_file():
        copy.write_bytes(mutated(original.read_bytes(), dice))
        return
    shutil.copytree(original, copy)
    file = dice.choice(sorted(copy.iterdir()))
    file.write_bytes(mutated(file.read_bytes(), dice))
    if dice.random() < 0.3:
        (copy / "metadata.yaml").unlink()


def rewrite(original: Path, copy: Path, dice: random.Random) -> None:
    """Make a whole bag of messages that are wrong."""
    with open_bag(original) as bag, BagWriter(copy, sync=False) as writer:
        for topic in bag.topics.values():
            if dice.random() < 0.1:
                cut = dice.randrange(len(topic.schema) + 1)
                topic = replace(topic, schema=topic.schema[:cut], type=dice.choice(TYPES))
            writer.add_topic(topic)
        found = list(bag.messages())
        for _ in range(dice.choice([1, 1, 5, 50])):
            at, other = dice.randrange(len(found)), dice.randrange(len(found))
            one, kind = found[at], dice.randrange(6)
            if kind == 0:
                found.insert(other, one)
            elif kind == 1 and len(found) > 10:
                found.pop(at)
            elif kind == 2:
                found[at], found[other] = found[other], one
            elif kind == 3:
                found[at] = one._replace(log_ns=dice.choice(EVIL))
            elif kind == 4:
                found[at] = one._replace(topic=found[other].topic)
            else:
                found[at] = one._replace(data=mutated(one.data, dice))
        for name, log_ns, publish_ns, number, data in found:
            writer.write(name, data, log_ns=log_ns, publish_ns=publish_ns, sequence=number)


def command(words: str, bag_path: Path, out: Path) -> str:
    """Give a bag to a command; return its exit code. A refusal is one line."""
    action, *options = words.format(out).split()
    if action == "export" and not options:
        options = ["--out", str(out)]
    if action == "recover":
        options = ["--out", str(out.with_name("recovered"))]
    said, told = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
        code = main_of_stickslip(["bag", action, str(bag_path), *options])
    assert code in (0, 1, 2, 3), code
    if code == 2:
        line = told.getvalue().splitlines()[-1]
        assert line.startswith(f"stickslip bag {action}: "), told.getvalue()
    text = said.getvalue() + told.getvalue()
    assert "Traceback" not in text and all(one in "\n" or one.isprintable() for one in text), text
    return f"{action} {code}"


def use(bag_path: Path) -> str:
    """Open, read and decode a bag; return how that ended."""
    try:
        with open_bag(bag_path) as bag:
            decoders: dict[str, Any] = {}
            last = 0
            for message in bag.messages():
                assert message.log_ns >= last
                last = message.log_ns
                if message.topic not in decoders:
                    decoders[message.topic] = decoder_for(bag.topics[message.topic])
                decoders[message.topic](message.data)
    except BagError as error:
        assert "\n" not in str(error)
        return "refused"
    return "read"


def contents(bag_path: Path) -> Counter[Message]:
    """Return the messages of a bag."""
    with open_bag(bag_path) as bag:
        return Counter(
            (m.topic, m.log_ns, m.publish_ns, m.sequence, m.data) for m in bag.messages()
        )


def mend(bag_path: Path, out: Path, original: Counter[Message]) -> str:
    """Recover a bag; return how that ended. Whatever differs has to be told."""
    try:
        done = recover(bag_path, out)
    except BagError:
        assert not out.exists()
        return "lost"
    found = contents(out)
    shutil.rmtree(out)
    if not done.findings and not done.unprotected:
        assert found == original, "a difference that is not told"
    strange = sum((found - original).values())
    assert strange <= done.unprotected, f"{strange} messages that were not in the bag"
    return "recovered"


def _remove(folder: Path, *names: str) -> None:
    for place in [folder / name for name in names]:
        shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)


def bags(count: int, seed: int) -> int:
    """Try the bags of that many seeds in a process of its own; return how many did harm."""
    with tempfile.TemporaryDirectory() as folder:
        child = python("-m", __name__, folder, str(seed), str(count))
    if child.returncode:
        print(child.stderr)
        return 1
    found = json.loads(child.stdout)
    failures = found.pop("failures")
    print(*failures, found, sep="\n")
    if found["memory (MB)"] > MEMORY / 1e6:
        failures.append("memory")
    # The mutations are of the right strength: some do harm, some do not.
    weak = min(found["read"], found["refused"], found["recovered"]) <= count / 20
    return len(failures) + weak


def main() -> None:
    """Run the seeds that the command line names; print one JSON object about what came of them."""
    folder, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    os.fsync = lambda _: None  # type: ignore[assignment]  # most of the time, and nothing is lost here
    bags = originals(folder)
    whole = {bag: contents(bag) for bag in bags}
    found: dict[str, Any] = {"read": 0, "refused": 0, "recovered": 0, "lost": 0}
    codes: Counter[str] = Counter()
    failures: list[str] = []
    slowest = 0.0
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))

    def give_up(_: int, frame: FrameType | None) -> None:
        raise Hanging(str(frame))

    signal.signal(signal.SIGVTALRM, give_up)
    for seed in range(first, first + count):
        dice = random.Random(seed)
        original = dice.choice(bags)
        copy = folder / f"mutant{original.suffix}"
        reference = whole[original]
        if seed % 3 == 0 and original.is_dir():
            rewrite(original, copy, dice)
            reference = contents(copy)
        else:
            mutate(original, copy, dice)
        begin = time.process_time()
        signal.setitimer(signal.ITIMER_VIRTUAL, PATIENCE)
        try:
            found[use(copy)] += 1
            found[mend(copy, folder / "mended", reference)] += 1
            for words in COMMANDS:
                codes[command(words, copy, folder / "out")] += 1
                _remove(folder, "out", "out.csv", "recovered")
        except Exception:
            failures.append(f"seed {seed}, {original.name}: {traceback.format_exc()}")
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        slowest = max(slowest, time.process_time() - begin)
        _remove(folder, copy.name, "mended", "out", "out.csv", "recovered")
    found["failures"] = failures
    found["exit codes"] = dict(sorted(codes.items()))
    found["slowest (s)"] = slowest
    peak = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
    assert peak
    found["memory (MB)"] = int(peak[1]) / 1000
    print(json.dumps(found))


if __name__ == "__main__":
    main()
