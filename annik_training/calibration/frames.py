"""The frames of a measurement: the robot's base to the instrument, and the tool.

Unknown frames are found from any start: in closed form, then by weighted least squares. For poses
the rotations come first, from the bilinear form whose singular vectors they are [Shah2013]_, then
the translations; for positions one linear system has all unknowns, of which the rotation is made
orthogonal; of fixed points the tool point and the points are linear.

References:
    [Shah2013] M. Shah: Solving the robot-world/hand-eye calibration problem using the Kronecker
    product. Journal of Mechanisms and Robotics 5 (3), 2013.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from annik_training.calibration.errors import OtherFrame
from annik_training.calibration.measurements import Measurements

#: A frame that is off by more is another one [m], [rad].
OTHER = (0.02, math.radians(3.0))
#: Other frames explain measurements if the errors of the nominal arm become so many times smaller,
#: and are no more than those of an arm may be [m].
_EXPLAINED, _NOMINAL = 1.0 / 3.0, 0.02
_ROUNDS = 15


@dataclass(frozen=True, eq=False)
class Frames:
    """Where the instrument, the tool and the fixed points are, and which of it is unknown.

    Attributes:
        base: ``(4, 4)`` the robot's base in the instrument's frame.
        tool: ``(4, 4)`` the measured tool in the end effector frame.
        points: ``(m, 3)`` fixed points in the base frame [m].
        base_unknown: whether the base is a part of the fit.
        tool_unknowns: 0, 3 for the tool point alone, or 6.
        centre: ``(3,)`` in the instrument's frame, about which the base turns.
    """

    base: FloatArray
    tool: FloatArray
    points: FloatArray
    base_unknown: bool = False
    tool_unknowns: int = 0
    centre: FloatArray | float = 0.0

    @classmethod
    def known(cls) -> "Frames":
        """The instrument's frame is the base frame, the tool the end effector."""
        return cls(np.eye(4), np.eye(4), np.zeros((0, 3)))

    @property
    def size(self) -> int:
        """Number of unknowns: those of the base, of the tool, of the points."""
        return 6 * self.base_unknown + self.tool_unknowns + self.points.size

    def moved(self, unknowns: FloatArray) -> "Frames":
        """Frames and points moved by unknowns ``(size,)``: metres, then radians, of each."""
        base, tool = self.base.copy(), self.tool.copy()
        place = 0
        if self.base_unknown:
            turn = Rotation.from_rotvec(unknowns[3:6]).as_matrix()
            base[:3, :3] = turn @ base[:3, :3]
            base[:3, 3] = self.centre + turn @ (base[:3, 3] - self.centre) + unknowns[:3]
            place = 6
        if self.tool_unknowns:
            tool[:3, 3] = tool[:3, 3] + tool[:3, :3] @ unknowns[place : place + 3]
        if self.tool_unknowns == 6:
            turn = Rotation.from_rotvec(unknowns[place + 3 : place + 6]).as_matrix()
            tool[:3, :3] = tool[:3, :3] @ turn
        points = self.points + unknowns[place + self.tool_unknowns :].reshape(-1, 3)
        return replace(self, base=base, tool=tool, points=points)


def initial_frames(
    measurements: Measurements, positions: FloatArray, rotations: FloatArray
) -> Frames:
    """Frames that fit the nominal arm's poses, ``(n, 3)`` and ``(n, 3, 3)``, best."""
    weights = np.ones(len(positions))
    for _ in range(_ROUNDS):
        frames = _weighted(measurements, positions, rotations, weights)
        distances = _distances(measurements, frames, positions, rotations)
        scale = max(float(np.median(distances)), 1e-9)
        weights = 1.0 / (1.0 + (distances / (3.0 * scale)) ** 2)
    return frames


def check_known(
    measurements: Measurements, frames: Frames, positions: FloatArray, rotations: FloatArray
) -> None:
    """Refuse measurements that other frames explain than those that are said to be known.

    ``frames`` are the best with these, for the nominal arm's poses ``(n, 3)`` and ``(n, 3, 3)``.

    Raises:
        OtherFrame: naming the frame.
    """
    if measurements.fixed_points is not None:
        return
    free = replace(measurements, frame_known=False, tool_known=False)
    found = initial_frames(free, positions, rotations)
    known, explained = (
        float(np.median(_distances(measurements, one, positions, rotations)))
        for one in (frames, found)
    )
    if explained > min(_EXPLAINED * known, _NOMINAL):
        return
    for name, is_known, frame in (
        ("base", measurements.frame_known, found.base),
        ("tool", measurements.tool_known, found.tool),
    ):
        distance = float(np.linalg.norm(frame[:3, 3]))
        angle = float(Rotation.from_matrix(frame[:3, :3]).magnitude())
        if is_known and (distance > OTHER[0] or angle > OTHER[1]):
            raise OtherFrame(name, distance, angle)


