# SPDX-License-Identifier: Apache-2.0
"""Where compiled code is kept, and that a user is told when it is made."""

import grp
import os
import pwd
import re
import runpy
import time
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest
from child import REPOSITORY, python

from stickslip_ros.axis import Axis
from stickslip_ros.base import compiled as module
from stickslip_ros.base import numba_internals
from stickslip_ros.base.arrays import Array
from stickslip_ros.base.compiled import compiled, report_compilation


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no such rights here")
def test_it_is_kept_where_its_user_may_write_and_nobody_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the package as Python does, else at home; machine code of others must not run."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert Path(module.cache_folder()).parent == Path(module.__file__).parents[1] / "__pycache__"
    with monkeypatch.context() as patch:  # as after `sudo pip install` or in a ROS installation
        patch.setattr(os, "access", lambda *_: False)
        patch.setenv("HOME", "/home/somebody")
        assert Path(module.cache_folder()).parent == Path("/home/somebody/.cache/stickslip_ros")
        patch.setenv("XDG_CACHE_HOME", "/fast")
        assert Path(module.cache_folder()).parent == Path("/fast/stickslip_ros")
    cache, home = tmp_path / "cache", tmp_path / "home"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    chosen = Path(module.cache_folder())
    assert chosen.parent == cache
    chosen.mkdir(parents=True)
    assert Path(module.cache_folder()) == chosen
    for folder in (chosen, cache):
        folder.chmod(0o777)
        assert Path(module.cache_folder()).parent == home / "stickslip_ros"
        folder.chmod(0o755)
    for folder in (cache, home):
        folder.mkdir(exist_ok=True)
        folder.chmod(0o777)
    assert module.cache_folder() == ""


def test_a_folder_of_a_group_with_others_is_none_of_its_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A group that is this user's own, as most systems make one, has nobody else in it."""
    cache, home = tmp_path / "cache", tmp_path / "home"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    cache.mkdir()
    cache.chmod(0o775)
    me = pwd.getpwuid(os.getuid())
    members: list[str] = []
    monkeypatch.setattr(grp, "getgrgid", lambda _: SimpleNamespace(gr_mem=members))
    monkeypatch.setattr(pwd, "getpwall", lambda: [me])
    assert Path(module.cache_folder()).parent == cache
    members.append("somebody")
    assert Path(module.cache_folder()).parent == home / "stickslip_ros"
    module._Reporter()._say()
    assert f"others can write to {cache}, so {module.cache_folder()} is used" in (
        capsys.readouterr().err
    )
    cache.chmod(0o1775)  # sticky: nobody replaces what is of this user
    (cache / "x").mkdir(mode=0o755)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache / "x"))
    assert Path(module.cache_folder()).parent == cache / "x"


def test_where_a_link_leads_is_looked_at_as_its_name_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Others could put a folder of theirs where the link of this user leads."""
    shared, cache = tmp_path / "shared", tmp_path / "cache"
    (shared / "mine").mkdir(parents=True, mode=0o755)
    cache.symlink_to(shared / "mine")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    assert Path(module.cache_folder()).parent == cache
    shared.chmod(0o777)
    assert Path(module.cache_folder()).parent == tmp_path / "home" / "stickslip_ros"
    module._Reporter()._say()
    assert f"others can write to {shared}, so " in capsys.readouterr().err


def test_an_edit_in_any_file_of_the_kernel_has_a_folder_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or what was compiled from older text, or with older numbers, would go on running."""
    monkeypatch.setattr(module, "_PACKAGE", tmp_path)
    (tmp_path / "physics" / "model" / "friction").mkdir(parents=True)
    (tmp_path / "physics" / "solver").mkdir()
    for name in ("physics/model/friction/law.py", "physics/solver/method.csv"):
        folders = set()
        for text in ("1", "2", "1"):
            (tmp_path / name).write_text(text)
            folders.add(module.cache_folder())
        assert len(folders) == 2, name


def test_what_is_compiled_lands_in_that_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_FOLDER", str(tmp_path / "deep" / "cache"))

    @compiled
    def ratio(a: float, b: float) -> float:
        return a / b

    assert ratio(1.0, 0.0) == float("inf")  # and it divides as numpy does
    assert list((tmp_path / "deep" / "cache").rglob("*.nbi"))


