# SPDX-License-Identifier: Apache-2.0
"""The rooms of the code and the one way that imports may point, read from the sources.

The order is explained in CONTRIBUTING.md. A room that is not listed here has no place yet.
"""

import ast
import importlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = "stickslip_ros"
SOURCES = Path(__file__).parents[2] / PACKAGE

#: The folders from the bottom up, as CONTRIBUTING.md explains them, and the rooms in two of them
#: that have an order of their own. A room may import all below it, none beside or above it.
ORDER = (
    ("base",),
    ("physics/parameters",),
    ("physics/laws", "physics/waveforms"),
    ("physics/model",),
    ("physics/solver",),
    ("axis",),
    ("simulation",),
    ("recordings",),
    ("measurement",),
    ("measurement/identification",),
    ("measurement/twin",),
    ("emulator",),
    ("ros",),
    ("cli",),
)
MAY_USE = {
    room: {one for below in ORDER[:level] for one in below}
    for level, rooms in enumerate(ORDER)
    for room in rooms
}
MAY_USE["cli"].remove("ros")  # late only
#: What lies beside the folders: a shell starts it, or pytest, or it is a public name.
MAY_USE |= {"client": {"ros"}, "executables": {"base"}, "testing": {"base"}, "__main__": {"cli"},
            "__init__": {"base"}, "version": set()}  # fmt: skip
#: What a room may import inside functions only, so that it loads without ROS. The names of the
#: package itself are each loaded when they are used.
MAY_USE_LATE = {
    "cli": {"ros"},
    "testing": {"ros"},
    "executables": {"ros"},
    "__init__": {room for rooms in ORDER for room in rooms} | {"client"},
}

ROS_ROOMS = {"ros", "client"}
ROS_LATE_ROOMS = {"cli", "testing"}
ROS_STARTS = ("rclpy", "rosidl", "rosbag2", "rpyutils", "ament_", "launch", "ros2")
ROS_ENDS = ("_msgs", "_srvs", "_interfaces")

#: Below the nodes time is an argument, never read from a clock.
CLOCKLESS_ROOMS = set(MAY_USE) - {"base", "emulator", "ros", "testing", "cli"}


@dataclass(frozen=True)
class Import:
    module: str  # absolute, dotted
    line: int
    late: bool  # inside a function, or for the type checker only


def imports_of(file: Path, package_folder: Path) -> tuple[Import, ...]:
    """Every import of a file, relative ones made absolute."""
    return _imports_in(file.read_text(encoding="utf-8"), file.relative_to(package_folder))


