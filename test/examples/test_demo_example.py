# SPDX-License-Identifier: Apache-2.0
"""The ROS side of the demo: what goes wrong is said by an error of its own."""

from pathlib import Path

import numpy as np
import pytest
from file_layer import FileLayer, each_fault
from live import Ros

pytest.importorskip("rclpy")

from stickslip_ros.base.shared_files import example
from stickslip_ros.cli.main import main
from stickslip_ros.client import AxisClient
from stickslip_ros.physics.parameters import Parameters
from stickslip_ros.ros.nodes.axis_node import AxisNode

demonstration = example("demo")
RESULTS = ("bag/bag_0.mcap", "bag/metadata.yaml", "response.png", "summary.txt")
DemonstrationError = demonstration.DemonstrationError


def test_a_recorder_that_is_gone(ros: Ros, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demonstration, "_TIMEOUT", 0.1)
    ros.add(AxisNode(context=ros.context))
    with (
        AxisClient() as client,
        pytest.raises(DemonstrationError, match="nobody offers /stickslip_recorder/stop"),
    ):
        demonstration.stop_recorder(client)


def test_its_table_says_what_simulate_says(capsys: pytest.CaptureFixture[str]) -> None:
    """Step and backstep are of settled cycles; of all, or the last one, they are other numbers."""
    friction = [{"0-amplitude (m)": "nan", "ringing frequency (Hz)": "nan"}] * 3
    recorded = demonstration.Recorded(
        np.zeros(0), np.zeros(0), [{"position": "0"}] * 3, friction,
        [{"real-time factor": "1", "missed deadlines": "0"}] * 2, 1,
    )  # fmt: skip
    table = demonstration.table_of(Parameters(), recorded)
    rows = {line[:22].strip(): line[22:].split() for line in table.splitlines()}
    moves = (("200", "1000"), ("-200", "1000"), ("20", "100"))
    for k, (steps, frequency) in enumerate(moves):
        assert main(["simulate", "--steps", steps, "--frequency", frequency]) == 0
        text = {
            line[:12].strip(): line[12:].split() for line in capsys.readouterr().out.splitlines()
        }
        for name, row in (("step size", "step size (nm)"), ("backstep", "backstep (nm)")):
            assert float(rows[row][k]) == pytest.approx(float(text[name][0]), abs=6e-3), name
        assert float(rows["mean speed (um/s)"][k]) == pytest.approx(
            float(text["mean speed"][0]), abs=6e-3
        )


@pytest.mark.parametrize("names", [("old", "new"), ("new",)])
def test_results_are_whole_or_as_before_whatever_fails(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    """Each call of the system fails once while the results are moved into place."""

    def replace(layer: FileLayer, place: Path) -> None:
        number, layer.fail_at = layer.fail_at, -1
        for text in names:
            for name in RESULTS:
                file = place / ("out" if text == "old" else "out/.new") / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text)
        layer.calls.clear()
        layer.fail_at = number
        demonstration.put_in_place(place / "out/.new", place / "out")

    for call, raised, place in each_fault(replace, tmp_path):
        found = {
            (place / "out" / name).read_text()
            for name in RESULTS
            if (place / "out" / name).exists()
        }
        assert isinstance(raised, OSError), call
        assert found == {"old"} & set(names), call
