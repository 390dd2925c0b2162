# SPDX-License-Identifier: Apache-2.0
"""Recorders that are killed: ``python killed.py FOLDER COMPRESSION COUNT HERTZ`` kills so many.

Each is a process of its own that writes messages of that rate and flushes after each second of
them, as fast as it can, begins a new file after 2500 and is killed at a random message. Prints as
JSON how many messages each had been given to write by then.
"""

import json
import mmap
import os
import random
import signal
import sys
import time
from pathlib import Path

from bags import JOINTS, START, joint_state

from stickslip_ros.recordings import BagWriter

SECOND = 1_000_000_000
LONGEST = 6_000  # messages
SPLIT = 2_500  # messages


def endless(folder: Path, compression: str, hertz: int, progress: mmap.mmap) -> None:
    """Write for ever."""
    step = SECOND // hertz
    with BagWriter(
        folder, compression=compression, custom_data={"seed": "7"}, max_duration_ns=SPLIT * step
    ) as bag:
        bag.add_topic(JOINTS)
        data = joint_state(START, 1e-6)
        number = 0
        while True:
            progress[:8] = number.to_bytes(8, "little")
            ns = START + number * step
            bag.write(JOINTS.name, data, log_ns=ns, publish_ns=ns)
            number += 1
            if number % hertz == 0:
                bag.flush()


def main() -> None:
    folder, compression = Path(sys.argv[1]), sys.argv[2]
    count, hertz = int(sys.argv[3]), int(sys.argv[4])
    dice = random.Random(compression)
    given = []
    for number in range(count):
        last = dice.randrange(LONGEST)
        progress = mmap.mmap(-1, 8)
        child = os.fork()
        if child == 0:
            endless(folder / f"run_{number}", compression, hertz, progress)
        while int.from_bytes(progress[:8], "little") < last:
            time.sleep(1e-4)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        given.append(int.from_bytes(progress[:8], "little"))
    print(json.dumps(given))


if __name__ == "__main__":
    main()
