"""From a URDF to a model: which chain, which joint box, how good. Takes some ten seconds."""

import math
import tempfile
from pathlib import Path

from annik_core import IkSolver, load_model, load_robot
from annik_training import FitOptions, evaluate, generate_dataset, train

# The chain between two links of the URDF. The joint box keeps the elbow and the wrist on one side,
# so that every pose in it has one solution.
robot = load_robot(
    Path(__file__).parents[1] / "robots" / "xarm6.urdf",
    base_frame="link_base",
    end_effector_frame="link_eef",
    joint_box={
        "joint1": [-math.pi / 2, math.pi / 2],
        "joint2": [-0.4, 0.9],
        "joint3": [-1.9, -0.5],
        "joint4": [-math.pi / 2, math.pi / 2],
        "joint5": [0.5, 1.9],
        "joint6": [-math.pi / 2, math.pi / 2],
    },
)
print(f"{robot.name}: {', '.join(robot.joint_names)}")

# train(dataset, path) alone uses the options that suit an arm; these are quicker, and coarser.
options = FitOptions(
    hidden_units=(32, 32),
    restarts=1,
    held_out_fraction=0.0,
    max_evaluations=150,
    linear_path=True,
    sobolev_weight=1.0,  # few examples say more with the derivatives of the robot's model
    optimiser="lbfgs",
)
path = Path(tempfile.mkdtemp()) / "xarm6.onnx"
dataset = generate_dataset(robot, "sobol", 256, seed=0)
trained = train(dataset, path, options, evaluation_poses=500)
print(f"the network alone: {1e3 * trained.evaluation.position_error.p50:.1f} mm median")

# A solver refines the network's joint positions on the forward kinematics.
refined = evaluate(load_model(path), poses=500, seed=1).refined
print(f"refined: {100 * refined.success:.1f} % solved, {refined.mean_steps:.1f} steps on average")
target = robot.forward_kinematics.poses(robot.joint_box.centre[None])[0]
print("centre of the box:", IkSolver.from_file(path).solve(target).status.value)
