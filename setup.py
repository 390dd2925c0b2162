# SPDX-License-Identifier: Apache-2.0
"""Packaging, for pip and colcon alike. Why each dependency is here: docs/dependencies.md."""

import gzip
import os
import re
import tarfile
import xml.etree.ElementTree as ET
from glob import glob
from pathlib import Path
from typing import Any

from setuptools import find_packages, setup
from setuptools.command.sdist import sdist

PACKAGE = "stickslip_ros"

# The version is read as text: importing the package would need its dependencies first.
source = Path(PACKAGE, "version.py").read_text(encoding="utf-8")
version = re.findall(r'^__version__ = "(.+)"$', source, flags=re.MULTILINE)[0]

# Addresses stand in package.xml alone.
manifest = ET.parse("package.xml").getroot()
(maintainer,) = manifest.findall("maintainer")
email = maintainer.attrib["email"]
url = {each.get("type"): each.text for each in manifest.findall("url")}
home = url["repository"]

# Where the page is shown outside the repository, its links need a place to lead to.
readme = Path("README.md").read_text(encoding="utf-8")
readme = re.sub(r"(!\[[^]]*\]\()(?!https?:)", rf"\1{home}/raw/main/", readme)
readme = re.sub(r"((?<!!)\[[^]]*\]\()(?!https?:|#)", rf"\1{home}/blob/main/", readme)


class ReproducibleSdist(sdist):
    """An sdist of the same bytes whenever and by whomever it is built.

    Wheels are so by themselves where SOURCE_DATE_EPOCH is set.
    """

    def make_archive(self, base_name: str, format: str, *, base_dir: str, **_: Any) -> str:
        """Write the files of base_dir with one time, one owner and two modes; return the name."""
        when = int(os.environ.get("SOURCE_DATE_EPOCH", 315532800))  # 1980, where zip files begin

        def plain(entry: tarfile.TarInfo) -> tarfile.TarInfo:
            entry.mtime, entry.uid, entry.gid, entry.uname, entry.gname = when, 0, 0, "", ""
            entry.mode = 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
            return entry

        name = f"{base_name}.tar.gz"
        with (
            open(name, "wb") as file,
            gzip.GzipFile("", "wb", fileobj=file, mtime=when) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            archive.add(base_dir, filter=plain)  # in the order of names
        return name


setup(
    name=PACKAGE,
    version=version,
    description="Simulated piezo stick-slip axes for ROS 2",
    long_description=readme,
    long_description_content_type="text/markdown",
    author=maintainer.text,
    author_email=email,
    maintainer=maintainer.text,
    maintainer_email=email,
    url=home,
    project_urls={
        "Source": home,
        "Issues": url["bugtracker"],
        "Documentation": url["website"],
        "Changelog": f"{home}/blob/main/CHANGELOG.rst",
    },
    license="Apache-2.0",
    keywords="piezo stick-slip micropositioning friction simulation ROS digital-twin",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Intended Audience :: Science/Research",
        "Intended Audience :: Developers",
        "Operating System :: OS Independent",
        "Programming Language :: Python :: 3",
        "Programming Language :: Python :: 3 :: Only",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Programming Language :: Python :: 3.13",
        "Topic :: Scientific/Engineering :: Physics",
        "Topic :: Software Development :: Testing",
        "Typing :: Typed",
    ],
    cmdclass={"sdist": ReproducibleSdist},
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.base.reporting": ["templates/*.html"],
        f"{PACKAGE}.physics.solver": ["*.csv"],
        f"{PACKAGE}.cli.workbench": ["*.js"],
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
    # Lower bounds are the versions of Ubuntu 24.04, on which Jazzy runs, and of lz4 the first with
    # wheels for its Python; .ci/packaging tests with them.
    # `simulate` and what else needs no file needs the first four alone.
    install_requires=[
        "numpy>=1.26.4",
        "scipy>=1.11.4",
        # 0.61 to 0.68 compile in half the time of others; see base/numba_internals.py.
        "numba>=0.61",
        "pyyaml>=6.0.1",
        "mcap>=1.5",
        "mcap-ros2-support>=0.5.3",
        "zstandard>=0.22",
        "lz4>=4.3.3",
        "matplotlib>=3.6.3",
        "jinja2>=3.1.2",
        "plotly>=5.18",
        "rich>=13.7.1",
        "tqdm>=4.66.2",
    ],
    extras_require={
        # The ROS wheels, for machines without a ROS installation.
        "ros": [
            "ros-jazzy-rclpy[fastrtps]~=7.1",
            "ros-jazzy-common-interfaces~=5.3",
            "ros-jazzy-domain-coordinator~=0.12.0",
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
        # Tables of results in a notebook.
        "notebook": [
            "pandas",
        ],
        # Sweeps and many measurements on several machines: --cluster.
        "cluster": [
            "distributed",
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
            "allpairspy",
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
            "pipython",
            "pylablib-lightweight",
            "pandas",
            "xarray",
            "distributed",
            "gymnasium>=1.0",
            "sphinx",
            "myst-parser",
            "furo",
            "sphinxcontrib-mermaid",
            "mermaidx",
            "quickjs-ng",
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
        "pytest11": ["stickslip_ros.testing = stickslip_ros.testing"],
    },
)
