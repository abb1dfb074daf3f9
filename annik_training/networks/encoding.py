"""How a pose enters the network: the first layer of the exported graph.

Everything here is traced into the ONNX file, so it keeps to operations that onnxruntime has in
double precision. It has no arctangent of that precision; :func:`arctangent2` takes the single
precision one and corrects it by one Newton step, which brings it to double precision.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

# As tensors, because the ONNX exporter stores a Python number beside a tensor in single precision.
_SMALLEST = torch.tensor(np.finfo(np.float64).tiny, dtype=torch.float64)
_ONE = torch.tensor(1.0, dtype=torch.float64)
_PI = torch.tensor(np.pi, dtype=torch.float64)
_HALF_PI = torch.tensor(0.5 * np.pi, dtype=torch.float64)
_TWO_PI = torch.tensor(2.0 * np.pi, dtype=torch.float64)
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

    The single-precision estimate is within 1e-6, so the error of one Newton step on
    ``r sin(angle - estimate) = sine cos(estimate) - cosine sin(estimate)``, being cubic, is far
    below double precision.

    Args:
        sine: any shape, float64.
        cosine: same shape.
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
    """Turns poses ``(n, 7)`` into features ``(n, features)``; both float64.

    A pose and the same pose with its quaternion negated must give the same features.
    """

    name: str
    features: int

    @abstractmethod
    def forward(self, poses: Tensor) -> Tensor:
        """Features of poses."""


class PositionRollPitchYaw(PoseEncoding):
    """x, y, z [m] and roll, pitch, yaw [rad]: the inputs of the paper's network.

    With ``w + y``, ``z - x``, ``w - y``, ``z + x`` of the quaternion, half the difference of yaw
    and roll, half their sum, and the pitch are arctangents [Bernardes2022]_, accurate up to the
    edge at a pitch of +90 degrees. There the sum has no effect on the orientation and can't be
    known; it is then taken as that of ``centre``.

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

    def forward(self, poses: Tensor) -> Tensor:
        """x, y, z, roll, pitch, yaw ``(n, 6)`` of poses ``(n, 7)``."""
        # z - x, z + x and w + y, w - y, in one product: few nodes make a quick graph.
        parts = poses[:, 3:] @ _QUATERNION_PARTS
        sines, cosines = parts[:, :2], parts[:, 2:]
        radii = torch.sqrt(sines * sines + cosines * cosines)
        from_edge, to_edge = radii[:, :1], radii[:, 1:]
        # Of the quaternion and its negative, take the one with w + y >= 0.
        sign = torch.where(cosines[:, :1] < 0.0, -_ONE, _ONE)
        # One call for the three angles, for the same reason.
        angles = arctangent2(
            torch.cat([sign * sines, to_edge], dim=1),
            torch.cat([sign * cosines, from_edge], dim=1),
        )
        half_difference, half_sum, to_edge_angle = angles[:, :1], angles[:, 1:2], angles[:, 2:]
        pitch = _HALF_PI - 2.0 * to_edge_angle
        # to_edge is sqrt(2) sin(d / 2) at a distance of d from the edge.
        at_edge = to_edge < self.EDGE / np.sqrt(2.0)
        half_sum = torch.where(at_edge, 0.5 * (self.centre[0] + self.centre[2]), half_sum)
        roll_yaw = torch.cat([half_sum, half_difference], dim=1) @ _SUM_AND_DIFFERENCE
        roll_yaw = roll_yaw - _TWO_PI * torch.round(roll_yaw / _TWO_PI)
        return torch.cat([poses[:, :3], roll_yaw[:, :1], pitch, roll_yaw[:, 1:]], dim=1)


class PositionRotationMatrix(PoseEncoding):
    """x, y, z [m] and the three axes of the end effector, the columns of its rotation matrix.

    The smoothest of the encodings: quadratic in the quaternion, without an edge anywhere, and the
    same for a quaternion and its negative. All three columns, though two would do: so the centre
    of a wrist, which lies back from the flange along one of them, is linear in the features.
    """

    name = "position_rotation_matrix"
    features = 12

    factors: tuple[Tensor, Tensor, Tensor]
    terms_to_features: Tensor

    def __init__(self) -> None:
        super().__init__()
        #: A and B ``(7, 13)`` and b ``(13,)``: the terms are (pose A) (pose B + b), each by each:
        #: x, y, z times one, and the ten products of two components of the quaternion.
        self.factors = _term_factors()
        #: ``(13, 12)``.
        self.terms_to_features = torch.block_diag(  # type: ignore[no-untyped-call]
            torch.eye(3, dtype=torch.float64), _PRODUCTS_TO_COLUMNS
        )

    def forward(self, poses: Tensor) -> Tensor:
        """Position and columns of the rotation matrix ``(n, 12)`` of poses ``(n, 7)``."""
        first, second, offset = self.factors
        return ((poses @ first) * (poses @ second + offset)) @ self.terms_to_features


def _term_factors() -> tuple[Tensor, Tensor, Tensor]:
    first, second = torch.zeros(2, 7, 3 + len(_PAIRS), dtype=torch.float64)
    offset = torch.zeros(3 + len(_PAIRS), dtype=torch.float64)
    for axis in range(3):
        first[axis, axis] = offset[axis] = 1.0
    for column, (left, right) in enumerate(_PAIRS, start=3):
        first[3 + left, column] = second[3 + right, column] = 1.0
    return first, second, offset
