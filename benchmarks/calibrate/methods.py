"""The ways to calibrate that are compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.dataset import MEASURED, Dataset
from annik_core.robots.library import load_robot
from annik_training.calibration.calibrate import CalibratedRobot, CalibrationOptions, calibrate
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import Part
from benchmarks.calibrate.geometry import FloatArray, fit_poses, fit_sockets
from benchmarks.calibrate.problems import MeasuredSet, Rows

#: Parts that version 0.1 chose from.
_PARTS_OF_0_1 = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT}),
    frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_NETWORKS}),
    frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.JOINT_NETWORKS, Part.POSE_NETWORK}),
)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where a calibrated robot is, in the frame of the instrument.

    Attributes:
        positions: ``(n, 3)`` [m].
        rotations: ``(n, 3, 3)``.
        bounds: ``(n, 2)`` stated bounds of distance [m] and angle [rad] for 95 of 100 rows.
        parts: of the model, in words.
    """

    positions: FloatArray
    rotations: FloatArray
    bounds: FloatArray | None = None
    parts: str = ""


@dataclass(frozen=True)
class Method:
    """A way to calibrate.

    Attributes:
        meaning: for the page.
        predict: from a set, its rows to calibrate with, and other joint positions.
        knows_sockets: whether it can use a ball in sockets.
    """

    meaning: str
    predict: Callable[[MeasuredSet, Rows, FloatArray], Prediction]
    knows_sockets: bool = True


def _geometry(frames_only: bool) -> Callable[[MeasuredSet, Rows, FloatArray], Prediction]:
    def predict(one: MeasuredSet, rows: Rows, joint_positions: FloatArray) -> Prediction:
        if rows.sockets is not None:
            found = fit_sockets(
                one.chain,
                rows.joint_positions,
                rows.sockets,
                rows.distances,
                frames_only=frames_only,
            )
        else:
            assert rows.positions is not None
            found = fit_poses(
                one.chain,
                rows.joint_positions,
                rows.positions,
                rows.rotations,
                frames_only=frames_only,
            )
        return Prediction(*found.poses(joint_positions))

    return predict


def _version_0_1(one: MeasuredSet, rows: Rows, joint_positions: FloatArray) -> Prediction:
    """Frames by plain least squares and the box of the data, as version 0.1 needs; its parts."""
    assert rows.positions is not None
    lower, upper = (edge(one.rows.joint_positions, axis=0) for edge in (np.min, np.max))
    box = dict(zip(one.joint_names, zip(lower, upper, strict=True), strict=True))
    robot = load_robot(one.urdf, end_effector_frame=one.tip, joint_box=box)
    framed = fit_poses(
        one.chain, rows.joint_positions, rows.positions, rows.rotations, frames_only=True
    )
    base, tool = framed.frames_beside(one.chain)
    turned = rows.rotations
    if turned is None:
        # Only to take the offset of the tool off the positions.
        _, turned = framed.poses(rows.joint_positions)
    measured = _matrices(rows.positions, turned)
    poses = np.linalg.inv(base) @ measured @ np.linalg.inv(tool)
    dataset = Dataset(robot, rows.joint_positions, _poses(poses), "measured", {}, 0, MEASURED)
    options = CalibrationOptions(position_only=rows.rotations is None, candidates=_PARTS_OF_0_1)
    found = calibrate(robot, dataset, options)
    return _predicted(found, base, tool, joint_positions)


def _annik(one: MeasuredSet, rows: Rows, joint_positions: FloatArray) -> Prediction:
    """As ``annik calibrate`` does: frames, parts and bound from the rows alone."""
    robot = load_robot(one.urdf, end_effector_frame=one.tip)
    distances = () if rows.sockets is None else rows.distances
    measurements = Measurements(
        rows.joint_positions,
        rows.positions,
        rows.rotations,
        rows.sockets,
        [KnownDistance(*distance) for distance in distances],
    )
    found = calibrate(robot, measurements)
    return _predicted(found, found.frames.base, found.frames.tool, joint_positions)


def _predicted(
    found: CalibratedRobot, base: FloatArray, tool: FloatArray, joint_positions: FloatArray
) -> Prediction:
    reached = found.robot.forward_kinematics.poses(joint_positions)
    turned = Rotation.from_quat(reached[:, 3:]).as_matrix()
    where = base @ _matrices(reached[:, :3], turned) @ tool
    bound = found.robot.error_bound
    assert bound is not None
    bounds = bound.of_rows(found.robot.in_box(joint_positions))
    parts = ", ".join(found.provenance["parts"])
    return Prediction(where[:, :3, 3], where[:, :3, :3], bounds, parts)


def _matrices(positions: FloatArray, rotations: FloatArray) -> FloatArray:
    matrices = np.tile(np.eye(4), (len(positions), 1, 1))
    matrices[:, :3, :3] = rotations
    matrices[:, :3, 3] = positions
    return matrices


def _poses(matrices: FloatArray) -> FloatArray:
    quaternions = Rotation.from_matrix(matrices[:, :3, :3]).as_quat(canonical=True)
    return np.concatenate([matrices[:, :3, 3], quaternions], axis=1)


#: By name, in the order of the columns.
METHODS: Mapping[str, Method] = {
    "nominal": Method("only the frames fitted", _geometry(frames_only=True)),
    "geometry": Method("plain least squares", _geometry(frames_only=False)),
    "version 0.1": Method(
        "the frames as for nominal, then the parts of version 0.1", _version_0_1, False
    ),
    "annik": Method("annik calibrate, from the rows alone", _annik),
}
