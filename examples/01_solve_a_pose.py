"""Solve poses with a packaged model. Nothing is trained, and ROS is not needed."""

import numpy as np

from annik_core import IkSolver

solver = IkSolver.from_file("ur5e")  # or the path of a model file
robot = solver.robot

# x, y, z [m], unit quaternion x, y, z, w: the end effector frame in the base frame.
result = solver.solve([0.4, 0.1, 0.5, 0.0, 1.0, 0.0, 0.0])
assert result.accepted, result.reason
for name, position in zip(robot.joint_names, result.joint_positions, strict=True):
    print(f"{name}: {position:.4f} rad")
print(f"off by {1e9 * result.position_residual:.0f} nm after {result.newton_steps} steps")

# Close to the previous command, where a pose has several solutions.
nearby = solver.solve([0.4, 0.1, 0.51, 0.0, 1.0, 0.0, 0.0], previous=result)
step = np.abs(nearby.joint_positions - result.joint_positions).max()
print(f"10 mm higher: no joint moves by more than {step:.3f} rad")

# A pose without a solution is refused, never approximated.
refused = solver.solve([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
print(f"{refused.status.value}: {refused.reason}")

# Many poses at once: the joint box is where the model was trained.
rng = np.random.default_rng(0)
poses = robot.forward_kinematics.poses(robot.joint_box.sample(200, rng))
solved = sum(result.accepted for result in solver.solve_batch(poses))
print(f"{solved} of {len(poses)} random poses solved")
