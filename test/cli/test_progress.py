# SPDX-License-Identifier: Apache-2.0
"""The progress bar of long work, as a terminal shows it."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

#: A part of the work that takes longer than people wait for a word
PROGRAM = """
import time
from stickslip_ros.cli.options import progress_bar
with progress_bar(2, "long work") as bar:
    time.sleep(2.5)
"""


def test_the_clock_of_a_bar_goes_on_during_a_long_part() -> None:
    screen, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stderr=terminal) as process:
        os.close(terminal)
        shown = b""
        while True:
            try:
                shown += os.read(screen, 4096)
            except OSError:  # the other end is closed
                break
    os.close(screen)
    assert process.returncode == 0
    assert shown.count(b"long work:   0%") >= 2
    assert b"[00:01<" in shown
    assert b"[00:02<" in shown