def _weighted(
    measurements: Measurements,
    positions: FloatArray,
    rotations: FloatArray,
    weights: FloatArray,
) -> Frames:
    roots = np.sqrt(weights)[:, None, None]
    if measurements.fixed_points is not None:
        return _of_points(measurements, positions, rotations, roots)
    measured = measurements.positions
    assert measured is not None
    base, tool = np.eye(4), np.eye(4)
    if measurements.rotations is not None:
        _turn(measurements, rotations, weights, base, tool)
    elif not measurements.frame_known:
        base[:3, :3] = _orthogonal_of_positions(measurements, positions, rotations, roots)
    # Positions: measured = turn p + shift + turn R point.
    turn = base[:3, :3]
    blocks = []
    if not measurements.frame_known:
        blocks.append(np.tile(np.eye(3), (len(positions), 1, 1)))
    if not measurements.tool_known:
        blocks.append(turn @ rotations)
    if blocks:
        left = (measured - positions @ turn.T)[..., None]
        matrix = (roots * np.concatenate(blocks, axis=2)).reshape(3 * len(positions), -1)
        found = np.linalg.lstsq(matrix, (roots * left).ravel(), rcond=None)[0]
        if not measurements.frame_known:
            base[:3, 3] = found[:3]
        if not measurements.tool_known:
            tool[:3, 3] = found[-3:]
    tool_unknowns = 0 if measurements.tool_known else 3 if measurements.rotations is None else 6
    centre = np.average(measured, axis=0, weights=weights)
    return Frames(
        base, tool, np.zeros((0, 3)), not measurements.frame_known, tool_unknowns, centre
    )


def _of_points(
    measurements: Measurements, positions: FloatArray, rotations: FloatArray, roots: FloatArray
) -> Frames:
    numbers, rows = measurements.touched
    touched = -np.eye(len(numbers))[rows]
    blocks = np.einsum("nm,ij->nimj", touched, np.eye(3)).reshape(len(rows), 3, -1)
    if not measurements.tool_known:
        blocks = np.concatenate([rotations, blocks], axis=2)
    matrix = (roots * blocks).reshape(-1, blocks.shape[2])
    found = np.linalg.lstsq(matrix, -(roots * positions[..., None]).ravel(), rcond=None)[0]
    tool = np.eye(4)
    if not measurements.tool_known:
        tool[:3, 3], found = found[:3], found[3:]
    unknowns = 0 if measurements.tool_known else 3
    return Frames(np.eye(4), tool, found.reshape(-1, 3), tool_unknowns=unknowns)


def _turn(
    measurements: Measurements,
    rotations: FloatArray,
    weights: FloatArray,
    base: FloatArray,
    tool: FloatArray,
) -> None:
    """Write the rotations of base and tool that turn the arm's into those measured."""
    measured = measurements.rotations
    assert measured is not None
    if not (measurements.frame_known or measurements.tool_known):
        form = np.einsum("n,nad,nbc->abcd", weights, measured, rotations).reshape(9, 9)
        left, _, _ = np.linalg.svd(form)
        guess = left[:, 0].reshape(3, 3)
        base[:3, :3] = _orthogonal(guess * np.sign(np.linalg.det(guess)))
    for _ in range(_ROUNDS):
        if not measurements.tool_known:
            turned = np.einsum("nji,kj,nkl->nil", rotations, base[:3, :3], measured)
            tool[:3, :3] = _orthogonal(np.einsum("n,nij->ij", weights, turned))
        if measurements.frame_known:
            return
        turned = np.einsum("nij,kj,nlk->nil", measured, tool[:3, :3], rotations)
        base[:3, :3] = _orthogonal(np.einsum("n,nij->ij", weights, turned))
        if measurements.tool_known:
            return


def _orthogonal_of_positions(
    measurements: Measurements, positions: FloatArray, rotations: FloatArray, roots: FloatArray
) -> FloatArray:
    """The rotation of the base, by turn^T measured - R point - shift = p, linear in all."""
    measured = measurements.positions
    assert measured is not None
    mean = np.average(measured, axis=0, weights=roots.ravel() ** 2)
    scale = max(float(np.abs(measured - mean).max()), 1e-9)
    blocks = [
        np.einsum("ij,nk->nijk", np.eye(3), (measured - mean) / scale).reshape(-1, 3, 9),
        np.tile(np.eye(3), (len(positions), 1, 1)),
    ]
    if not measurements.tool_known:
        blocks.append(-rotations)
    matrix = (roots * np.concatenate(blocks, axis=2)).reshape(3 * len(positions), -1)
    found = np.linalg.lstsq(matrix, (roots * positions[..., None]).ravel(), rcond=None)[0]
    return _orthogonal(found[:9].reshape(3, 3)).T


def _orthogonal(matrix: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix ``(3, 3)``."""
    left, _, right = np.linalg.svd(matrix)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return np.asarray(left @ flip @ right, dtype=np.float64)


def _distances(
    measurements: Measurements, frames: Frames, positions: FloatArray, rotations: FloatArray
) -> FloatArray:
    points = positions + rotations @ frames.tool[:3, 3]
    if measurements.fixed_points is not None:
        _, rows = measurements.touched
        return np.asarray(np.linalg.norm(points - frames.points[rows], axis=1))
    assert measurements.positions is not None
    reached = points @ frames.base[:3, :3].T + frames.base[:3, 3]
    return np.asarray(np.linalg.norm(reached - measurements.positions, axis=1))
