"""In what a real arm differs from its description, as learned from measured poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from annik_core.error_bound import ErrorBound
from annik_core.errors import InvalidRobotDefinition
from annik_core.joint_correction import JointNetworks, check_shape
from annik_core.pose import QUATERNION_NORM_TOLERANCE, FloatArray
from annik_core.pose_correction import PoseNetwork
from annik_core.robot import checked_numbers

_PARTS = ("joint_networks", "pose_network", "error_bound")
_ENTRIES = ("placements", *_PARTS, "provenance")


@dataclass(frozen=True, eq=False)
class ArmCorrections:
    """The entry ``corrections`` of an arm's definition.

    Attributes:
        placements: ``(dof + 1, 7)`` small motions, as poses, of all that follows: the first before
            the first joint, in the base frame; number i after the i-th joint, in its frame.
        joint_networks: corrections of the joint positions, or None.
        pose_network: a correction of the end effector's pose, or None.
        error_bound: what error is left, or None if nobody knows.
        provenance: from what they were learned, and how; plain data.
    """

    placements: FloatArray
    joint_networks: JointNetworks | None = None
    pose_network: PoseNetwork | None = None
    error_bound: ErrorBound | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def as_plain_data(self) -> dict[str, Any]:
        """For a robot definition."""
        data: dict[str, Any] = {"placements": self.placements.tolist()}
        for name in _PARTS:
            part = getattr(self, name)
            if part is not None:
                data[name] = part.as_plain_data()
        if self.provenance:
            data["provenance"] = dict(self.provenance)
        return data

    @classmethod
    def from_plain_data(cls, data: Any, dof: int, source: str) -> ArmCorrections:
        """The reverse of :meth:`as_plain_data`.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        if not isinstance(data, Mapping) or "placements" not in data:
            raise InvalidRobotDefinition(source, "'corrections' is not a mapping with placements")
        for name in data:
            if name not in _ENTRIES:
                raise InvalidRobotDefinition(
                    source, f"corrections.{name} is not one of {', '.join(_ENTRIES)}"
                )
        placements = checked_numbers(data["placements"], "corrections.placements", source)
        check_shape(placements, (dof + 1, 7), "corrections.placements", source)
        norms = np.linalg.norm(placements[:, 3:], axis=1)
        if not (
            np.isfinite(placements).all()
            and (np.abs(norms - 1.0) <= QUATERNION_NORM_TOLERANCE).all()
        ):
            raise InvalidRobotDefinition(
                source, "corrections.placements are not x, y, z and a unit quaternion each"
            )
        parts: dict[str, Any] = {
            name: part.from_plain_data(data[name], dof, source)
            for name, part in (
                ("joint_networks", JointNetworks),
                ("pose_network", PoseNetwork),
                ("error_bound", ErrorBound),
            )
            if data.get(name) is not None
        }
        provenance = data.get("provenance")
        if provenance is None:
            provenance = {}
        if not isinstance(provenance, Mapping):
            raise InvalidRobotDefinition(source, "corrections.provenance is not a mapping")
        placements.flags.writeable = False
        return cls(placements, **parts, provenance=provenance)
