"""How a target is solved: by the network, refined, or as a whole robot."""

from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from annik_core.robots.robot import Robot


class SolverMode(Enum):
    """How a target is solved.

    ``NETWORK``: by the network alone, as in the paper. ``REFINED``: the network's solution is
    refined on the forward kinematics inside the joint box. ``WHOLE_ROBOT``: for an arm; as
    refined, but anywhere within the joint limits, on the branch of the previous command. ``AUTO``:
    for an arm, the whole robot unless its joint box is smaller than its limits; the network for
    the gantry, whose linear kinematics it learns exactly.
    """

    AUTO = "auto"
    NETWORK = "network"
    REFINED = "refined"
    WHOLE_ROBOT = "whole_robot"

    def of(self, robot: "Robot") -> "SolverMode":
        """The mode for a robot: ``AUTO`` decided."""
        if self is not SolverMode.AUTO:
            return self
        if robot.kind != "arm":
            return SolverMode.NETWORK
        return SolverMode.WHOLE_ROBOT if robot.has_whole_box else SolverMode.REFINED

    def refines(self, robot: "Robot") -> bool:
        """Whether solutions for this robot are refined."""
        return self.of(robot) is not SolverMode.NETWORK
