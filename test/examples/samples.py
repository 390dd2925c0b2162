# SPDX-License-Identifier: Apache-2.0
"""The sample measurements that the package ships, made by the integrator of `bench_traces`.

    python test/examples/samples.py     writes them into examples/samples/

Nothing of the package is used: what the package finds in them is a result and not an echo.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))
from bench_traces import Axis, Drive, Sensor, bench_trace

Array = NDArray[np.float64]
FOLDER = Path(__file__).parent.parent.parent / "examples" / "samples"
#: Bouc-Wen loop: slope without hysteresis (m/V), the share by which the slope is less after a turn,
#: and the rate (1/V) at which the turn is forgotten.
_GAIN, _SHARE, _FORGETS = 0.64e-9, 0.3, 0.011


def forward() -> dict[str, Array]:
    """Ten steps at 0.4 N and 100 Hz, the runner alone."""
    sensor = Sensor(rate=100e3, noise=2e-9, zero=250e-9)
    found = bench_trace(Axis(), (Drive(10, pause=0.02),), sensor, rest=0.02)
    return {"time (s)": found.t, "position (nm)": 1e9 * found.x}


def there_and_back() -> dict[str, Array]:
    """Steps forward and backward at 1 N, with drift."""
    sensor = Sensor(rate=50e3, noise=3e-9, offset=2.5, drift=5e-8)
    drives = (Drive(8, pause=0.01), Drive(8, pause=0.02, direction=-1))
    found = bench_trace(Axis(preload=1.0), drives, sensor, rest=0.02, seed=2)
    return {"time (ms)": 1e3 * found.t, "x (um)": 1e6 * found.x}


def actuator_loop() -> dict[str, Array]:
    """Two triangles of 300 V by the law of Bouc and Wen, with 0.2 nm of noise."""
    times = np.linspace(0.0, 2.0, 4001)
    volts = 300.0 * (1.0 - np.abs(1.0 - 2.0 * (times % 1.0)))
    volts[-1] = 0.0
    memory = np.zeros(len(volts))  # V
    for k, change in enumerate(np.diff(volts)):
        memory[k + 1] = memory[k] + change - _FORGETS * abs(change) * memory[k]
    deflection = _GAIN * (volts - _SHARE * memory)
    deflection += 0.2e-9 * np.random.default_rng(3).standard_normal(len(volts))
    kept = slice(len(volts) // 2, None)  # the second loop closes
    return {
        "voltage (V)": volts[kept],
        "deflection (nm)": 1e9 * (deflection - deflection[2000])[kept],
    }


SAMPLES = {
    "steps_100hz.csv": (forward, (5, 1)),
    "there_and_back.csv": (there_and_back, (2, 4)),
    "actuator_loop.csv": (actuator_loop, (2, 2)),
}


def main() -> None:
    """Write every sample."""
    for name, (make, digits) in SAMPLES.items():
        columns = make()
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns)]
        for row in rows:
            lines.append(",".join(f"{v:.{d}f}" for v, d in zip(row, digits, strict=True)))
        (FOLDER / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
