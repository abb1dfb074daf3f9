"""An oracle for learning from measured poses: a UR5e unlike its table, and a tracker.

Universal Robots' table of Denavit and Hartenberg's parameters, each with an error, in plain NumPy:
nothing of annik's kinematics, models or corrections is in it. The errors are uniform: joint zeros
+-0.5 degrees, lengths and offsets +-1 mm, twists +-0.3 degrees, and in each joint a periodic error
of up to 0.2 degrees, one period a turn, as an eccentric encoder has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.dataset import MEASURED, Dataset
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import make_design

_DISTANCES = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
_LENGTHS = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
_TWISTS = np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0])
#: Standard deviations of the tracker: 20 micrometres, 0.002 degrees.
NOISE = (2e-5, float(np.radians(0.002)))


@dataclass(frozen=True, eq=False)
class ImperfectUr5e:
    """The robot that is measured.

    Attributes:
        zeros: ``(6,)`` errors of the joint zeros [rad].
        distances: ``(6,)`` of the offsets along the joints' axes [m].
        lengths: ``(6,)`` of the links' lengths [m].
        twists: ``(6,)`` of the links' twists [rad].
        amplitudes: ``(6,)`` of the joints' periodic errors [rad].
        phases: ``(6,)`` of the same [rad].
        sag: by which the weight of the outstretched arm turns the shoulder [rad].
    """

    zeros: np.ndarray
    distances: np.ndarray
    lengths: np.ndarray
    twists: np.ndarray
    amplitudes: np.ndarray
    phases: np.ndarray
    sag: float = 0.0

    @classmethod
    def drawn(cls, seed: int, share: float = 1.0) -> ImperfectUr5e:
        """Errors drawn at random, or a share of them."""
        rng = np.random.default_rng(seed)
        degree = np.pi / 180.0
        largest = (0.5 * degree, 1e-3, 1e-3, 0.3 * degree, 0.2 * degree)
        errors = [share * rng.uniform(-amount, amount, 6) for amount in largest]
        return cls(*errors, rng.uniform(0.0, 2.0 * np.pi, 6))

    def matrices(self, joint_positions: np.ndarray) -> np.ndarray:
        """Poses ``(n, 4, 4)`` of the flange in ``base_link`` for commands ``(n, 6)``."""
        actual = joint_positions + self.amplitudes * np.sin(joint_positions + self.phases)
        upper, fore = joint_positions[:, 1], joint_positions[:, 1] + joint_positions[:, 2]
        actual[:, 1] += self.sag * (np.cos(upper) + np.cos(fore))
        # The controller's base is base_link, turned by 180 degrees about z.
        pose = np.tile(np.diag([-1.0, -1.0, 1.0, 1.0]), (len(actual), 1, 1))
        for joint in range(6):
            theta = actual[:, joint] + self.zeros[joint]
            c, s = np.cos(theta), np.sin(theta)
            twist = _TWISTS[joint] + self.twists[joint]
            ca, sa = np.cos(twist), np.sin(twist)
            length = _LENGTHS[joint] + self.lengths[joint]
            zero, one = np.zeros_like(c), np.ones_like(c)
            along = (_DISTANCES[joint] + self.distances[joint]) * one
            rows = (
                (c, -s * ca, s * sa, length * c),
                (s, c * ca, -c * sa, length * s),
                (zero, sa * one, ca * one, along),
                (zero, zero, zero, one),
            )
            pose = pose @ np.moveaxis(np.array(rows), 2, 0)
        return pose

    def poses(self, joint_positions: np.ndarray) -> np.ndarray:
        """The same as ``(n, 7)``."""
        return poses_of(self.matrices(joint_positions))


#: Nothing is wrong with it.
PERFECT = ImperfectUr5e(*np.zeros((6, 6)))


def poses_of(matrices: np.ndarray) -> np.ndarray:
    """``(n, 7)`` of ``(n, 4, 4)``."""
    quaternions = Rotation.from_matrix(matrices[:, :3, :3]).as_quat(canonical=True)
    return np.concatenate([matrices[:, :3, 3], quaternions], axis=1)


def noisy(poses: np.ndarray, noise: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Poses ``(n, 7)`` as a tracker with these standard deviations reads them."""
    position, orientation = noise
    turns = Rotation.from_rotvec(rng.normal(size=(len(poses), 3)) * orientation)
    quaternions = (turns * Rotation.from_quat(poses[:, 3:])).as_quat()
    shifts = rng.normal(size=(len(poses), 3)) * position
    return np.concatenate([poses[:, :3] + shifts, quaternions], axis=1)


def measured(
    robot: Robot,
    truth: Callable[[np.ndarray], np.ndarray],
    joint_positions: np.ndarray,
    *,
    seed: int = 0,
    noise: tuple[float, float] = NOISE,
    stated: tuple[float, float] | None = NOISE,
) -> Dataset:
    """Measured poses of a robot that is said to be ``robot`` and is ``truth``."""
    poses = noisy(truth(joint_positions), noise, np.random.default_rng(seed))
    options = {"size": len(poses)}
    return Dataset(robot, joint_positions, poses, "sobol", options, seed, MEASURED, stated)


def measured_ur5e(
    truth: ImperfectUr5e,
    examples: int,
    *,
    seed: int = 0,
    noise: tuple[float, float] = NOISE,
    stated: tuple[float, float] | None = NOISE,
) -> Dataset:
    """Measured poses of an imperfect UR5e at Sobol's joint positions."""
    robot = load_robot("ur5e")
    joint_positions = make_design(robot, "sobol", examples, seed)
    return measured(robot, truth.poses, joint_positions, seed=seed, noise=noise, stated=stated)


def with_poses(dataset: Dataset, poses: np.ndarray) -> Dataset:
    """Other measurements at the same joint positions."""
    return replace(dataset, poses=poses)


def distances(robot: Robot, truth: Callable[[np.ndarray], np.ndarray], count: int) -> np.ndarray:
    """How far ``(count,)`` the model is from the truth, anywhere in the working box [m]."""
    joint_positions = robot.joint_box.sample(count, np.random.default_rng(99))
    model = robot.forward_kinematics.poses(joint_positions)
    return np.linalg.norm(model[:, :3] - truth(joint_positions)[:, :3], axis=1)


def touching(
    truth: ImperfectUr5e, tool: np.ndarray, point: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Joint positions ``(count, 6)`` with a point of the flange's frame at one of the base's."""
    box = load_robot("ur5e").joint_box
    found = box.sample(20 * count, np.random.default_rng(seed))

    def reached(joint_positions: np.ndarray) -> np.ndarray:
        poses = truth.matrices(joint_positions)
        return poses[:, :3, 3] + poses[:, :3, :3] @ tool

    for _ in range(40):
        here = reached(found)
        moved = [(reached(found + step) - here) / 1e-6 for step in 1e-6 * np.eye(6)]
        steps = np.linalg.pinv(np.stack(moved, axis=2)) @ (point - here)[..., None]
        found = found + np.clip(steps[..., 0], -0.3, 0.3)
    there = np.linalg.norm(reached(found) - point, axis=1) < 1e-9
    inside = ((found > box.lower) & (found < box.upper)).all(axis=1)
    return found[there & inside][:count]
