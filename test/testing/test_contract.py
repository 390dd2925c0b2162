# SPDX-License-Identifier: Apache-2.0
"""The contract: all our drivers pass it, and no planted fault gets through."""

from pathlib import Path

import pytest
from child import python
from faulty import FAULTS

from stickslip_ros.testing import contract
from stickslip_ros.testing.axis_drivers import Offline

ALL = 21


@pytest.fixture(autouse=True)
def no_options_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    """The inner runs know only their own options, which colcon passes this way, and plugins."""
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # loading them takes a second


class Outcomes:
    """Collects what became of each test of an inner run."""

    def __init__(self) -> None:
        self.of: dict[str, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Take an outcome; a failure in the set-up or at the end counts as one too."""
        name = report.nodeid.partition("::")[2]
        if report.when == "call" or report.outcome != "passed":
            self.of[name] = report.outcome

    def were(self, outcome: str) -> set[str]:
        """Return the tests with that outcome, without their parameters."""
        return {name.partition("[")[0] for name, found in self.of.items() if found == outcome}


def run_contract(driver: str, folder: Path, only: str = "") -> Outcomes:
    """Run the contract, or one test of it, in this process."""
    outcomes = Outcomes()
    file = str(contract.__file__)
    options = ["-p", "no:terminal", "-p", "no:cacheprovider"]
    options += ["-p", "stickslip_ros.testing.plugin", "--stickslip-driver", driver, "-k", only]
    options += ["-c", str(folder / "none.toml"), "--rootdir", str(folder)]
    (folder / "none.toml").write_text("")
    pytest.main([*options, file], plugins=[outcomes])
    return outcomes


@pytest.mark.parametrize(
    "driver",
    [
        "offline",
        pytest.param("our_drivers:EmulatedAnc300", marks=pytest.mark.long),
        pytest.param("our_drivers:OverRos", marks=pytest.mark.long),
    ],
)
def test_our_drivers_keep_it(driver: str, tmp_path: Path) -> None:
    if driver.endswith("OverRos"):
        pytest.importorskip("rclpy")
    outcomes = run_contract(driver, tmp_path)
    assert len(outcomes.of) == ALL
    assert outcomes.were("failed") == set()
    # An ANC300 has neither a closed loop nor diagnostics.
    assert len(outcomes.were("skipped")) == (6 if driver.endswith("Anc300") else 0)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found(fault: type[Offline], tmp_path: Path) -> None:
    outcomes = run_contract(f"faulty:{fault.__name__}", tmp_path, FAULTS[fault])
    assert FAULTS[fault] in outcomes.were("failed")


def test_a_dead_port_is_told_once(tmp_path: Path) -> None:
    (tmp_path / "lab.py").write_text(
        "import socket\n\ndef connect():\n    socket.create_connection(('127.0.0.1', 1))\n"
    )
    options = ("--pyargs", "-p", "stickslip_ros.testing.plugin", "-p", "no:cacheprovider")
    file = str(contract.__file__)
    found = python(
        "-m", "pytest", *options, file, "--stickslip-driver", "lab:connect", cwd=tmp_path
    )
    assert found.returncode == pytest.ExitCode.USAGE_ERROR
    assert (found.stdout + found.stderr).count("refused") == 1, found.stdout + found.stderr


def test_a_driver_that_is_none_is_bad_use() -> None:
    for name, complaint in [
        ("mine", "offline"),
        ("nowhere:Driver", "nowhere"),
        ("faulty:Missing", "Missing"),
        ("faulty:NotADriver", "subclass stickslip_ros.testing.driver.Driver"),
    ]:
        from stickslip_ros.testing.driver import driver_named

        with pytest.raises(pytest.UsageError, match=complaint):
            driver_named(name)
