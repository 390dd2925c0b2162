# SPDX-License-Identifier: Apache-2.0
"""The names of the package itself: one object each, loaded late, with what they need named."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from child import python

import stickslip_ros as ss
from stickslip_ros import simulation

ROOT = Path(__file__).parent.parent
ROS = {"AxisClient", "AxisFault"}  # names that need it; the client has its own tests
PLAIN = [name for name in ss.__all__ if name not in ROS]


def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an interpreter of its own, outside the checkout's folder."""
    return python(*arguments, "-c", program, cwd="/")


def test_a_wrong_name_is_answered_with_the_right_one() -> None:
    with pytest.raises(AttributeError, match="'simulat'; did you mean simulate"):
        getattr(ss, "simulat")  # noqa: B009
    with pytest.raises(AttributeError, match=r"no attribute '_private'$"):
        getattr(ss, "_private")  # noqa: B009


def test_a_room_gives_what_the_package_gives() -> None:
    """Whatever was imported before: no module of the room has the name of a function."""
    room = simulation
    names = {*room.__all__} & {*ss.__all__}
    assert [name for name in names if getattr(room, name) is not getattr(ss, name)] == []
    files = {file.stem for file in Path(str(room.__file__)).parent.glob("*.py")}
    assert names and not files & names


def test_one_base_catches_every_error() -> None:
    kinds = [getattr(ss, name) for name in PLAIN if name.endswith(("Error", "Refused"))]
    assert len(kinds) > 5
    assert [kind for kind in kinds if not issubclass(kind, ss.StickslipError)] == []


def test_the_import_alone_loads_nothing() -> None:
    found = run("import stickslip_ros, sys; print('numpy' in sys.modules, 'scipy' in sys.modules)")
    assert found.stdout.split() == ["False", "False"], found.stderr


def test_a_run_needs_four_libraries_and_the_rest_is_asked_for_by_name() -> None:
    found = run(
        "import sys\n"
        "others = 'mcap mcap_ros2 zstandard lz4 matplotlib jinja2 plotly rich tqdm rclpy'\n"
        "sys.modules.update(dict.fromkeys([*others.split(), 'rcl_interfaces']))\n"
        "import stickslip_ros as ss\n"
        "from stickslip_ros.cli.main import main\n"
        "run = ss.simulate(steps=2)\n"
        "for ask in (run.plot, lambda: ss.open_bag, lambda: ss.identify, lambda: ss.AxisClient):\n"
        "    try:\n"
        "        ask()\n"
        "    except ss.StickslipError as error:\n"
        "        print(error)\n"
        "print(main(['simulate', '--steps', '2']))\n"
    )
    asked = [
        "a plot needs matplotlib: pip install matplotlib",
        "stickslip_ros.open_bag needs mcap: pip install mcap",
        "stickslip_ros.identify needs tqdm: pip install tqdm",
        "stickslip_ros.AxisClient needs rcl_interfaces: "
        "source a ROS, or pip install 'stickslip_ros[ros]'",
    ]
    assert found.stdout.splitlines() == [*asked, "2"], found.stderr
    assert found.stderr.splitlines() == [
        "stickslip simulate: simulate needs tqdm: pip install tqdm"
    ]


def test_the_users_choice_of_a_plot_window_stays() -> None:
    """Pictures are written without a window, and without telling Matplotlib so for everybody."""
    modules = "stickslip_ros.cli.pages.response", "stickslip_ros.base.reporting.picture"
    loaded = "".join(f"import {module}\n" for module in modules)
    found = run(
        "import matplotlib\nmatplotlib.use('svg')\n" + loaded + "print(matplotlib.get_backend())\n"
        "from matplotlib.figure import Figure\nimport io\n"
        "Figure().savefig(io.BytesIO(), format='png')\n"
    )
    assert found.stdout == "svg\n", found.stderr


@pytest.mark.long
def test_a_users_project_under_strict_mypy_finds_a_misspelt_method(tmp_path: Path) -> None:
    """As installed: the package says that it is typed, and names no name that it has not."""
    pytest.importorskip("mypy")
    site = tmp_path / "site"  # mypy believes what is found there only if it has a py.typed
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "stickslip_ros", site / "stickslip_ros", ignore=ignored)
    (tmp_path / "robot.py").write_text(
        "import stickslip_ros as ss\n"
        "a = ss.Axis({'preload': 0.5})\n"
        "a.command('steps', 3)\n"
        "a.comand('steps', 3)\n"
        "ss.simulat()\n"
        "size: float = ss.simulate(preload=0.5).step_size\n"
        "text: str = ss.simulate().step_size\n",
        encoding="utf-8",
    )
    mypy = ("-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"))
    found = python(*mypy, "robot.py", cwd=tmp_path, PYTHONPATH=str(site))
    lines = [int(line) for line in re.findall(r"robot\.py:(\d+): error", found.stdout)]
    assert lines == [4, 5, 7], found.stdout + found.stderr
    assert '"comand"; maybe "command"' in found.stdout
