# SPDX-License-Identifier: Apache-2.0
"""Every file in config/: read by a real node, complete, valid."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from live import Ros
from table_1 import TABLE_1

from stickslip_ros.axis import Axis
from stickslip_ros.physics.model import Plant
from stickslip_ros.physics.parameters import PARAMETERS, read_yaml

CONFIG = Path(__file__).resolve().parent.parent / "config"
FILES = sorted(CONFIG.glob("*.yaml"))
#: What a user should find spelt out, to change it.
ESSENTIAL = {"model", "preload", "mass", "amplitude", "frequency", "slewrate", "gain", "sigma_1"}

each_file = pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)


def named(file: Path) -> dict[str, Any]:
    """Return the values that a file names, as PyYAML reads them."""
    (body,) = yaml.safe_load(file.read_text(encoding="utf-8")).values()
    return dict(body["ros__parameters"])


@each_file
def test_a_file_makes_an_axis_that_steps(file: Path) -> None:
    """Valid on its own: names what is essential, contradicts nothing, moves the runner."""
    values = named(file)
    assert set(values) >= ESSENTIAL
    for name, value in values.items():  # 1e-6 would be a text and 1 an integer for other readers
        assert type(value) is PARAMETERS[name].kind, name
    axis = Axis(read_yaml(file))
    axis.command("steps", 3)
    axis.advance(1.0)
    assert axis.status.steps_done == 3
    assert axis.state.x > 0.0


def test_the_presets_are_what_their_first_lines_say() -> None:
    typical = named(CONFIG / "table1_typical.yaml")
    vibration = named(CONFIG / "table1_vibration.yaml")
    assert typical == {name: {**TABLE_1, "sigma_0ss": 1e7}[name] for name in typical}
    different = {name for name in typical | vibration if typical.get(name) != vibration.get(name)}
    assert different == {"sigma_0", "sigma_0_slope", "sigma_0_offset"}


def test_the_columns_of_table_2() -> None:
    """As printed; z_ss of EPM_calc is what Eq. 8 makes of it at the preload of the file."""
    for name, model, z_ba, z_ss in [
        ("table2_lugre", "lugre", None, None),
        ("table2_epm_calc", "epm_calc", 100e-9, 450e-9),
        ("table2_epm_fix", "epm_fix", 50e-9, 100e-9),
    ]:
        p = read_yaml(CONFIG / f"{name}.yaml")
        assert p.friction.model == model
        names = ("sigma_0", "sigma_1", "sigma_2", "mu_s", "mu_k", "mass", "v_stribeck")
        assert [p.flat()[name] for name in names] == [1e6, 5.0, 0.0, 0.3, 0.2, 3e-3, 1e-3]
        contact = Plant.of(p).contact
        if z_ba is not None and z_ss is not None:
            assert contact.z_ba == pytest.approx(z_ba)
            assert (contact.z_s if model == "epm_calc" else contact.z_ss) == pytest.approx(z_ss)


def test_a_controller_steps_with_its_full_drive_from_lowest_to_highest_frequency() -> None:
    """The slip fits into the shortest cycle, and a step is most of the stroke."""
    for name, limits in [
        ("mcs_like", {"max_frequency": 18500.0, "max_voltage": 100.0, "amplitude_levels": 4095}),
        ("mcs2_like", {"max_frequency": 2e4, "max_voltage": 100.0, "amplitude_levels": 65535}),
        ("anc300_like", {"max_frequency": 1e4, "max_voltage": 150.0, "amplitude_levels": 0}),
    ]:
        p = read_yaml(CONFIG / f"{name}.yaml")
        assert {key: p.flat()[key] for key in limits} == limits
        axis = Axis(p)
        axis.command("amplitude", p.actuator.max_voltage)
        stroke = p.actuator.max_voltage * p.actuator.gain
        for hertz, steps in ((p.drive.min_frequency, 3), (p.drive.max_frequency, 2000)):
            axis.command("frequency", hertz)
            axis.command("steps", steps)
            axis.advance(axis.state.t + steps / hertz + 0.1)
            assert axis.status.steps_done == steps
            assert 0.9 * stroke < axis.status.mean_step < 1.02 * stroke


def test_a_real_node_takes_it(ros: Ros) -> None:
    pytest.importorskip("rclpy")
    from stickslip_ros.ros.nodes.axis_node import AxisNode

    for file in FILES:
        arguments = ["--ros-args", "--params-file", str(file)]
        node = AxisNode(context=ros.context, cli_args=arguments)
        assert {name: node.get_parameter(name).value for name in named(file)} == named(file)
        assert node.axis.parameters == read_yaml(file)
        node.destroy_node()
