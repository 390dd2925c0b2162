# SPDX-License-Identifier: Apache-2.0
"""The files that describe the package agree with each other and with what is in the tree."""

import ast
import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools

import stickslip_ros

ROOT = Path(__file__).parents[2]
SHARE = "share/stickslip_ros"


@pytest.fixture
def manifest() -> ET.Element:
    """package.xml"""
    return ET.parse(ROOT / "package.xml").getroot()


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What setup.py hands to setuptools."""
    handed: dict[str, Any] = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, "setup", handed.update)
    runpy.run_path("setup.py")
    return handed


def project_name(requirement: str) -> str:
    """`numpy>=1.26` -> `numpy`"""
    name = re.match(r"[\w.-]+", requirement)
    assert name, requirement
    return name[0].lower()


def test_manifest_is_format_3_with_every_required_tag(manifest: ET.Element) -> None:
    assert (manifest.tag, manifest.get("format")) == ("package", "3")
    for tag in ("name", "version", "description", "maintainer", "license"):
        found = manifest.findall(tag)
        assert len(found) == 1, tag
        assert (found[0].text or "").strip(), tag
    assert manifest.findtext("license") == "Apache-2.0"
    assert manifest.findtext("export/build_type") == "ament_python"
    # With an address that it cannot read, colcon takes the package for plain Python, silently.
    maintainer = manifest.find("maintainer")
    assert maintainer is not None
    address = maintainer.get("email", "")
    assert re.fullmatch(r"[a-z.+-]+@[a-z0-9-]+(\.[a-z0-9-]+)*\.example", address)


def test_names_and_versions_agree(manifest: ET.Element, setup: dict[str, Any]) -> None:
    assert manifest.findtext("name") == setup["name"] == stickslip_ros.__name__
    assert manifest.findtext("version") == setup["version"] == stickslip_ros.__version__
    assert re.fullmatch(r"\d+\.\d+\.\d+", stickslip_ros.__version__)


def test_what_python_needs_rosdep_knows_too(manifest: ET.Element, setup: dict[str, Any]) -> None:
    key_of = {"pyyaml": "python3-yaml"}
    key_of |= dict.fromkeys(("mcap", "mcap-ros2-support", "zstandard", "lz4"), "mcap-ros2-support")
    without_key = {"numba", "plotly"}
    keys = {depend.text for depend in manifest.findall("exec_depend")}
    for name in map(project_name, setup["install_requires"]):
        if name not in without_key:
            assert key_of.get(name, f"python3-{name}") in keys


def test_every_library_has_its_oldest_version_and_every_python_is_named(
    setup: dict[str, Any],
) -> None:
    assert [one for one in setup["install_requires"] if not re.search(r">=\d", one)] == []
    named = re.findall(r"Python :: 3\.(\d+)", "\n".join(setup["classifiers"]))
    page = re.search(r"Python 3\.(\d+) to 3\.(\d+)", (ROOT / "README.md").read_text("utf-8"))
    assert page is not None
    first, last = map(int, page.groups())
    assert [*map(int, named)] == [*range(first, last + 1)]
    assert setup["python_requires"] == f">=3.{first}"


def test_addresses_stand_in_the_manifest_alone(setup: dict[str, Any]) -> None:
    """So that who publishes the package replaces the placeholders in one file."""
    suffixes = {".py", ".md", ".rst", ".toml", ".yaml", ".yml", ".cff", ".json", ".xml", ".cfg"}
    made = {".venv", ".git", ".mypy_cache", "_build", "build", "demo"}
    places = [place for place in ROOT.iterdir() if place.name not in made]
    files = [*places, *(file for place in places for file in place.rglob("*"))]
    found = {
        str(file.relative_to(ROOT))
        for file in files
        if file.suffix in suffixes
        if re.search(r"(stickslip-ros|forge)[.]example", file.read_text("utf-8", "replace"))
    }
    assert found == {"package.xml"}
    assert "](docs/" not in setup["long_description"], "a link that leads nowhere outside"


def test_every_room_is_a_package(setup: dict[str, Any]) -> None:
    folders = {file.parent for file in (ROOT / "stickslip_ros").rglob("*.py")}
    names = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert names == set(setup["packages"]), "a folder has no __init__.py"


def test_every_data_file_is_installed(setup: dict[str, Any]) -> None:
    installed = {
        f"{folder}/{Path(file).name}": file
        for folder, files in setup["data_files"]
        for file in files
    }
    expected = ["share/ament_index/resource_index/packages/stickslip_ros", f"{SHARE}/package.xml"]
    for folder in ("config", "examples", "launch", "urdf"):
        suffixes = {".py", ".ipynb", ".yaml", ".urdf", ".xacro", ".xml", ".json", ".csv", ".md"}
        suffixes |= {".rviz"}
        files = [file for file in (ROOT / folder).rglob("*") if file.suffix in suffixes]
        assert files, folder
        expected += [f"{SHARE}/{file.relative_to(ROOT)}" for file in files]
    assert sorted(installed) == sorted(expected)
    assert all((ROOT / file).is_file() for file in installed.values())


def test_every_file_beside_the_sources_is_installed(setup: dict[str, Any]) -> None:
    """Such as the templates of pages, which setuptools leaves out unless it is told."""
    package = ROOT / "stickslip_ros"
    beside = {
        file
        for file in package.rglob("*")
        if file.is_file() and file.suffix != ".py" and "__pycache__" not in file.parts
    }
    installed = {
        file
        for name, patterns in setup["package_data"].items()
        for pattern in patterns
        for file in ROOT.joinpath(*name.split(".")).glob(pattern)
    }
    assert beside
    assert beside == installed


def test_every_entry_point_leads_to_a_function(setup: dict[str, Any]) -> None:
    # Read, not imported: the nodes need ROS.
    scripts = [script.split(" = ") for script in setup["entry_points"]["console_scripts"]]
    nodes = {"axis_node", "recorder_node", "replay_node", "square", "twin_node"}
    assert {name for name, _ in scripts} == {"stickslip", *nodes}
    for name, target in scripts:
        module, function = target.split(":")
        file = ROOT.joinpath(*module.split(".")).with_suffix(".py")
        assert file.is_file(), name
        body = ast.parse(file.read_text(encoding="utf-8")).body
        assert function in {node.name for node in body if isinstance(node, ast.FunctionDef)}, name


def test_every_dependency_is_explained(setup: dict[str, Any]) -> None:
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    explained = {name.lower() for name in re.findall(r"^- `([\w.-]+)`: ", text, re.MULTILINE)}
    needed = [*setup["install_requires"]]
    for extra in setup["extras_require"].values():
        needed += extra
    assert set(map(project_name, needed)) <= explained


def test_launch_files_start_what_is_installed(setup: dict[str, Any]) -> None:
    # Read, not run: the launch system is not among the ROS wheels.
    scripts = {script.split(" = ")[0] for script in setup["entry_points"]["console_scripts"]}
    for file in (ROOT / "launch").iterdir():
        tree = ast.parse(file.read_text(encoding="utf-8"), filename=str(file))
        assert "generate_launch_description" in {getattr(node, "name", None) for node in tree.body}
        words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
        assert words & {*scripts, "bringup.launch.py"}, "it starts something of ours, or includes"
        assert {word for word in words if str(word).endswith("_node")} <= {
            *scripts,
            "ros2_control_node",
        }


def test_every_source_names_its_licence() -> None:
    line = ": ".join(("# SPDX-License-Identifier", "Apache-2.0"))  # whole, it would be of this line
    sources = [ROOT / "setup.py"]
    for folder in ("stickslip_ros", "validation", "test", "launch", "examples"):
        sources += (ROOT / folder).rglob("*.py")
    assert [file for file in sources if line not in file.read_text("utf-8").splitlines()[:2]] == []
    assert "Version 2.0, January 2004" in (ROOT / "LICENSE").read_text(encoding="utf-8")
