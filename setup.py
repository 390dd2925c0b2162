# SPDX-License-Identifier: Apache-2.0
"""Packaging, for pip and colcon alike. Why each dependency is here: CONTRIBUTING.md."""

import re
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "stickslip_ros"

# The version is read as text: importing the package would need its dependencies first.
source = Path(PACKAGE, "version.py").read_text(encoding="utf-8")
version = re.findall(r'^__version__ = "(.+)"$', source, flags=re.MULTILINE)[0]

setup(
    name=PACKAGE,
    version=version,
    description="Simulated piezo stick-slip axes for ROS 2",
    author="The stickslip_ros maintainers",
    author_email="maintainers@stickslip-ros.example",
    maintainer="The stickslip_ros maintainers",
    maintainer_email="maintainers@stickslip-ros.example",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.paper": ["checks.csv", "claims.yaml", "errata.md"],
        f"{PACKAGE}.reporting": ["templates/*.html"],
        f"{PACKAGE}.workbench": ["*.js"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*"))),
        (f"share/{PACKAGE}/examples", sorted(glob("examples/*.py") + glob("examples/*.ipynb"))),
        (f"share/{PACKAGE}/examples/my_node", sorted(glob("examples/my_node/*.py"))),
        (f"share/{PACKAGE}/examples/ros2_control", sorted(glob("examples/ros2_control/*"))),
        (f"share/{PACKAGE}/examples/samples", sorted(glob("examples/samples/*"))),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.*"))),
        (f"share/{PACKAGE}/urdf", sorted(glob("urdf/*.urdf"))),
    ],
    zip_safe=False,
    install_requires=[
        "numpy>=1.26",
        "scipy",
        # 0.61 to 0.68 compile in half the time of others; see stickslip_ros/numba_internals.py.
        "numba>=0.61",
        "mcap",
        "mcap-ros2-support",
        "zstandard",
        "lz4",
        "pyyaml",
        "matplotlib",
        "jinja2",
        "plotly",
        "rich",
        "shtab",
        "tqdm",
    ],
    extras_require={
        # The ROS wheels, for machines without a ROS installation.
        "ros": [
            "ros-jazzy-rclpy[fastrtps]~=7.1",
            "ros-jazzy-common-interfaces~=5.3",
            "ros-jazzy-domain-coordinator~=0.12.0",
        ],
        # Sweeps on more than one machine.
        "dask": [
            "dask[distributed]",
        ],
        # The site: make site.
        "docs": [
            "sphinx",
            "myst-parser",
            "furo",
            "sphinxcontrib-mermaid",
            "mermaidx",
            "ziamath",
        ],
        # Tables of results in a notebook, and the design of controllers.
        "notebook": [
            "pandas",
            "control",
        ],
        # stickslip bag export to Parquet.
        "parquet": [
            "pyarrow",
        ],
        # Measurements in the files of instruments, and bags of SQLite and ROS 1.
        "formats": [
            "RigolWFM",
            "h5py",
            "nptdms",
            "pyuff",
            "rosbags",
        ],
        # colcon runs pytest because it finds it under this name.
        "test": [
            "pytest",
            "pytest-rerunfailures",
            "pytest-timeout",
            "pytest-xdist",
            "hypothesis",
            "RigolWFM",
            "h5py",
            "nptdms",
            "pyuff",
            "lvm_read",
            "rosbags",
            "axe-playwright-python",
            "playwright",
            "pymcap-cli",
            "pyarrow",
            "pymeasure",
            "pyvisa-py",
            "dask[distributed]",
            "pandas",
            "control",
            "sphinx",
            "myst-parser",
            "furo",
            "sphinxcontrib-mermaid",
            "mermaidx",
            "ziamath",
            "setuptools",
        ],
        "dev": [
            "mypy",
            "numpydoc",
            "ruff",
            "types-PyYAML",
            "types-tqdm",
        ],
        # General solvers that ours is measured against.
        "bench": [
            "cyrk",
            "scijit",
            "scikit-sundae",
        ],
    },
    entry_points={
        "console_scripts": [
            "stickslip = stickslip_ros.cli.main:main",
            "axis_node = stickslip_ros.executables:axis_node",
            "recorder_node = stickslip_ros.executables:recorder_node",
            "replay_node = stickslip_ros.executables:replay_node",
            "twin_node = stickslip_ros.executables:twin_node",
            "square = stickslip_ros.executables:square",
        ],
        # Under the name of the module, so that a conftest may name it as well.
        "pytest11": ["stickslip_ros.testing.plugin = stickslip_ros.testing.plugin"],
    },
)
