"""Exceptions that several rooms raise: one tree, with the offending data as attributes.

Exceptions are for faults of set-up, such as a missing file. What may happen in every control
cycle, such as a target out of reach, is a value: :class:`annik_core.solver.result.IkResult`.
"""

from collections.abc import Sequence
from pathlib import Path


class AnnikError(Exception):
    """Base of every exception of annik."""


class MissingDependency(AnnikError):
    """A library that is needed is not installed, or another library has its name."""

    def __init__(self, library: str, purpose: str, remedy: str) -> None:
        self.library = library
        self.remedy = remedy
        super().__init__(f"{purpose} needs {library}: {remedy}")


def one_line(error: Exception) -> str:
    """The message of an error without line breaks, which parsers that it quotes write."""
    return " ".join(str(error).split())


def listed(names: Sequence[str]) -> str:
    """Names for a message: all, or the first of many; a humanoid's joint states have dozens."""
    shown = ", ".join(names[:12])
    return f"{shown}, ..." if len(names) > 12 else shown


def _extra(name: str) -> str:
    """The command that adds an extra of ``setup.py`` to an installation of any kind."""
    return f"pip install 'annik_ros[{name}]'"


_ROS = f"source /opt/ros/jazzy/setup.bash in this terminal, or {_extra('ros')}"
_BAGS = f"{_extra('serve')}; for reports too {_extra('report')}"
#: What to install for each library that annik may lack, by the name that Python imports.
_REMEDIES = {
    "google": "sudo apt install python3-protobuf, or pip install protobuf",
    "jinja2": f"sudo apt install python3-jinja2, or {_extra('report')}",
    "matplotlib": f"sudo apt install python3-matplotlib, or {_extra('report')}",
    "numpy": "sudo apt install python3-numpy, or pip install numpy",
    "scipy": "sudo apt install python3-scipy, or pip install scipy",
    "yaml": "sudo apt install python3-yaml, or pip install pyyaml",
    **dict.fromkeys(("builtin_interfaces", "rcl_interfaces", "rclpy", "std_srvs"), _ROS),
    **dict.fromkeys(("lz4", "mcap", "rosbags", "ruamel", "zstandard"), _BAGS),
    **dict.fromkeys(("onnx", "sympy", "threadpoolctl", "torch"), _extra("train")),
    **dict.fromkeys(("plotly", "trimesh", "viser", "websockets"), _extra("view")),
    **dict.fromkeys(("distributed", "joblib"), _extra("study")),
    **{name: f"pip install {name}" for name in ("click", "onnxruntime", "rich")},
}


def missing_dependency(error: ImportError, purpose: str) -> MissingDependency:
    """The error for a library that can't be imported, with what to install.

    Raises:
        ImportError: ``error`` itself, if it is about anything else, such as a module of annik.
    """
    library = (error.name or "").partition(".")[0]
    remedy = _ROS if library.endswith("_msgs") else _REMEDIES.get(library)
    if remedy is None:
        raise error
    if not isinstance(error, ModuleNotFoundError):
        remedy = f"it is installed, but fails ({one_line(error)}); install it again: {remedy}"
    return MissingDependency(library, purpose, remedy)


class InvalidValue(AnnikError):
    """A setting, an option or a parameter has a value other than the allowed ones, in words."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        self.name = name
        self.value = value
        self.allowed = allowed
        super().__init__(f"{name} is {value!r}; allowed: {allowed}")


class NotWritable(AnnikError):
    """A file or a folder can't be written, for the reason that the operating system gave."""

    def __init__(
        self, path: Path, reason: str, remedy: str = "check the folder and free space"
    ) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path} can't be written ({reason}): {remedy}")


class InUse(AnnikError):
    """Another process writes to a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"{path} is in use by another process: wait until that process ends, or give another "
            "file"
        )


class DamagedRecord(AnnikError):
    """A line of an append-only log, counted from 1, is damaged."""

    def __init__(self, path: Path, line: int, problem: str, remedy: str) -> None:
        self.path = path
        self.line = line
        self.problem = problem
        super().__init__(f"{path}, line {line}: {problem}; {remedy}")


class ConversionError(AnnikError):
    """A message or array can't be converted."""


class WrongShape(ConversionError):
    """An array has the wrong shape."""

    def __init__(self, what: str, shape: tuple[int, ...], expected: str) -> None:
        self.what = what
        self.shape = shape
        self.expected = expected
        super().__init__(f"{what} has shape {shape}; expected {expected}")


class NonFiniteValue(ConversionError):
    """A number is NaN or infinite."""

    def __init__(self, field: str, value: float) -> None:
        self.field = field
        self.value = value
        super().__init__(f"{field} is {value}: every number must be finite")


class NotUnitQuaternion(ConversionError):
    """The norm of a quaternion is too far from 1."""

    def __init__(self, norm: float, tolerance: float) -> None:
        self.norm = norm
        self.tolerance = tolerance
        super().__init__(
            f"quaternion norm is {norm:.6g}; it must be 1 within {tolerance:g}: normalise it "
            "(x, y, z, w order)"
        )


class MissingJoint(ConversionError):
    """A joint state lacks a joint that the robot has."""

    def __init__(self, missing: Sequence[str], received: Sequence[str]) -> None:
        self.missing = tuple(missing)
        self.received = tuple(received)
        super().__init__(
            f"joint state lacks {', '.join(self.missing)}; it names "
            f"{', '.join(self.received) or 'no joint'}"
        )


class MalformedJointState(ConversionError):
    """A joint state names a joint twice, or does not have one position per name."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"joint state: {problem}")


class RobotMismatch(AnnikError):
    """A file was made for one robot and is used with another."""

    def __init__(self, what: str, expected: str, found: str) -> None:
        self.what = what
        self.expected = expected
        self.found = found
        super().__init__(
            f"{what} belongs to robot {found}, not to {expected}: use the file made for this "
            "robot, or make one with 'annik train'"
        )
