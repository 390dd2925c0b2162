# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command ``stickslip``."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from stickslip_ros.errors import INTERRUPTED


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, 1 for a finding, 2 for bad use, 130 after a signal."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        # The threads of linear algebra on small matrices only wait for each other, busily.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Its libraries may take a second to load: here, where Ctrl-C is met.
        from stickslip_ros.cli.command_line import run

        try:
            return run(argv)
        finally:
            print(end="", flush=True)  # what is left, as long as somebody handles its failure
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("stickslip: interrupted", file=sys.stderr)
        return INTERRUPTED
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
