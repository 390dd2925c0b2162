# SPDX-License-Identifier: Apache-2.0
"""Recorders that memory fails: ``python short_of_memory.py FOLDER COMPRESSION COUNT SEED``.

Each writes the same messages; in each one, one allocation of Python's fails, at random. CPython
brings the tool for that, `_testcapi.set_nomemory`. Prints as JSON what each was given to write,
what of it was flushed, and how it ended.
"""

import importlib
import json
import random
import sys
from pathlib import Path

from bags import JOINTS, START, joint_state

from stickslip_ros.recordings import BagWriter

MESSAGES, FLUSH_EVERY = 600, 150


class Recorder:
    """Notes what it was given and promised, without an allocation that could fail."""

    given = flushed = 0

    def record(self, folder: Path, compression: str, data: bytes) -> None:
        """Write the messages, in files of 400."""
        with BagWriter(folder, compression=compression, sync=False, max_duration_ns=400) as bag:
            bag.add_topic(JOINTS)
            for number in range(MESSAGES):
                bag.write(JOINTS.name, data, log_ns=START + number, publish_ns=START)
                self.given = number + 1
                if self.given % FLUSH_EVERY == 0:
                    bag.flush()
                    self.flushed = self.given


def main() -> None:
    _testcapi = importlib.import_module("_testcapi")  # not everywhere there

    folder, compression = Path(sys.argv[1]), sys.argv[2]
    count, dice = int(sys.argv[3]), random.Random(sys.argv[4])
    data = joint_state(START, 1e-6)
    Recorder().record(folder / "warm", compression, data)
    ended = []
    for number in range(count):
        # Half of them among the first ones, with which the bag is made.
        failing = dice.randrange(dice.choice([3_000, 60_000]))
        recorder, place, said = Recorder(), folder / f"run_{number}", "whole"
        try:
            _testcapi.set_nomemory(failing, failing + 1)
            try:
                recorder.record(place, compression, data)
            finally:
                _testcapi.remove_mem_hooks()
        except Exception as error:  # Python makes others of some: a path is no path, it says
            said = f"{type(error).__name__}: {error}"
        ended.append([recorder.given, recorder.flushed, said])
    print(json.dumps(ended))


if __name__ == "__main__":
    main()
