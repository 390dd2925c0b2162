# SPDX-License-Identifier: Apache-2.0
"""What errors say is short, whatever a file holds."""

from pathlib import Path

import pytest

from stickslip_ros.base.errors import LONGEST_MESSAGE, StickslipError
from stickslip_ros.physics.parameters import ParameterError, Parameters, read_yaml


@pytest.mark.parametrize("name", ["preload", "model", 1_000_000 * "n", "hysteresis_file"])
def test_a_value_of_a_megabyte_is_not_repeated(tmp_path: Path, name: str) -> None:
    path = tmp_path / "long.yaml"
    path.write_text(f"{name[:900_000]}: {'x' * 1_000_000}\n", encoding="utf-8")
    with pytest.raises(ParameterError) as caught:
        read_yaml(path)
    assert len(str(caught.value)) <= LONGEST_MESSAGE
    assert "long.yaml" in str(caught.value)


def test_begin_and_cure_are_kept() -> None:
    said = str(StickslipError(f"preload is {'9' * 1000}: lower it"))
    assert said.startswith("preload is 999")
    assert said.endswith("9: lower it")
    assert str(StickslipError("preload is 5")) == "preload is 5"
    assert Parameters.of({"preload": 1.0}).friction.preload == 1.0