@pytest.mark.parametrize("place", ["", "no locator"])
def test_without_any_folder_it_still_compiles(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    """In every process anew then, but it runs."""

    def no_locator(function: object) -> object:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(module, "_FOLDER", place)
    if place:
        monkeypatch.setattr(numba_internals._Cache, "_impl_class", staticmethod(no_locator))

    @compiled
    def half(x: float) -> float:
        return 0.5 * x

    assert half(4.0) == 2.0
    assert half.signatures  # type: ignore[attr-defined]


def test_compiled_functions_and_those_of_others_call_each_other() -> None:
    """Each is linked once, whoever calls it; what is for None is not compiled for an array."""

    @compiled
    def twice(x: float) -> float:
        return 2.0 * x

    @compiled
    def total(values: Array | None) -> float:
        if values is None:
            return unknown  # type: ignore[name-defined,no-any-return]  # noqa: F821
        return twice(values[0]) + twice(values[1])

    of_another = numba.njit(lambda values: sum([total(values) for _ in range(2)]))

    @compiled
    def all_of_them(values: Array) -> float:
        return float(of_another(values) + total(values) + twice(1.0))

    values = np.array([1.0, 2.0])
    assert (total(values), of_another(values), all_of_them(values)) == (6.0, 12.0, 20.0)


_LOADED_THEN_COMPILED = """
import sys
import numba, numpy as np
from stickslip_ros.base import compiled as module
module._FOLDER = sys.argv[1]
sys.path.insert(0, sys.argv[1])
from kept import twice
print(twice(np.arange(3.0)).tolist(), "scipy.linalg" in sys.modules, len(twice.stats.cache_hits))
print(numba.njit(lambda a: np.dot(twice(a), a))(np.ones(4)))
"""


@pytest.mark.long
def test_what_was_compiled_is_loaded_without_what_compiling_needs(tmp_path: Path) -> None:
    """And what is compiled after that has all of it: here the BLAS that numba takes from SciPy."""
    (tmp_path / "kept.py").write_text(
        "from stickslip_ros.base.compiled import compiled\n"
        "@compiled\ndef twice(a):\n    return 2.0 * a\nimport numpy as np\n"
    )
    told = [python("-c", _LOADED_THEN_COMPILED, str(tmp_path)) for _ in range(2)]
    assert [run.returncode for run in told] == [0, 0], told[1].stderr
    assert told[0].stdout.splitlines() == ["[0.0, 2.0, 4.0] True 0", "8.0"]
    assert told[1].stdout.splitlines() == ["[0.0, 2.0, 4.0] False 1", "8.0"]


def test_a_function_is_compiled_once_for_all_its_callers() -> None:
    """With other constants too, and with machine code only of what Python calls."""

    @compiled
    def power(x: float, n: int) -> float:
        return x**n

    @compiled
    def both(x: float) -> float:
        return power(x, 2) + power(x, 3)

    @compiled
    def outer(x: float) -> float:
        return both(x) + power(x, 4)

    assert outer(2.0) == 28.0
    assert not power.signatures  # type: ignore[attr-defined]
    assert len(power.part().overloads) == 1  # type: ignore[attr-defined]
    assert power(2.0, 2) == 4.0  # and it can be called by itself


#: Two functions whose closures have one text; which is compiled first, and which are called.
_NAMESAKES = """
import sys

import numba

from stickslip_ros.base import numba_internals


def scaled_by(factor):
    @numba.njit
    def scaled(x):
        y = 0.0
        for _ in range(3):  # too much to be inlined
            y += factor(x)
            print("")
        return y

    return scaled


@numba.njit
def one(x):
    return x


@numba.njit
def ten(x):
    return 10.0 * x


ones, tens = scaled_by(one), scaled_by(ten)


@numba.njit(cache=True)
def first(x):
    return ones(x)


@numba.njit(cache=True)
def second(x):
    return tens(x)


sys.stderr.write(" ".join(str(globals()[name](1.0)) for name in sys.argv[1:]))
"""


@pytest.mark.long
def test_namesakes_that_two_processes_compiled_stay_apart(tmp_path: Path) -> None:
    program = tmp_path / "namesakes.py"
    program.write_text(_NAMESAKES)

    def run(*names: str) -> str:
        return python(str(program), *names, NUMBA_CACHE_DIR=str(tmp_path)).stderr

    assert (run("first"), run("second")) == ("3.0", "30.0")
    assert run("first", "second") == "3.0 30.0"


@pytest.mark.parametrize("version", ["0.60.0", "of today"])
def test_with_a_numba_that_is_not_known_it_compiles_as_numba_promises(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path, version: str
) -> None:
    """Quietly: the same results, kept on disk as well."""
    monkeypatch.setattr("numba.__version__", version)
    monkeypatch.setattr(module, "_FOLDER", str(tmp_path / "cache"))

    @compiled
    def half(x: float) -> float:
        return 0.5 * x

    @compiled
    def quarter(x: float) -> float:
        return half(half(x))

    assert quarter(4.0) == 1.0
    assert half.signatures  # type: ignore[attr-defined]
    assert not hasattr(half, "part")
    assert len([*(tmp_path / "cache").rglob("*.nbi")]) == 2
    assert capfd.readouterr().err == ""


def test_the_range_of_known_versions_is_that_of_the_packaging() -> None:
    (needed,) = re.findall(r'"numba>=([\d.]+)"', (REPOSITORY / "setup.py").read_text())
    assert needed == ".".join(map(str, numba_internals.TESTED[0]))
    assert numba_internals.is_known()


@pytest.mark.long
def test_the_first_run_says_that_it_compiles_and_the_second_does_not(tmp_path: Path) -> None:
    """With an empty cache, as on a fresh machine; the only test that compiles everything anew."""
    command = ("-m", "stickslip_ros.cli.main", "simulate", "--steps", "1")
    runs = [python(*command, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert [run.returncode for run in runs] == [0, 0]
    assert runs[0].stdout == runs[1].stdout != ""
    assert runs[0].stderr.startswith("compiling the solver, once for this version")
    said = [line for line in runs[0].stderr.splitlines() if line != "simulating steps ..."]
    shares = [line.rpartition(": ")[2] for line in said]
    numbers = [int(share.removesuffix(" %")) for share in shares]
    assert numbers == sorted(numbers)
    assert runs[1].stderr in ("", "simulating steps ...\n")  # on a busy machine


def test_functions_of_all_rooms_count_as_compiled() -> None:
    """Else a terminal would read 0 % to the end."""
    reporter = module._Reporter()
    reporter.on_end(SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=Axis.advance)}))
    assert reporter._done == {"stickslip_ros.axis.device.Device.advance"}


