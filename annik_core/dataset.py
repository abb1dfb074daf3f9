"""Datasets: joint positions, the poses that they give, and their provenance.

A dataset is saved as one ``.npz`` file (NumPy's zip of arrays) with the provenance as JSON and a
SHA-256 over everything, by which a truncated or altered file is recognised.
"""

import hashlib
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray

from annik_core.errors import AnnikError
from annik_core.files import expanded, read_regular_file, write_files_atomically
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.definition import is_numeric
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot


class UnreadableDataset(AnnikError):
    """A dataset file is missing, truncated, altered, or not a dataset."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"dataset {path}: {reason}")


FORMAT_VERSION = 1
COMPUTED = "computed by the forward kinematics"
MEASURED = "measured on the robot"
#: Numbers of poses and joint positions hardly shrink: what unpacks to more is no dataset.
_MOST_UNPACKED = 64 * 1024 * 1024
_MOST_BYTES = 1024 * 1024 * 1024
UNITS = {"joint_positions": "rad or m", "poses": "m, quaternion x y z w"}

#: Allowed difference of computed poses from a new computation [m and rad]: rounding only.
POSE_AGREEMENT = 1e-9
#: Allowed difference of a quaternion's norm from 1: rounding to single precision.
QUATERNION_NORM_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Dataset:
    """Examples for one robot.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m].
        poses: ``(n, 7)`` of the end effector in the base frame: x, y, z [m], unit quaternion
            x, y, z, w.
        measurement_noise: standard deviations of a measured pose: of each coordinate of its
            position [m], and of its orientation [rad]; None if computed or unknown.
    """

    robot: Robot
    joint_positions: FloatArray
    poses: FloatArray
    design: str
    design_options: Mapping[str, Any]
    seed: int
    source: str = COMPUTED
    measurement_noise: tuple[float, float] | None = None

    def __len__(self) -> int:
        return len(self.joint_positions)

    def rows(self, keep: NDArray[np.bool_]) -> "Dataset":
        """The examples for which ``keep`` ``(n,)`` is true."""
        return replace(self, joint_positions=self.joint_positions[keep], poses=self.poses[keep])

    @property
    def provenance(self) -> dict[str, Any]:
        """Everything but the two arrays, as JSON values."""
        noise = self.measurement_noise
        return {
            "format_version": FORMAT_VERSION,
            "robot": dict(self.robot.definition),
            "robot_hash": self.robot.definition_hash,
            "joint_names": list(self.robot.joint_names),
            "design": self.design,
            "design_options": dict(self.design_options),
            "seed": self.seed,
            "source": self.source,
            "units": dict(UNITS),
            **({} if noise is None else {"measurement_noise": list(noise)}),
        }

    @property
    def content_hash(self) -> str:
        """SHA-256 over the provenance and the bytes of both arrays."""
        return _content_hash(self.provenance, self.joint_positions, self.poses)

    @property
    def measurements_hash(self) -> str:
        """SHA-256 over both arrays, independent of the provenance."""
        return _content_hash({}, self.joint_positions, self.poses)


def save_dataset(dataset: Dataset, path: str | Path) -> None:
    """Write a dataset; an existing file is replaced only by a complete new one.

    Raises:
        NotWritable: if the file can't be written.
    """
    stream = io.BytesIO()
    np.savez(
        stream,
        joint_positions=dataset.joint_positions,
        poses=dataset.poses,
        provenance=np.array(json.dumps(dataset.provenance, sort_keys=True)),
        sha256=np.array(dataset.content_hash),
    )
    path = Path(path)
    write_files_atomically(path.parent, {path.name: stream.getvalue()})


def load_dataset(path: str | Path) -> Dataset:
    """Read a dataset and check that it is complete, unaltered and agrees with its provenance.

    Raises:
        UnreadableDataset: if not, or if it is missing.
    """
    path = expanded(path)
    provenance, joint_positions, poses = _read(path)
    # Anyone can compute the hash of wrong content, so the content is checked too.
    robot = _checked_robot(path, provenance)
    _check_arrays(path, robot, joint_positions, poses)
    if provenance["source"] == COMPUTED:
        _check_forward_kinematics(path, robot, joint_positions, poses)
    return Dataset(
        robot,
        joint_positions,
        poses,
        provenance["design"],
        provenance["design_options"],
        provenance["seed"],
        provenance["source"],
        _checked_noise(path, provenance.get("measurement_noise")),
    )


def _read(path: Path) -> tuple[dict[str, Any], FloatArray, FloatArray]:
    try:
        content = read_regular_file(path, _MOST_BYTES)
    # ValueError: a path that no system could have.
    except (FileNotFoundError, ValueError) as error:
        raise UnreadableDataset(path, "no such file") from error
    except OSError as error:
        raise UnreadableDataset(path, f"can't be read ({error.strerror})") from error
    # The parsers of zip and NumPy raise errors of any kind on altered bytes.
    try:
        joint_positions, poses, text, expected_hash = _arrays(content)
    except Exception as error:
        raise UnreadableDataset(path, f"truncated or not a dataset ({error})") from error
    try:
        provenance = json.loads(str(text))
        altered = _content_hash(provenance, joint_positions, poses) != str(expected_hash)
    except (ValueError, RecursionError) as error:
        raise UnreadableDataset(path, f"its provenance is not JSON ({error})") from error
    if not isinstance(provenance, dict):
        raise UnreadableDataset(path, "its provenance is not a mapping of names to values")
    if altered:
        raise UnreadableDataset(path, "its content does not match its SHA-256: it was altered")
    return provenance, joint_positions, poses


def _arrays(content: bytes) -> list[NDArray[Any]]:
    with ZipFile(io.BytesIO(content)) as archive:
        entries = archive.infolist()
        unpacked = sum(entry.file_size for entry in entries)
        if unpacked > _MOST_UNPACKED + 2 * len(content):
            raise ValueError(f"its {len(content)} bytes would unpack to {unpacked}")
        # Other methods of compression reserve memory as the file demands.
        if not {entry.compress_type for entry in entries} <= {ZIP_STORED, ZIP_DEFLATED}:
            raise ValueError("it is compressed by another method than deflate")
        arrays = []
        for name in ("joint_positions", "poses", "provenance", "sha256"):
            with archive.open(f"{name}.npy") as member:
                arrays.append(np.lib.format.read_array(member, allow_pickle=False))
    return arrays


def _checked_robot(path: Path, provenance: Mapping[str, Any]) -> Robot:
    version = provenance.get("format_version")
    if version != FORMAT_VERSION:
        raise UnreadableDataset(path, f"format version {version!r}, not {FORMAT_VERSION}")
    for key, kind, what in (
        ("robot", dict, "a mapping"),
        ("design", str, "a name"),
        ("design_options", dict, "a mapping"),
        ("seed", int, "an integer"),
        ("source", str, "a text"),
    ):
        if key not in provenance:
            raise UnreadableDataset(path, f"its provenance lacks {key!r}")
        # In Python, True is an int.
        if not isinstance(provenance[key], kind) or isinstance(provenance[key], bool):
            raise UnreadableDataset(path, f"{key!r} is {provenance[key]!r}, not {what}")
    try:
        robot = robot_from_definition(provenance["robot"], f"in {path}")
    # The definition may hold any JSON value.
    except Exception as error:
        raise UnreadableDataset(path, f"its robot can't be used ({error})") from error
    for key, expected in (
        ("robot_hash", robot.definition_hash),
        ("joint_names", list(robot.joint_names)),
        ("units", UNITS),
    ):
        if provenance.get(key) != expected:
            raise UnreadableDataset(
                path, f"{key!r} is {provenance.get(key)!r}; for its robot it is {expected!r}"
            )
    return robot


def _checked_noise(path: Path, noise: Any) -> tuple[float, float] | None:
    if noise is None:
        return None
    if (
        not isinstance(noise, list)
        or len(noise) != 2
        or not is_numeric(noise)
        or not all(0.0 <= number < math.inf for number in noise)
    ):
        raise UnreadableDataset(
            path, f"'measurement_noise' is {noise!r}, not two standard deviations [m, rad]"
        )
    return float(noise[0]), float(noise[1])


def _check_arrays(
    path: Path, robot: Robot, joint_positions: FloatArray, poses: FloatArray
) -> None:
    for name, array, columns in (
        ("joint_positions", joint_positions, robot.dof),
        ("poses", poses, 7),
    ):
        if array.dtype != np.float64:
            raise UnreadableDataset(path, f"{name} are {array.dtype}, not float64")
        if array.ndim != 2 or array.shape[1] != columns:
            raise UnreadableDataset(path, f"{name} have shape {array.shape}, not (n, {columns})")
        if not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise UnreadableDataset(path, f"row {row} of {name} holds a number that is not finite")
    if len(joint_positions) != len(poses):
        raise UnreadableDataset(
            path, f"it has {len(joint_positions)} joint positions but {len(poses)} poses"
        )
    if len(poses) == 0:
        raise UnreadableDataset(path, "it holds no examples")
    for row, positions in enumerate(joint_positions):
        violation = robot.joint_limits.violation(positions)
        if violation is not None:
            raise UnreadableDataset(path, f"row {row} of joint_positions: {violation}")
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(poses[:, 3:], axis=1)
    wrong = np.flatnonzero(~(np.abs(norms - 1.0) <= QUATERNION_NORM_TOLERANCE))
    if len(wrong):
        raise UnreadableDataset(
            path, f"row {wrong[0]} of poses: the quaternion's norm is {norms[wrong[0]]:.9g}, not 1"
        )


def _check_forward_kinematics(
    path: Path, robot: Robot, joint_positions: FloatArray, poses: FloatArray
) -> None:
    with np.errstate(over="ignore"):
        distances, angles = pose_distance(poses, robot.forward_kinematics.poses(joint_positions))
    # A NaN from an overflow disagrees, so not '>'.
    wrong = np.flatnonzero(~((distances <= POSE_AGREEMENT) & (angles <= POSE_AGREEMENT)))
    if len(wrong):
        row = wrong[0]
        raise UnreadableDataset(
            path,
            f"row {row} of poses is {distances[row]:.3g} m and {angles[row]:.3g} rad from where "
            "the forward kinematics takes its joint positions",
        )


def _content_hash(
    provenance: Mapping[str, Any], joint_positions: FloatArray, poses: FloatArray
) -> str:
    digest = hashlib.sha256(json.dumps(provenance, sort_keys=True).encode())
    for array in (joint_positions, poses):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
