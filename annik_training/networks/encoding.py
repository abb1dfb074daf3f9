"""Encodings of a pose: the first part of the graph of a model file.

They are traced into ONNX and keep to operators that onnxruntime has in double precision. It has no
arctangent of that precision: :func:`arctangent2` corrects the single-precision one.
"""

from abc import abstractmethod
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

# As vectors, because the ONNX exporter may store a Python number, or a tensor without dimensions,
# in single precision.
_SMALLEST = torch.tensor([np.finfo(np.float64).tiny], dtype=torch.float64)
_ONE = torch.tensor([1.0], dtype=torch.float64)
_PI = torch.tensor([np.pi], dtype=torch.float64)
_HALF_PI = torch.tensor([0.5 * np.pi], dtype=torch.float64)
_TWO_PI = torch.tensor([2.0 * np.pi], dtype=torch.float64)
# x, y, z, w to z - x, z + x, w + y, w - y; half sum, half difference to roll, yaw.
_QUATERNION_PARTS = torch.tensor(
    [[-1, 1, 0, 0], [0, 0, 1, -1], [1, 1, 0, 0], [0, 0, 1, 1]], dtype=torch.float64
)
_SUM_AND_DIFFERENCE = torch.tensor([[1, 1], [-1, 1]], dtype=torch.float64)
# The ten products of x, y, z, w: xx, yy, zz, ww, xy, xz, xw, yz, yw, zw.
_PAIRS = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
# Rows: the products in this order; columns: the rotation matrix, column by column.
_PRODUCTS_TO_COLUMNS = torch.tensor(
    [
        [1, 0, 0, 0, -1, 0, 0, 0, -1],
        [-1, 0, 0, 0, 1, 0, 0, 0, -1],
        [-1, 0, 0, 0, -1, 0, 0, 0, 1],
        [1, 0, 0, 0, 1, 0, 0, 0, 1],
        [0, 2, 0, 2, 0, 0, 0, 0, 0],
        [0, 0, 2, 0, 0, 0, 2, 0, 0],
        [0, 0, 0, 0, 0, 2, 0, -2, 0],
        [0, 0, 0, 0, 0, 2, 0, 2, 0],
        [0, 0, -2, 0, 0, 0, 2, 0, 0],
        [0, 2, 0, -2, 0, 0, 0, 0, 0],
    ],
    dtype=torch.float64,
)


def arctangent2(sine: Tensor, cosine: Tensor) -> Tensor:
    """Angle in (-pi, pi] whose sine and cosine are proportional to these; 0 where both are 0.

    One Newton step on ``r sin(angle - estimate) = sine cos(estimate) - cosine sin(estimate)``.
    Its error is cubic in that of the single-precision estimate, 1e-6: below double precision.
    """
    radius = torch.sqrt(sine * sine + cosine * cosine)
    safe_radius = torch.maximum(radius, _SMALLEST)
    # atan(y / x) = 2 atan(y / (r + x)), which stays away from the pole for x >= 0.
    ratio = sine / (safe_radius + torch.abs(cosine))
    acute = 2.0 * torch.atan(ratio.to(torch.float32)).to(torch.float64)
    half_turn = torch.where(sine < 0.0, -_PI, _PI)
    estimate = torch.where(cosine < 0.0, half_turn - acute, acute)
    correction = sine * torch.cos(estimate) - cosine * torch.sin(estimate)
    return estimate + correction / safe_radius


class PoseEncoding(nn.Module):
    """Poses ``(n, 7)`` to the features ``(n, m)`` that a network sees; both float64.

    Features are linear in the terms of the encoding. A quaternion and its negative have the same.
    """

    name: str  #: of the encoding in a model file
    features: int  #: number of features, m
    terms_to_features: Tensor  #: ``(t, m)``; features are ``terms @ terms_to_features``

    @abstractmethod
    def terms(self, poses: Tensor) -> Tensor:
        """Terms ``(n, t)`` of poses ``(n, 7)``: the tensor ``features`` of a model file."""

    def forward(self, poses: Tensor) -> Tensor:
        """Features ``(n, m)`` of poses ``(n, 7)``."""
        return self.terms(poses) @ self.terms_to_features


