"""Why a robot can't be learned from measured poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from annik_core.errors import AnnikError


class MeasuredFitError(AnnikError):
    """Base of what can be wrong with a fit to measured poses."""


class UnsupportedRobot(MeasuredFitError):
    """The robot is not a nominal arm."""

    def __init__(self, name: str, kind: str) -> None:
        self.name = name
        super().__init__(
            f"{name} ({kind}) can't be learned from measured poses: that takes the nominal "
            "description of an arm, a packaged one or a URDF"
        )


class NotMeasured(MeasuredFitError):
    """The poses are computed ones, such as those of a plan."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"the poses of {path} were computed, not measured: give the dataset that "
            "example_collector wrote, not its plan"
        )


class TooFewMeasurements(MeasuredFitError):
    """There are fewer measured numbers than a robot's geometry needs."""

    def __init__(self, examples: int, least: int, outliers: int) -> None:
        self.examples = examples
        self.least = least
        refused = f" besides {outliers} outliers" if outliers else ""
        super().__init__(
            f"{examples} measured poses{refused} can't tell the geometry of the robot: measure at "
            f"least {least}, better 50 to 100, all over the working box"
        )


class TooManyOutliers(MeasuredFitError):
    """The measured poses contradict each other, or are not this robot's."""

    def __init__(self, outliers: int, examples: int) -> None:
        self.outliers = outliers
        super().__init__(
            f"{outliers} of {examples} measured poses are far from where any model of the robot "
            "has them: check that the joint positions and poses belong together, and that the "
            "poses are of the end effector frame in the base frame"
        )


class UnexplainedMeasurements(MeasuredFitError):
    """The measured poses are nowhere near those of any model of the robot."""

    def __init__(self, position: float, orientation: float) -> None:
        self.position = position
        self.orientation = orientation
        super().__init__(
            f"the measured poses are {1e3 * position:.2g} mm and {math.degrees(orientation):.2g} "
            "degrees from the nearest model of the robot, more than its description can be: check "
            "that the joint positions and poses belong together, that they are in metres, radians "
            "and quaternions x, y, z, w, and that the poses are of the end effector frame in the "
            "base frame"
        )


class ImplausibleErrors(MeasuredFitError):
    """The robot that the measured poses fit is not the one that is described."""

    def __init__(self, names: Sequence[str], amounts: Sequence[str]) -> None:
        self.names = tuple(names)
        listed = "; ".join(f"{name} {amount}" for name, amount in zip(names, amounts, strict=True))
        super().__init__(
            f"the poses were measured on another robot, or in another frame: to explain them, "
            f"this one's description would have to be wrong by {listed}"
        )


class DegenerateExamples(MeasuredFitError):
    """The examples don't say how the robot moves in a part of its working box."""

    def __init__(self, expected: str, part: float, joints: tuple[str, ...]) -> None:
        self.joints = joints
        super().__init__(
            f"after these examples errors of {expected} are still to be expected in the working "
            f"box, up to {part:.0%} of what a robot not measured at all has: measure poses in "
            f"which {', '.join(joints)} {'is' if len(joints) == 1 else 'are'} moved through the "
            "whole box"
        )
