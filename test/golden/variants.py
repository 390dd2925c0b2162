# SPDX-License-Identifier: Apache-2.0
"""This machine with another processor: child processes whose libraries leave features out."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import child
import numpy as np

HERE = Path(__file__).parent
_X86 = platform.machine() in ("x86_64", "AMD64")


@dataclass(frozen=True)
class Variant:
    """A processor, as environment variables of a child process make it."""

    name: str
    environment: dict[str, str]
    compiles: bool = False  #: all of it anew, into a cache of its own

    def results(self, folder: Path) -> dict[str, Any]:
        """Return `renew.results` of such a processor."""
        own = {"NUMBA_CACHE_DIR": str(folder)} if self.compiles else {}
        found: dict[str, Any] = json.loads(
            self._run("import json, renew; print(json.dumps(renew.results()))", **own)
        )
        assert not self.compiles or list(folder.rglob("*.nbc"))
        return found

    def record_again(self, bag: Path, out: Path) -> None:
        """Write the run of a bag as such a processor computes it."""
        self._run(
            "import sys; from stickslip_ros.cli.main import main\n"
            f"sys.exit(main(['bag', 'resimulate', {str(bag)!r}, '--out', {str(out)!r}]))"
        )

    def _run(self, code: str, **own: str) -> str:
        place = os.pathsep.join([str(HERE), child.environment()["PYTHONPATH"]])
        done = child.python("-c", code, **{**self.environment, **own, "PYTHONPATH": place})
        assert done.returncode == 0, done.stderr
        return done.stdout


def _numpy_features() -> list[str]:
    """Return the features of this processor that NumPy has code for and can do without."""
    core = getattr(np, "_core", None) or np.core
    module = core._multiarray_umath
    has = module.__cpu_features__
    return [name for name in module.__cpu_dispatch__ if has[name]]


def _without(features: list[str]) -> dict[str, str]:
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(features)}


FEATURES = _numpy_features()
#: Kernels of OpenBLAS that any processor of this kind can run
_KERNELS = ("Prescott", "Haswell") if _X86 else ("ARMV8", "CORTEXA57")
#: As little as NumPy can do with, and another kernel of linear algebra
LEAST = Variant("least", {**_without(FEATURES), "OPENBLAS_CORETYPE": _KERNELS[0]})
#: All of the same mathematical library, and so of the same bits
SAME_LIBRARY = (
    LEAST,
    *(Variant(f"without-{name}", _without(FEATURES[k:])) for k, name in enumerate(FEATURES)),
    *(Variant(kernel, {"OPENBLAS_CORETYPE": kernel}) for kernel in _KERNELS),
    *([Variant("generic", {"NUMBA_CPU_NAME": "generic"}, compiles=True)] if _X86 else []),
)
#: The same processor with the mathematical functions of those that have no fused operations
UNFUSED = Variant("unfused", {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F"})
#: Whether this machine's library has such functions
HAS_UNFUSED = _X86 and platform.libc_ver()[0] == "glibc"