@cache
def _imports_in(text: str, place: Path) -> tuple[Import, ...]:
    parents = [PACKAGE, *place.parent.parts]

    def walk(node: ast.AST, late: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, late)
        elif isinstance(node, ast.ImportFrom):
            base = parents[: len(parents) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            # `from package import room` names the room only here.
            for alias in node.names:
                yield Import(f"{module}.{alias.name}", node.lineno, late)
        else:
            inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typing_only = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
                yield from named(node, late)
            for child in ast.iter_child_nodes(node):
                yield from walk(child, late or inside or typing_only)

    def named(call: ast.Call, late: bool) -> Iterator[Import]:
        """What `import_module` is told: a name, or its beginning with the rest left open."""
        (name,) = call.args
        parts = name.values if isinstance(name, ast.JoinedStr) else [name]
        if isinstance(parts[0], ast.Constant):
            rest = "" if len(parts) == 1 else "*"
            yield Import(f"{parts[0].value!s}{rest}", call.lineno, late)

    return tuple(walk(ast.parse(text), False))


def files_named(module: str, package_folder: Path) -> list[Path]:
    """The files that an import loads; the `__init__` of folders on the way do not count."""
    inside = module.split(".")[1:]
    if inside and inside[-1].endswith("*"):
        named = package_folder.joinpath(*inside[:-1]).glob(f"{inside[-1]}.py")
        return [file for file in named if file.name != "main.py"]  # a shell starts it
    place = package_folder.joinpath(*inside)
    tried = (place.with_suffix(".py"), place / "__init__.py", place.parent.with_suffix(".py"),
             place.parent / "__init__.py")  # fmt: skip
    return [next(file for file in tried if file.is_file())]


def circles(package_folder: Path) -> list[list[str]]:
    """Files that import each other, at once or late, for the type checker or by a name."""
    graph = {
        file: {
            loaded
            for one in imports_of(file, package_folder)
            if one.module.split(".")[0] == PACKAGE
            for loaded in files_named(one.module, package_folder)
            if loaded != file
        }
        for file in sorted(package_folder.rglob("*.py"))
    }
    found: list[list[str]] = []
    while True:
        try:
            TopologicalSorter(graph).prepare()
            return found
        except CycleError as error:
            circle = error.args[1]
            found.append([str(file.relative_to(package_folder)) for file in circle])
            graph[circle[1]].discard(circle[0])  # the sorter names a file before who needs it


def is_ros(module: str) -> bool:
    top = module.split(".")[0]
    return top.startswith(ROS_STARTS) or top.endswith(ROS_ENDS)


def room_of(parts: Sequence[str]) -> str:
    """The room of a file or module, by its path below the package; "" if there is none."""
    names = ("/".join(parts[:2]), parts[0].removesuffix(".py"))
    return next((name for name in names if name in MAY_USE), "")


def complaint(room: str, found: Import) -> str | None:
    """What is wrong with an import in a room, None if nothing is."""
    top, *rest = found.module.split(".")
    if top == PACKAGE:
        target = room_of(rest) if rest and not rest[0].startswith("__") else "version"
        if target in {room, "version", *MAY_USE[room]}:
            return None
        if target in MAY_USE_LATE.get(room, ()):
            return None if found.late else f"may use {target} inside functions only"
        return f"may not use {target or rest[0]}"
    if is_ros(found.module) and room not in ROS_ROOMS:
        if room not in ROS_LATE_ROOMS:
            return f"may not use ROS ({top})"
        return None if found.late else f"may use ROS ({top}) inside functions only"
    if top == "time" and room in CLOCKLESS_ROOMS:
        return "may not read a clock"
    return None


def complaints(package_folder: Path) -> list[str]:
    """Everything that breaks the order of the rooms, as `file:line: what`."""
    found = []
    for file in sorted(package_folder.rglob("*.py")):
        name = file.relative_to(package_folder)
        if name.parts in (("physics", "__init__.py"),):
            continue  # a folder without names of its own
        room = room_of(name.parts)
        if not room:
            found.append(f"{name}: {name.parts[0]} is not a room that this test knows")
            continue
        for one in imports_of(file, package_folder):
            problem = complaint(room, one)
            if problem:
                found.append(f"{name}:{one.line}: {room} {problem}")
    return found


def test_imports_point_one_way() -> None:
    assert complaints(SOURCES) == []


def test_no_files_import_each_other_in_a_circle() -> None:
    assert circles(SOURCES) == []


def test_the_manifest_names_every_ros_package_in_use() -> None:
    manifest = (SOURCES.parent / "package.xml").read_text(encoding="utf-8")
    used = {
        found.module.split(".")[0]
        for file in SOURCES.rglob("*.py")
        for found in imports_of(file, SOURCES)
        if is_ros(found.module)
    }
    assert [name for name in sorted(used) if f"<exec_depend>{name}<" not in manifest] == []


def write(folder: Path, name: str, text: str) -> None:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


def test_a_wrong_import_is_found(tmp_path: Path) -> None:
    for name, text, problem in [
        ("physics/model/a.py", "import stickslip_ros.physics.solver", "may not use physics/solver"),
        ("physics/model/a.py", "from ...axis import device", "physics/model may not use axis"),
        ("axis/a.py", f"from {PACKAGE} import measurement", "axis may not use measurement"),
        ("simulation/a.py", f"def f():\n    import {PACKAGE}.recordings", "may not use recordings"),
        ("axis/a.py", "def f():\n    import rclpy.time", "axis may not use ROS (rclpy)"),
        ("axis/a.py", "from time import monotonic", "axis may not read a clock"),
        ("recordings/a.py", "from std_msgs.msg import Int32", "recordings may not use ROS"),
        ("cli/a.py", f"from {PACKAGE}.ros import x", "cli may use ros inside functions"),
        ("cli/a.py", "try:\n    import rclpy\nfinally: ...", "cli may use ROS (rclpy) inside"),
        ("__init__.py", "from .axis import Axis", "__init__ may use axis inside functions only"),
        ("attic/a.py", "", "attic is not a room"),
    ]:
        write(tmp_path, name, text)
        (found,) = complaints(tmp_path)
        assert problem in found
        (tmp_path / name).unlink()


def test_a_circle_is_found(tmp_path: Path) -> None:
    for back in [
        "from stickslip_ros.physics.model.a import A",
        "def f():\n    from stickslip_ros.physics.model import a",
        "if TYPE_CHECKING:\n    from .a import A",
        "import_module('stickslip_ros.physics.model.a')",
        "importlib.import_module(f'stickslip_ros.physics.model.{name}')",
        "from stickslip_ros.physics.model import A",  # through the room's own names
    ]:
        write(tmp_path, "physics/model/__init__.py", "from stickslip_ros.physics.model.a import A")
        write(tmp_path, "physics/model/a.py", "from stickslip_ros.physics.model.b import B")
        write(tmp_path, "physics/model/b.py", back)
        write(tmp_path, "physics/model/c.py", "from stickslip_ros.physics.model import A")
        assert any(
            {"physics/model/a.py", "physics/model/b.py"} <= {*circle}
            for circle in circles(tmp_path)
        )


@pytest.mark.parametrize("path", sorted(SOURCES.rglob("__init__.py")), ids=lambda p: p.parent.name)
def test_what_a_room_offers_is_there(path: Path) -> None:
    names = path.relative_to(SOURCES.parent).parent.parts
    if names[-1] in ("stickslip_ros", "client"):
        pytest.importorskip("rclpy")
    room = importlib.import_module(".".join(names))
    missing = [name for name in getattr(room, "__all__", ()) if not hasattr(room, name)]
    assert missing == []


#: NumPy chooses the code of these by the processor, which rounds the last digit.
BY_PROCESSOR = {
    "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "float_power", "cbrt",
    "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "arcsinh",
    "arccosh", "arctanh", "hypot", "dot", "vdot", "inner", "matmul", "tensordot", "einsum",
    "convolve", "correlate", "linalg", "fft", "polyfit", "poly", "roots", "polynomial",
}  # fmt: skip
#: What is recorded, or simulated again bit for bit, is computed here.
REPEATED_ROOMS = ("physics", "axis")
#: Decisions, not values
RANKS = {"np.linalg.matrix_rank"}


def rounded_by_processor(tree: ast.Module) -> list[str]:
    """Return what a file rounds by processor or version of Python, outside compiled code."""
    compiled = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and any(ast.unparse(one).startswith("compiled") for one in node.decorator_list)
        for inner in ast.walk(node)
    }
    found = []
    for node in ast.walk(tree):
        text = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
        if (isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)) or text.startswith(
            "scipy."
        ):
            found.append(ast.unparse(node))
        elif isinstance(node, ast.Name) and node.id == "sum" and node not in compiled:
            found.append("sum")  # since Python 3.12 it makes up for rounding
        elif text.startswith("np.") and text.split(".")[1] in BY_PROCESSOR and node not in compiled:
            found.append(text)
    return [one for one in found if one not in RANKS and one != "np.linalg"]


def test_what_is_repeated_to_the_bit_is_rounded_alike_on_every_processor() -> None:
    for room in REPEATED_ROOMS:
        for file in sorted((SOURCES / room).rglob("*.py")):
            found = rounded_by_processor(ast.parse(file.read_text(encoding="utf-8")))
            assert found == [], file


@pytest.mark.parametrize(
    "code", ["a @ b", "sum(a)", "np.exp(x)", "np.linalg.solve(a, b)", "scipy.signal"]
)
def test_arithmetic_that_depends_on_the_processor_is_seen(code: str) -> None:
    assert rounded_by_processor(ast.parse(f"def f(a, b, x):\n    return {code}"))
