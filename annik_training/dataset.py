"""Examples with their provenance: what the robot was, where the joints were, what pose that gave.

A dataset is saved as one ``.npz`` file (NumPy's zip of arrays), with the provenance as JSON and a
SHA-256 over everything, so that a truncated or altered file is recognised.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from annik_core.atomic_write import write_files_atomically
from annik_core.errors import DatasetError, InvalidRobotDefinition, UnreadableDataset
from annik_core.joint_limits import JointLimits
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_core.robot_library import robot_from_definition
from annik_training.design_registry import make_design

FORMAT_VERSION = 1
COMPUTED = "computed by the forward kinematics"


@dataclass(frozen=True, eq=False)
class Dataset:
    """Examples for one robot.

    Attributes:
        robot: the robot.
        joint_positions: ``(n, dof)`` [rad or m].
        poses: ``(n, 7)`` x, y, z [m], unit quaternion x, y, z, w: the end effector in the base
            frame at those joint positions.
        design: name of the design of experiments that chose the joint positions.
        design_options: its size and options.
        seed: the seed that the design drew from.
        source: how the poses came about.
    """

    robot: Robot
    joint_positions: FloatArray
    poses: FloatArray
    design: str
    design_options: Mapping[str, Any]
    seed: int
    source: str = COMPUTED

    def __len__(self) -> int:
        """Number of examples."""
        return len(self.joint_positions)

    @property
    def provenance(self) -> dict[str, Any]:
        """Everything but the numbers, as plain data."""
        return {
            "format_version": FORMAT_VERSION,
            "robot": dict(self.robot.definition),
            "robot_hash": self.robot.definition_hash,
            "joint_names": list(self.robot.joint_names),
            "design": self.design,
            "design_options": dict(self.design_options),
            "seed": self.seed,
            "source": self.source,
            "units": {"joint_positions": "rad or m", "poses": "m, quaternion x y z w"},
        }

    @property
    def content_hash(self) -> str:
        """SHA-256 over the provenance and the bytes of both arrays."""
        return _content_hash(self.provenance, self.joint_positions, self.poses)


def compute_dataset(
    robot: Robot, design: str, size: int, seed: int, options: Mapping[str, Any] | None = None
) -> Dataset:
    """Examples of a design, with the poses from the robot's forward kinematics.

    Args:
        robot: the robot.
        design: name of a registered design.
        size: its size; see the design's ``size_means``.
        seed: what a random design draws from.
        options: the design's own options.

    Raises:
        DesignError: if the design can't be made like this.
    """
    joint_positions = make_design(design, robot, size, seed, options)
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, design, {"size": size, **(options or {})}, seed)


def compute_random_dataset(robot: Robot, box: JointLimits, examples: int, seed: int) -> Dataset:
    """Uniformly random joint positions in a box, for evaluation."""
    rng = np.random.default_rng(seed)
    joint_positions = rng.uniform(box.lower, box.upper, (examples, robot.dof))
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, "random", {"size": examples}, seed)


def save_dataset(dataset: Dataset, path: Path) -> None:
    """Write a dataset; an existing file is replaced only by a complete new one.

    Raises:
        DatasetError: if the file can't be written.
    """
    stream = io.BytesIO()
    np.savez(
        stream,
        joint_positions=dataset.joint_positions,
        poses=dataset.poses,
        provenance=np.array(json.dumps(dataset.provenance, sort_keys=True)),
        sha256=np.array(dataset.content_hash),
    )
    try:
        write_files_atomically(path.parent, {path.name: stream.getvalue()})
    except OSError as error:
        raise DatasetError(f"dataset {path} can't be written: {error.strerror}") from error


def load_dataset(path: Path) -> Dataset:
    """Read a dataset and check that it is whole and unaltered.

    Raises:
        UnreadableDataset: if it is missing, truncated, altered, or not a dataset.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            joint_positions = archive["joint_positions"]
            poses = archive["poses"]
            provenance = json.loads(str(archive["provenance"]))
            expected_hash = str(archive["sha256"])
    except FileNotFoundError as error:
        raise UnreadableDataset(path, "no such file") from error
    except KeyError as error:
        raise UnreadableDataset(path, f"{error} is missing: not a dataset of annik") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise UnreadableDataset(path, f"truncated or not a dataset ({error})") from error
    if _content_hash(provenance, joint_positions, poses) != expected_hash:
        raise UnreadableDataset(path, "its content does not match its SHA-256: it was altered")
    if provenance.get("format_version") != FORMAT_VERSION:
        raise UnreadableDataset(
            path, f"format version {provenance.get('format_version')}, not {FORMAT_VERSION}"
        )
    try:
        robot = robot_from_definition(provenance["robot"], f"in {path}")
    except InvalidRobotDefinition as error:
        raise UnreadableDataset(path, str(error)) from error
    return Dataset(
        robot,
        joint_positions,
        poses,
        provenance["design"],
        provenance["design_options"],
        provenance["seed"],
        provenance["source"],
    )


def _content_hash(
    provenance: Mapping[str, Any], joint_positions: FloatArray, poses: FloatArray
) -> str:
    digest = hashlib.sha256(json.dumps(provenance, sort_keys=True).encode())
    for array in (joint_positions, poses):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