_LATE = """
import sys
from stickslip_ros.axis import Axis

def loaded():
    mine = [vars(m) for name, m in sys.modules.items() if name.startswith("stickslip_ros.")]
    functions = {id(f): f for module in mine for f in module.values()}
    lists = (getattr(f, "signatures", None) for f in functions.values())
    return sum(len(one) for one in lists if isinstance(one, list)), len(sys.modules)

several = {"contacts": 2, "contact_spread": 0.1}
for values in ({}, several, {"dwell_growth": 0.1, "amplifier_bandwidth": 2e4}, {"creep": 0.01}):
    axis = Axis({"frequency": 1e3, **values})
    axis.compile_ahead()
    axis.status
    before = loaded()
    for changes in ({}, {"sensor_bandwidth": 3e3, "spring": 1e3}, {"sensor_order": 2}):
        axis.command("jog", -2e3)
        axis.advance(axis.state.t + 3e-3)
        axis.command("parameters", changes)
        for command, value in (("scan", 10.0), ("position", 1e-7), ("load", 0.01), ("steps", 2)):
            axis.command(command, value)
            axis.advance(axis.state.t + 1e-3)
            axis.status
    if loaded() != before:
        print("loaded late with", values, before, loaded())
"""


@pytest.mark.long
def test_a_running_axis_compiles_and_loads_nothing() -> None:
    """Ten seconds of it would be silence, a minute on a busy machine."""
    done = python("-c", _LATE)
    assert (done.stdout, done.stderr) == ("", "")


def test_a_slow_drive_with_a_sensor_of_a_bandwidth_is_compiled_at_once() -> None:
    """Its cycles of a thousand seconds are not sampled."""
    Axis({"sensor_bandwidth": 3e3}).compile_ahead()
    began = time.process_time()
    Axis({"frequency": 1e-4, "sensor_bandwidth": 3e3}).compile_ahead()
    assert time.process_time() - began < 5.0


def test_a_damaged_cache_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be an UnpicklingError, or a crash in machine code that is none."""
    cache, program = tmp_path / "cache", tmp_path / "program.py"
    monkeypatch.setattr(module, "_FOLDER", str(cache))
    program.write_text(
        "from stickslip_ros.base.compiled import compiled\n"
        "@compiled\ndef twice(x):\n    return 2.0 * x\nvalue = twice(4.0)\n"
    )

    def is_compiled() -> bool:
        """Run it anew; return whether it had to be compiled."""
        found = runpy.run_path(str(program))
        assert found["value"] == 8.0
        return not found["twice"].stats.cache_hits

    assert is_compiled()
    for suffix in (".nbi", ".nbc"):
        (file,) = cache.rglob(f"*{suffix}")
        for damage in ("one bit", "cut", "random", "empty"):
            whole = file.read_bytes()
            half = len(whole) // 2
            changed = whole[:half] + bytes([whole[half] ^ 1]) + whole[half + 1 :]
            broken = {"cut": whole[:half], "empty": b"", "one bit": changed}
            file.write_bytes(broken.get(damage, os.urandom(len(whole))))
            assert is_compiled(), damage
    assert not is_compiled()


def test_without_numba_the_same_comes_out_of_plain_python() -> None:
    run = (
        "import sys; sys.modules['numba'] = None\n"
        "from stickslip_ros.axis import Axis\n"
        "axis = Axis({'frequency': 1000.0})\n"
        "axis.command('steps', 3)\n"
        "axis.advance(0.004)\n"
        "print(axis.state.x)\n"
    )
    slow = float(python("-W", "ignore", "-c", run).stdout)
    axis = Axis({"frequency": 1000.0})
    axis.command("steps", 3)
    axis.advance(0.004)
    assert axis.state.x > 3e-7
    assert slow == pytest.approx(axis.state.x, abs=1e-12)


def test_without_numba_it_says_why_it_is_slow(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "numba", None)
    with report_compilation():
        pass
    assert "pip install numba" in capsys.readouterr().err
    assert compiled(abs) is abs
