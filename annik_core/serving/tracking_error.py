"""Tracking error: target minus achieved pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray, single_pose_difference


@dataclass(frozen=True, eq=False)
class TrackingError:
    """Target minus achieved, ``(3,)`` each in the base frame: [m], and a rotation vector [rad]."""

    position: FloatArray
    orientation: FloatArray


def tracking_error(target: FloatArray, achieved: FloatArray) -> TrackingError:
    """Error of an achieved pose ``(7,)`` against its target ``(7,)``, both checked poses."""
    position, orientation = single_pose_difference(target, achieved)
    return TrackingError(np.array(position), np.array(orientation))
