# SPDX-License-Identifier: Apache-2.0
"""The names of the package itself: there, documented, their examples true, loaded late."""

import doctest
import importlib
import inspect
import re
import shutil
import subprocess
from pathlib import Path

import public_api
import pytest
from child import python

import stickslip_ros as ss
from stickslip_ros import simulation

ROOT = Path(__file__).parent.parent
#: Names that are data.
DATA = {"PARAMETERS"}
#: Names that need ROS; the client has its own tests.
ROS = {"AxisClient", "AxisFault"}
PLAIN = [name for name in ss.__all__ if name not in ROS]

#: Where their examples stand.
MODULES = sorted(
    {""} | {getattr(ss, name).__module__.removeprefix("stickslip_ros.") for name in PLAIN
            if name not in DATA}
)  # fmt: skip


def run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an interpreter of its own, outside the checkout's folder."""
    return python(*arguments, "-c", program, cwd="/")


def test_every_name_is_there_once_and_documented() -> None:
    assert len(set(ss.__all__)) == len(ss.__all__)
    assert set(ss.__all__) <= set(dir(ss))
    for name in PLAIN:
        text = inspect.getdoc(getattr(ss, name)) or ""
        assert name in DATA or re.match(r"[A-Z`].*", text), name
        generated = text.startswith(f"{name}(")  # what dataclass and NamedTuple write by themselves
        assert not generated, f"{name} has no docstring of its own"


def test_every_function_of_the_library_has_an_example() -> None:
    found = filter(inspect.isroutine, (getattr(ss, name) for name in PLAIN))
    for function in found:
        if function.__module__.startswith("stickslip_ros.simulation"):
            assert ">>> " in (function.__doc__ or ""), function


@pytest.mark.slow
@pytest.mark.parametrize("module", MODULES)
def test_the_examples_print_what_they_show(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    found = importlib.import_module(f"stickslip_ros.{module}".rstrip("."))
    results = doctest.testmod(found, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert results.failed == 0
    if module.startswith("simulation"):
        assert results.attempted > 0


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/library.md"])
def test_the_examples_of_a_page_print_what_they_show(page: str) -> None:
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    results = doctest.testfile(str(ROOT / page), module_relative=False, optionflags=flags)
    assert (results.failed, results.attempted > 0) == (0, True)


def unnamed(recorded: set[str], now: set[str], changelog: str) -> list[str]:
    """Return the public names that have changed and that a changelog does not name.

    Of what comes or goes as a whole the name itself is enough; else the member has to be named.
    """
    wanted = set()
    for line in recorded ^ now:
        name = line.partition("(")[0]
        whole = name.partition(".")[0]
        others = recorded if line in now else now
        kept = any(re.split(r"[(.]", other)[0] == whole for other in others)
        wanted.add((name if kept else whole).partition(":")[2])
    return sorted(name for name in wanted if not re.search(rf"\b{re.escape(name)}\b", changelog))


@pytest.mark.slow
def test_what_changed_since_the_last_release_is_in_the_changelog() -> None:
    """The record is that of the release; `python test/public_api.py` renews it with the version."""
    pytest.importorskip("rclpy")
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    forthcoming = re.split(r"\n(?=\d+\.\d+\.\d+ \(\d)", text)[0]
    assert (
        unnamed(
            {*public_api.RECORD.read_text("utf-8").split("\n")} - {""},
            {*public_api.surface()},
            forthcoming,
        )
        == []
    )


def test_a_wrong_name_is_answered_with_the_right_one() -> None:
    with pytest.raises(AttributeError, match="'simulat'; did you mean simulate"):
        getattr(ss, "simulat")  # noqa: B009
    with pytest.raises(AttributeError, match=r"no attribute '_private'$"):
        getattr(ss, "_private")  # noqa: B009


def test_the_room_gives_what_the_package_gives() -> None:
    """Whatever was imported before: no module of the room has the name of a function."""
    assert [
        name for name in simulation.__all__ if getattr(simulation, name) is not getattr(ss, name)
    ] == []
    files = {file.stem for file in Path(simulation.__file__).parent.glob("*.py")}
    assert not files & set(simulation.__all__)


def test_the_old_name_of_the_room_works_with_a_warning() -> None:
    with pytest.warns(FutureWarning, match=r"stickslip_ros\.simulation since 2\.0\.0"):
        from stickslip_ros.library import simulate
    assert simulate is ss.simulate


def test_one_base_catches_every_error() -> None:
    kinds = [getattr(ss, name) for name in PLAIN if name.endswith(("Error", "Refused"))]
    assert len(kinds) > 5
    assert [kind for kind in kinds if not issubclass(kind, ss.StickslipError)] == []


def test_the_import_alone_loads_nothing() -> None:
    found = run("import stickslip_ros, sys; print('numpy' in sys.modules, 'scipy' in sys.modules)")
    assert found.stdout.split() == ["False", "False"], found.stderr


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_users_choice_of_a_plot_window_stays() -> None:
    """Pictures are written without a window, and without telling Matplotlib so for everybody."""
    modules = "stickslip_ros.pages.response", "stickslip_ros.reporting.picture"
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
        "a.command_steps(3)\n"
        "a.comand_steps(3)\n"
        "ss.simulat()\n"
        "size: float = ss.simulate(preload=0.5).step_size\n"
        "text: str = ss.simulate().step_size\n",
        encoding="utf-8",
    )
    mypy = ("-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"))
    found = python(*mypy, "robot.py", cwd=tmp_path, PYTHONPATH=str(site))
    lines = [int(line) for line in re.findall(r"robot\.py:(\d+): error", found.stdout)]
    assert lines == [4, 5, 7], found.stdout + found.stderr
    assert '"comand_steps"; maybe "command_steps"' in found.stdout
