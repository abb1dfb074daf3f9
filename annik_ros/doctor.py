"""``annik doctor``: check an installation and print what is wrong, with the remedy.

It removes what holds nodes up: see :mod:`annik_ros.shared_memory`.
"""

import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from annik_core.errors import AnnikError
from annik_core.installation import annik_version, default_model_path, model_path, packaged_models
from annik_core.kernel import NO_KERNEL, StaleKernel, compiled_kernel
from annik_core.model.artifact import load_model
from annik_ros.shared_memory import own_domain, remove_half_made

#: Required to solve and to serve.
_LIBRARIES = ("numpy", "scipy", "protobuf", "onnxruntime")
#: Required by parts of annik, with the part.
_OPTIONAL_LIBRARIES = {
    "mcap": "bags: pip install 'annik_ros[serve]'",
    "matplotlib": "reports: pip install 'annik_ros[report]'",
    "torch": "training: pip install 'annik_ros[train]'",
    "viser": "the page in the browser: pip install 'annik_ros[view]'",
}
_SUPPORTED_PYTHON = ((3, 10), (3, 13))
_DISTRIBUTION = "jazzy"


class Verdict(Enum):
    """The outcome of a check."""

    GOOD = "ok"
    NOTE = "note"
    BAD = "WRONG"


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    verdict: Verdict
    what: str
    remedy: str = ""


def check_python() -> Iterator[Finding]:
    """The interpreter and annik itself."""
    low, high = _SUPPORTED_PYTHON
    text = f"annik {annik_version()} on Python {platform.python_version()} ({sys.executable})"
    if low <= sys.version_info[:2] <= high:
        yield Finding(Verdict.GOOD, text)
    else:
        yield Finding(Verdict.BAD, text, f"use Python {low[0]}.{low[1]} to {high[0]}.{high[1]}")


def check_libraries() -> Iterator[Finding]:
    """The libraries that are not ROS, by their installed versions."""
    needed = {name: (Verdict.BAD, f"pip install {name}") for name in _LIBRARIES}
    optional = {
        name: (Verdict.NOTE, f"only for {use}") for name, use in _OPTIONAL_LIBRARIES.items()
    }
    for name, (verdict, remedy) in {**needed, **optional}.items():
        try:
            yield Finding(Verdict.GOOD, f"{name} {version(name)}")
        except PackageNotFoundError:
            yield Finding(verdict, f"{name} is not installed", remedy)


def check_kernel() -> Iterator[Finding]:
    """The compiled kinematics of arms."""
    try:
        kernel = compiled_kernel()
    except StaleKernel as error:
        what = f"{error.path} was built from other sources than those beside it"
        yield Finding(Verdict.BAD, what, error.remedy)
        return
    if kernel is not None:
        yield Finding(Verdict.GOOD, "the kernel is compiled")
    else:
        yield Finding(Verdict.NOTE, *NO_KERNEL)


def check_ros() -> Iterator[Finding]:
    """rclpy, its middleware, the messages, and the environment variables of ROS 2."""
    try:
        rclpy = import_module("rclpy")
        for package in ("geometry_msgs", "sensor_msgs", "trajectory_msgs", "diagnostic_msgs"):
            import_module(f"{package}.msg")
        middleware = import_module("rclpy.utilities").get_rmw_implementation_identifier()
    # Not only ImportError: a library of another ROS may raise anything.
    except Exception as error:
        yield Finding(
            Verdict.BAD,
            f"ROS 2 can't be imported: {type(error).__name__}: {error}",
            "source /opt/ros/jazzy/setup.bash, or pip install 'annik_ros[ros]' without a sourced "
            "ROS of another distribution",
        )
        return
    yield Finding(Verdict.GOOD, f"rclpy from {rclpy.__path__[0]}, {middleware}")
    distribution = os.environ.get("ROS_DISTRO")
    if distribution not in (None, "", _DISTRIBUTION):
        yield Finding(
            Verdict.NOTE, f"ROS_DISTRO is {distribution}", f"annik is tested with {_DISTRIBUTION}"
        )
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    yield Finding(Verdict.GOOD, f"ROS_DOMAIN_ID {domain}, discovery range {reach}")
    try:
        import_module("rclpy.experimental.events_executor")
    except ImportError:
        yield Finding(
            Verdict.NOTE,
            "this rclpy has no events executor",
            "upgrade ros-jazzy-rclpy; until then ik_node uses the slower single_threaded",
        )


def check_shared_memory() -> Iterator[Finding]:
    """Remove what processes that were killed left for nodes to wait for."""
    for line in remove_half_made(own_domain()):
        yield Finding(Verdict.NOTE, line)


def check_models() -> Iterator[Finding]:
    """Every packaged model: its file, its reference answers, its robot."""
    for name in packaged_models():
        try:
            artifact = load_model(model_path(name))
        except AnnikError as error:
            yield Finding(
                Verdict.BAD, f"model {name} can't be used: {error}", "install annik again"
            )
        else:
            yield Finding(
                Verdict.GOOD,
                f"model {name}: {artifact.robot.dof} joints, SHA-256 {artifact.sha256[:12]}",
            )


def check_round_trip() -> Iterator[Finding]:
    """A target to an ik_node of its own, and the command back, over the middleware."""
    try:
        from annik_ros.round_trip import TIMEOUT, round_trip
    except ImportError:
        return  # check_ros reports it
    try:
        found = round_trip(default_model_path())
    except AnnikError:
        found = None
    if found is None:
        yield Finding(
            Verdict.BAD,
            f"no command came back from an ik_node within {TIMEOUT:g} s",
            "check that a firewall lets UDP multicast through on the loopback interface, and that "
            "/dev/shm has space",
        )
    else:
        start, trip = found
        yield Finding(
            Verdict.GOOD,
            f"first command of ik_node {start:.2f} s after its start, then round trips of "
            f"{1e3 * trip:.2f} ms",
        )


CHECKS: tuple[Callable[[], Iterator[Finding]], ...] = (
    check_python,
    check_libraries,
    check_kernel,
    check_ros,
    check_shared_memory,
    check_models,
    check_round_trip,
)


def main() -> int:
    """Run all checks and print a line for each finding; returns 1 if something is wrong."""
    wrong = 0
    for check in CHECKS:
        for finding in check():
            wrong += finding.verdict is Verdict.BAD
            print(f"{finding.verdict.value:5}  {finding.what}", flush=True)
            if finding.remedy:
                print(f"       -> {finding.remedy}", flush=True)
    print("all is well" if not wrong else f"{wrong} wrong: see WRONG above", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
