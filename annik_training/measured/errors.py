"""Why a robot can't be learned from measured poses."""

from __future__ import annotations

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


class DegenerateExamples(MeasuredFitError):
    """The examples don't say how the robot moves in a part of its working box."""

    def __init__(self, expected: float, nominal: float, joints: tuple[str, ...]) -> None:
        self.joints = joints
        super().__init__(
            f"after these examples errors of {1e3 * expected:.2g} mm are still to be expected in "
            f"the working box, {expected / nominal:.0%} of what a robot not measured at all has: "
            f"measure poses in which {', '.join(joints)} "
            f"{'is' if len(joints) == 1 else 'are'} moved through the whole box"
        )
