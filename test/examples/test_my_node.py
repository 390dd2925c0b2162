# SPDX-License-Identifier: Apache-2.0
"""The example of a user's own node under test passes with launch_testing; with pytest, see J1."""

from importlib.util import find_spec

import pytest
from child import REPOSITORY, python

pytest.importorskip("rclpy")

FOLDER = REPOSITORY / "examples" / "my_node"


@pytest.mark.usefixtures("stickslip_domain")
@pytest.mark.skipif(not find_spec("launch_testing"), reason="launch_testing is not installed")
def test_with_launch_testing() -> None:
    done = python("-m", "launch_testing.launch_test", str(FOLDER / "launch_test_my_node.py"))
    assert done.returncode == 0, done.stdout
