# SPDX-License-Identifier: Apache-2.0
"""An identification in the background, which the page starts, watches and cancels."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.reporting import to_json
from stickslip_ros.measurement.identification import identify
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.simulation.motion import Motion


class Fitting:
    """One identification at a time; `state` says in words of JSON how far it is."""

    def __init__(self, found: Callable[[Parameters], None]) -> None:
        """Call found with the fitted parameters when a fit has ended, or was cancelled."""
        self._found = found
        self._lock = threading.Lock()
        self._cancelled = threading.Event()
        self._state: dict[str, Any] = {"state": "idle"}

    @property
    def state(self) -> dict[str, Any]:
        """The stage and its progress (0 to 1) of a fit that runs, the report of one that ended."""
        return self._state

    def start(self, p: Parameters, motion: Motion) -> dict[str, Any]:
        """Start a fit of the contact's parameters, unless one runs; return the state."""
        with self._lock:
            if self._state["state"] != "running":
                self._cancelled.clear()
                self._state = {"state": "running", "stage": "start", "part": 0.0, "values": {}}
                threading.Thread(target=self._run, args=(p, motion), daemon=True).start()
            return self._state

    def cancel(self) -> dict[str, Any]:
        """Ask the fit to end with the best values so far; return the state."""
        self._cancelled.set()
        return self._state

    def _run(self, p: Parameters, motion: Motion) -> None:
        try:
            fit = identify([(p, motion)], progress=self._follow)
            self._found(fit.base)
        except StickslipError as error:
            self._state = {"state": "failed", "error": str(error)}
        except BaseException:
            self._state = {"state": "failed", "error": "the fit failed; the terminal says why"}
            raise
        else:
            misfit = fit.misfit.text if fit.misfit else None
            self._state = {
                "state": "done" if fit.complete else "cancelled",
                "report": fit.report(),
                "misfit": misfit,
            }

    def _follow(self, stage: str, part: float, best: Mapping[str, float]) -> None:
        if self._cancelled.is_set():
            raise KeyboardInterrupt  # the way to end an identification with its best so far
        values = to_json(dict(best))
        self._state = {"state": "running", "stage": stage, "part": part, "values": values}
