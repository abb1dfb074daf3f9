"""Calibrate an arm from measured poses; before and after. Takes some ten seconds.

A simulated arm stands for the real one: joint zeros, links and transmissions are not as described.
With a real arm, example_collector writes the dataset, and load_dataset reads it.
"""

import numpy as np

from annik_core import Dataset, load_robot
from annik_core.dataset import MEASURED
from annik_core.simulation.fake_robot import FakeRobot
from annik_core.simulation.imperfections import random_imperfections
from annik_training import CalibrationOptions, calibrate, make_design

nominal = load_robot("ur5e")
arm = FakeRobot(nominal, random_imperfections(nominal, seed=7))
noise = np.random.default_rng(0)


def measured(examples: int, seed: int) -> Dataset:
    """Drive the arm to the poses of a design, and measure where its end effector is."""
    joint_positions = make_design(nominal, "sobol", examples, seed)
    poses = []
    for row in joint_positions:
        arm.move_to(row)
        poses.append(arm.measure(noise))
    return Dataset(
        nominal, joint_positions, np.array(poses), "sobol", {"size": examples}, seed, MEASURED
    )


calibrated = calibrate(nominal, measured(50, seed=0), CalibrationOptions(restarts=1))
parts = ", ".join(sorted(part.value for part in calibrated.estimate.model.parts))
print(f"calibrated in {calibrated.seconds:.1f} s: {parts}")
print(f"outliers: {np.flatnonzero(calibrated.outliers).tolist()}")
print(f"not identified: {'; '.join(calibrated.unidentified)}")

held_out = measured(100, seed=1)
for name, robot in (("nominal", nominal), ("calibrated", calibrated.robot)):
    poses = robot.forward_kinematics.poses(held_out.joint_positions)
    errors = 1e3 * np.linalg.norm(poses[:, :3] - held_out.poses[:, :3], axis=1)
    print(f"{name}: {errors.mean():.4f} mm on average, {errors.max():.4f} mm at most")
