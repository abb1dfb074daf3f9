"""Inverse kinematics in plain Python: an answer with its residual, a refusal with its reason."""

from annik_core.artifact import default_model_path
from annik_core.ik_solver import IkSolver
from annik_core.pose import pose_from_roll_pitch_yaw

solver = IkSolver.from_file(default_model_path())

reachable = pose_from_roll_pitch_yaw([0.35, 0.35, 0.65], [0.1, 0.2, 0.3])
result = solver.solve(reachable)
assert result.joint_positions is not None
for name, position in zip(solver.robot.joint_names, result.joint_positions, strict=True):
    print(f"{name}: {position:.6f} rad")
print(f"misses the target by {1000 * result.position_residual:.5f} mm")

too_far = pose_from_roll_pitch_yaw([0.35, 0.35, 1.65], [0.1, 0.2, 0.3])
print(f"refused: {solver.solve(too_far).reason}")
