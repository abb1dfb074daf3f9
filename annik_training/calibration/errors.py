"""Exceptions of the calibration."""

import math
from collections.abc import Sequence
from pathlib import Path

from annik_core.errors import AnnikError


class CalibrationError(AnnikError):
    """Base of what can be wrong with measured poses or a calibrated robot."""


class NotMeasured(CalibrationError):
    """The poses of a dataset were computed, such as those of a plan."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"the poses of {path} were computed, not measured: give the dataset that "
            "example_collector wrote, not its plan"
        )


class UnreadableMeasurements(CalibrationError):
    """A file of measurements is missing, or a line, counted from 1, or a column of it is wrong."""

    def __init__(
        self,
        path: Path,
        problem: str,
        line: int | None = None,
        column: str | None = None,
        value: str | None = None,
    ) -> None:
        self.path = path
        self.problem = problem
        self.line = line
        self.column = column
        self.value = value
        place = str(path) if line is None else f"{path}, line {line}"
        what = "" if column is None else f"column {column!r} "
        what += "" if value is None else f"is {value!r}: "
        super().__init__(f"measurements {place}: {what}{problem}")


class UnlikelyUnits(CalibrationError):
    """Numbers of a file are of a size that only another unit explains."""

    def __init__(self, path: Path, what: str, given: str, likely: str) -> None:
        self.path = path
        self.what = what
        self.given = given
        self.likely = likely
        kind = "length" if likely in ("m", "cm", "mm") else "angle"
        super().__init__(
            f"measurements {path}: {what} are read in {given}, and must be in {likely} by their "
            f"size: give --{kind}-unit {likely}, or name the unit in the header, as in x_mm"
        )


class InvalidMeasurements(CalibrationError):
    """Arrays of measurements don't fit each other."""

    def __init__(self, name: str, problem: str) -> None:
        self.name = name
        self.problem = problem
        super().__init__(f"measurements: {name}: {problem}")


class TooFewMeasurements(CalibrationError):
    """There are fewer measured poses, without outliers, than the geometry needs."""

    def __init__(self, examples: int, least: int, outliers: int) -> None:
        self.examples = examples
        self.least = least
        self.outliers = outliers
        left_out = f" besides {outliers} outliers" if outliers else ""
        super().__init__(
            f"{examples} measured poses{left_out} can't determine the geometry of the robot: "
            f"measure at least {least}, better 50 to 100, all over the joint box"
        )


class UnexplainedMeasurements(CalibrationError):
    """No model of the robot explains the measured poses."""

    def __init__(self, finding: str) -> None:
        self.finding = finding
        super().__init__(
            f"{finding}: check that the description is that of the robot that was measured, which "
            "column is which joint, that joint positions and measurements belong together, and "
            "that they are in metres, radians and quaternions x, y, z, w; with sockets, which "
            "file is which socket and placement"
        )


class OtherFrame(CalibrationError):
    """A frame that was said to be known is another one: the base frame, or the tool's."""

    def __init__(self, name: str, distance: float, angle: float) -> None:
        self.name = name  #: "base" or "tool"
        self.distance = distance  #: from where it was said to be [m]
        self.angle = angle  #: the same [rad]
        what, remedy = {
            "base": ("the robot's base in the frame of the measurements", "--frame-known"),
            "tool": ("the measured tool in the end effector frame", "--tool-known"),
        }[name]
        super().__init__(
            f"{what} is {1e3 * distance:.3g} mm and {math.degrees(angle):.3g} degrees from where "
            "it is said to be: correct the measurements, or give them as a table and leave out "
            f"{remedy}, so that it is found"
        )


class OtherDistance(CalibrationError):
    """The known distance between fixed points is another one than the arm tells."""

    def __init__(self, known: float, found: float) -> None:
        self.known = known  #: [m]
        self.found = found  #: by the arm alone [m]
        super().__init__(
            f"the known distance between the sockets is {1e3 * known:.4g} mm, but by the arm it "
            f"is about {1e3 * found:.4g} mm: give --socket-distance in metres, from centre to "
            "centre of the ball in the one and the other, and check which file is which socket"
        )


class ImplausibleErrors(CalibrationError):
    """The measured poses are those of another robot: these geometric errors are too large."""

    def __init__(self, names: Sequence[str], amounts: Sequence[str]) -> None:
        self.names = tuple(names)
        listed = "; ".join(f"{name} {amount}" for name, amount in zip(names, amounts, strict=True))
        super().__init__(
            "the poses were measured in another frame, with another tool, or on another robot: "
            f"the description would have to be wrong by {listed}"
        )


class DegenerateExamples(CalibrationError):
    """The measured poses don't determine the robot in a part of its joint box."""

    def __init__(
        self, expected: tuple[float, float], fraction: float, joints: tuple[str, ...]
    ) -> None:
        self.expected = expected  #: error to expect there, as a position [m] and an angle [rad]
        self.fraction = fraction  #: the same relative to a robot that was not measured at all
        self.joints = joints  #: joints to move further
        super().__init__(
            f"with these poses, errors of {1e3 * expected[0]:.2g} mm and "
            f"{math.degrees(expected[1]):.2g} degrees remain in the joint box, {fraction:.0%} of "
            f"those without any measurement: measure poses in which {', '.join(joints)} "
            f"{'moves' if len(joints) == 1 else 'move'} through the whole box, or, for a robot "
            "whose joint stays where it is, lock it there: --joint-box JOINT=POSITION"
        )


class NotCalibrated(CalibrationError):
    """The robot of a model was not calibrated."""

    def __init__(self, robot: str) -> None:
        self.robot = robot
        super().__init__(
            f"the model is for {robot} as described: there is no before and after; annik "
            "calibrate makes a calibrated one"
        )


class NotHeldOut(CalibrationError):
    """The robot of a model was calibrated with these very poses."""

    def __init__(self, examples: int) -> None:
        self.examples = examples
        super().__init__(
            f"the model was calibrated with these {examples} poses, so they can't test it: "
            "measure others, such as those of a design with another --seed"
        )
