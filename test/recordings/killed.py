# SPDX-License-Identifier: Apache-2.0
"""Recorders that are killed: ``python killed.py FOLDER COMPRESSION COUNT`` kills so many.

Each is a process of its own that writes a message for each millisecond and flushes after each
second of them, as fast as it can, and is killed at a random message. Prints as JSON how many
messages each had been given to write by then.
"""

from __future__ import annotations

import json
import mmap
import os
import random
import signal
import sys
import time
from pathlib import Path

from recordings import JOINTS, START, joint_state

from stickslip_ros.recordings import BagWriter

MS = 1_000_000
LONGEST = 12_000  # ms


def endless(folder: Path, compression: str, progress: mmap.mmap) -> None:
    """Write for ever."""
    with BagWriter(
        folder, compression=compression, custom_data={"seed": "7"}, max_duration_ns=5000 * MS
    ) as bag:
        bag.add_topic(JOINTS)
        data = joint_state(START, 1e-6)
        ms = 0
        while True:
            progress[:8] = ms.to_bytes(8, "little")
            ns = START + ms * MS
            bag.write(JOINTS.name, data, log_ns=ns, publish_ns=ns)
            ms += 1
            if ms % 1000 == 0:
                bag.flush()


def main() -> None:
    """Start and kill."""
    folder, compression, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    dice = random.Random(compression)
    given = []
    for number in range(count):
        last = dice.randrange(LONGEST)
        progress = mmap.mmap(-1, 8)
        child = os.fork()
        if child == 0:
            endless(folder / f"run_{number}", compression, progress)
        while int.from_bytes(progress[:8], "little") < last:
            time.sleep(1e-4)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        given.append(int.from_bytes(progress[:8], "little"))
    print(json.dumps(given))


if __name__ == "__main__":
    main()
