# SPDX-License-Identifier: Apache-2.0
"""Which functions a first start compiles, and how long each takes, by numba's own timers.

    NUMBA_CACHE_DIR=$(mktemp -d) python -m validation.benchmark.first_start contacts=6
Times (s of processor) are without the functions called; arguments are parameters of the run.
"""

import sys
import time
from collections import Counter
from typing import Any

import yaml
from numba.core import event

import stickslip_ros

#: Passes of numba that have a column; all else is "rest"
COLUMNS = {"nopython_type_inference": "typing", "native_lowering": "lowering"}


class Timers(event.Listener):
    """Adds up the time of each function by column, and how often it is compiled."""

    def __init__(self) -> None:
        self._open: list[tuple[str, str]] = []  # functions with their columns, outermost first
        self.times, self._since = dict[str, Counter[str]](), 0.0

    def on_start(self, event: Any) -> None:
        self._charge()
        if "dispatcher" in event.data:
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}".removeprefix("stickslip_ros.")
            self.times.setdefault(name, Counter())["variants"] += 1
            self._open.append((name, "rest"))
        else:  # a pass of the function that compiles, "name [...]"
            column = COLUMNS.get(str(event.data["name"]).partition(" ")[0], "rest")
            self._open.append((self._open[-1][0], column))

    def on_end(self, event: Any) -> None:
        self._charge()
        self._open.pop()

    def _charge(self) -> None:
        spent, self._since = time.process_time() - self._since, time.process_time()
        for name, column in self._open[-1:]:
            self.times[name].update({column: spent, "all": spent})


if __name__ == "__main__":
    timers, values = Timers(), dict(one.split("=") for one in sys.argv[1:])
    for kind in ("numba:compile", "numba:run_pass"):
        event.register(kind, timers)
    stickslip_ros.simulate(steps=30, **{name: yaml.safe_load(v) for name, v in values.items()})
    rows = sorted(timers.times.items(), key=lambda row: -row[1]["all"])
    for title, part in (("others", rows[12:]), ("all", [*rows])):
        rows.append((f"{title}: {len(part)}", sum((times for _, times in part), Counter())))
    for name, times in rows[:12] + rows[-2:]:
        seconds = [f"{times[key]:.2f}" for key in (*COLUMNS.values(), "rest", "all")]
        print("|", " | ".join([name, str(times["variants"]), *seconds]), "|")