class PositionRollPitchYaw(PoseEncoding):
    """x, y, z [m] and roll, pitch, yaw [rad]: the inputs of the paper's network.

    Half the difference of yaw and roll, half their sum, and the pitch are arctangents of
    ``w + y``, ``z - x``, ``w - y`` and ``z + x`` of the quaternion [Bernardes2022]_, accurate up
    to a pitch of +90 degrees. There the sum has no effect on the orientation: that of ``centre``
    is taken.

    Args:
        centre: ``(3,)`` roll, pitch, yaw in the middle of the workspace [rad].

    References:
        [Bernardes2022] E. Bernardes, S. Viollet: Quaternion to Euler angles conversion: a direct,
        general and computationally efficient method. PLoS ONE 17(11), 2022.
    """

    name = "position_roll_pitch_yaw"
    features = 6
    #: Closer than this to a pitch of 90 degrees, the sum of roll and yaw is not decoded [rad].
    EDGE = 1e-8

    centre: Tensor

    def __init__(self, centre: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        super().__init__()
        self.register_buffer("centre", torch.as_tensor(centre, dtype=torch.float64))
        self.terms_to_features = torch.eye(self.features, dtype=torch.float64)

    def forward(self, poses: Tensor) -> Tensor:
        """x, y, z, roll, pitch, yaw ``(n, 6)`` of poses ``(n, 7)``."""
        return self.terms(poses)

    def terms(self, poses: Tensor) -> Tensor:
        """The features themselves."""
        # z - x, z + x and w + y, w - y, in one product: few nodes make a fast graph.
        parts = poses[:, 3:] @ _QUATERNION_PARTS
        sines, cosines = parts[:, :2], parts[:, 2:]
        radii = torch.sqrt(sines * sines + cosines * cosines)
        from_edge, to_edge = radii[:, :1], radii[:, 1:]
        # Of the quaternion and its negative, take the one with w + y >= 0.
        sign = torch.where(cosines[:, :1] < 0.0, -_ONE, _ONE)
        # One call for all three angles, for the same reason.
        angles = arctangent2(
            torch.cat([sign * sines, to_edge], dim=1),
            torch.cat([sign * cosines, from_edge], dim=1),
        )
        half_difference, half_sum, to_edge_angle = angles[:, :1], angles[:, 1:2], angles[:, 2:]
        pitch = _HALF_PI - 2.0 * to_edge_angle
        # to_edge is sqrt(2) sin(d / 2) at a distance of d from the edge.
        at_edge = to_edge < self.EDGE / np.sqrt(2.0)
        half_sum = torch.where(at_edge, 0.5 * (self.centre[:1] + self.centre[2:]), half_sum)
        roll_yaw = torch.cat([half_sum, half_difference], dim=1) @ _SUM_AND_DIFFERENCE
        roll_yaw = roll_yaw - _TWO_PI * torch.round(roll_yaw / _TWO_PI)
        return torch.cat([poses[:, :3], roll_yaw[:, :1], pitch, roll_yaw[:, 1:]], dim=1)


class PositionRotationMatrix(PoseEncoding):
    """x, y, z [m] and the three axes of the end effector, the columns of its rotation matrix.

    Quadratic in the quaternion and smooth everywhere. Two columns would determine the third; with
    all three, the centre of a wrist, back from the flange along one of them, is linear in the
    features.
    """

    name = "position_rotation_matrix"
    features = 12

    first_factor: Tensor
    second_factor: Tensor
    second_offset: Tensor

    def __init__(self) -> None:
        super().__init__()
        # (7, 13), (7, 13) and (13,).
        first, second, offset = _term_factors()
        self.register_buffer("first_factor", first)
        self.register_buffer("second_factor", second)
        self.register_buffer("second_offset", offset)
        self.terms_to_features = torch.block_diag(  # type: ignore[no-untyped-call]
            torch.eye(3, dtype=torch.float64), _PRODUCTS_TO_COLUMNS
        )

    def terms(self, poses: Tensor) -> Tensor:
        """x, y, z and the ten products of two components of the quaternion ``(n, 13)``.

        In one elementwise product of two linear functions of the pose.
        """
        return (poses @ self.first_factor) * (poses @ self.second_factor + self.second_offset)


def _term_factors() -> tuple[Tensor, Tensor, Tensor]:
    first, second = torch.zeros(2, 7, 3 + len(_PAIRS), dtype=torch.float64)
    offset = torch.zeros(3 + len(_PAIRS), dtype=torch.float64)
    for axis in range(3):
        first[axis, axis] = offset[axis] = 1.0
    for column, (left, right) in enumerate(_PAIRS, start=3):
        first[3 + left, column] = second[3 + right, column] = 1.0
    return first, second, offset
