# SPDX-License-Identifier: Apache-2.0
"""The example of a user's own node under test passes, with pytest and with launch_testing."""

from importlib.util import find_spec

import pytest
from child import REPOSITORY, python

pytest.importorskip("rclpy")

FOLDER = REPOSITORY / "examples" / "my_node"


@pytest.mark.slow
def test_with_pytest() -> None:
    words = ("-q", "-p", "stickslip_ros.testing.plugin", "-p", "no:cacheprovider")
    done = python("-m", "pytest", *words, "test_my_node.py", cwd=FOLDER)
    assert "2 passed" in done.stdout, done.stdout


@pytest.mark.slow
@pytest.mark.usefixtures("stickslip_domain")
@pytest.mark.skipif(not find_spec("launch_testing"), reason="launch_testing is not installed")
def test_with_launch_testing() -> None:
    done = python("-m", "launch_testing.launch_test", str(FOLDER / "launch_test_my_node.py"))
    assert done.returncode == 0, done.stdout
