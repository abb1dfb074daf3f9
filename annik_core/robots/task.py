"""What of a target pose an arm must reach: with fewer than six joints, not every pose can be."""

from enum import Enum

import numpy as np

from annik_core.robots.robot import Robot

#: Joint positions at which the rank of a chain is sought.
_SAMPLES = 50
#: A singular value below this part of the greatest is zero, but for the digits of a URDF.
_ZERO = 1e-4


class Task(Enum):
    """What of a target must be reached, exactly; the orientation as near as possible besides.

    ``POSE``: all of it. ``POSITION_AND_AXIS``: the position, and the direction of the z axis of
    the end effector. ``POSITION``: the position. ``AUTO``: the pose, or, of an arm whose end
    effector moves in fewer than six independent directions, the position.
    """

    AUTO = "auto"
    POSE = "pose"
    POSITION_AND_AXIS = "position_and_axis"
    POSITION = "position"

    @property
    def rows(self) -> int:
        """How many of the Jacobian's rows, in the end effector's axes, it is about."""
        return {"position_and_axis": 5, "position": 3}.get(self.value, 6)

    def of(self, robot: Robot) -> "Task":
        """The task of a robot: ``AUTO`` decided."""
        if self is not Task.AUTO:
            return self
        kinematics, box = robot.forward_kinematics, robot.joint_box
        sample = box.sample(_SAMPLES, np.random.default_rng(0))
        jacobians = kinematics.jacobians(sample)[:, :, box.free]
        linear, angular = np.linalg.norm(jacobians[:, :3]), np.linalg.norm(jacobians[:, 3:])
        if linear > 0.0 < angular:
            jacobians[:, :3] *= angular / linear
        values = np.linalg.svd(jacobians, compute_uv=False)
        ranks = (values > _ZERO * values[:, :1]).sum(axis=1)
        return Task.POSE if ranks.max() == Task.POSE.rows else Task.POSITION
