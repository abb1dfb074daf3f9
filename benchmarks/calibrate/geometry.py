"""A plain geometric calibration to compare with: least squares, and nothing of annik's.

Every joint and link may be moved by six small parameters with a Gaussian prior (1 mm, 0.33
degrees); the frame of the instrument and the tool are free, from closed forms or many starts.
Residuals are weighted by their own spread and robustly (Huber), as is usual.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]

#: Standard deviations of the prior: of a length [m] and an angle [rad].
LENGTH, ANGLE = 1e-3, math.radians(0.33)
#: The same of a frame that is unknown, around its start, and of a ball's offset from it.
_FREE_LENGTH, _FREE_ANGLE, _BALL_OFFSET = 1.0, 1.0, 0.1
#: First standard deviations of a residual [m], [rad]; then estimated.
_FIRST_NOISE = (1e-3, 3e-3)
#: Of a ball in a socket, and of the distance of two sockets [m].
_SOCKET_NOISE, _DISTANCE_NOISE = 1e-4, 5e-5
_HUBER = 2.0
_ROUNDS, _STEPS = 6, 15


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain: placements ``(dof + 1, 4, 4)``, axes ``(dof, 3)``, small motions.

    ``motions`` are ``(dof + 1, 6)``, rotation vector and translation: the first before the first
    joint, number i after joint i.
    """

    placements: FloatArray
    axes: FloatArray
    turns: tuple[bool, ...]
    motions: FloatArray

    @classmethod
    def from_urdf(cls, urdf: str, tip: str | None = None) -> Chain:
        """The chain from the root to a link, by default the only one without children."""
        joints = [joint for joint in ElementTree.fromstring(urdf) if joint.tag == "joint"]
        above = {_link(joint, "child"): joint for joint in joints}
        if tip is None:
            (tip,) = set(above) - {_link(joint, "parent") for joint in joints}
        path = []
        while tip in above:
            path.append(above[tip])
            tip = _link(above[tip], "parent")
        placements, axes, turns = [np.eye(4)], [], []
        for joint in reversed(path):
            placements[-1] = placements[-1] @ _origin(joint)
            if joint.get("type") != "fixed":
                axis = _vector(joint.find("axis"), "xyz", "1 0 0")
                axes.append(axis / np.linalg.norm(axis))
                turns.append(joint.get("type") != "prismatic")
                placements.append(np.eye(4))
        count = len(placements)
        return cls(np.array(placements), np.array(axes), tuple(turns), np.zeros((count, 6)))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.axes)

    def poses(self, joint_positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions ``(n, 3)`` and rotations ``(n, 3, 3)``."""
        position, rotation, _ = self.evaluate(joint_positions)
        return position, rotation

    def frames_beside(self, nominal: Chain) -> tuple[FloatArray, FloatArray]:
        """Base and tool ``(4, 4)``: what a fit of the frames alone added before and after."""
        base = _matrix(self.motions[0]) @ self.placements[0] @ np.linalg.inv(nominal.placements[0])
        tool = _matrix(self.motions[-1]) @ self.placements[-1]
        return base, np.linalg.inv(nominal.placements[-1]) @ tool

    def evaluate(self, joint_positions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The same, and derivatives ``(n, 6, 6 (dof + 1))`` of position and rotation."""
        count = len(joint_positions)
        rotation, position = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        frames = []
        for place in range(self.dof + 1):
            if place > 0:
                axis, values = self.axes[place - 1], joint_positions[:, place - 1, None]
                if self.turns[place - 1]:
                    rotation = rotation @ Rotation.from_rotvec(values * axis).as_matrix()
                else:
                    position = position + values * (rotation @ axis)
            # The first motion is of the whole robot, in the frame of the instrument.
            steps = [_matrix(self.motions[place]), self.placements[place]]
            frames.append((position, rotation))
            for step in steps:
                position = position + rotation @ step[:3, 3]
                rotation = rotation @ step[:3, :3]
        columns = np.zeros((count, 6, self.dof + 1, 6))
        for place, (origin, axes) in enumerate(frames):
            lever = (position - origin)[:, :, None]
            columns[:, :3, place, :3] = np.cross(axes, lever, axis=1)
            columns[:, 3:, place, :3] = axes
            columns[:, :3, place, 3:] = axes
        return position, rotation, columns.reshape(count, 6, -1)


def fit_poses(
    chain: Chain,
    joint_positions: FloatArray,
    positions: FloatArray,
    rotations: FloatArray | None,
    *,
    frames_only: bool = False,
) -> Chain:
    """The chain with the frames, and unless ``frames_only`` all links, fitted to measurements."""
    chain = _aligned(chain, joint_positions, positions, rotations)
    free = [0, chain.dof]
    prior = np.tile([ANGLE] * 3 + [LENGTH] * 3, (chain.dof + 1, 1))
    prior[free] = [_FREE_ANGLE] * 3 + [_FREE_LENGTH] * 3
    used = np.zeros((chain.dof + 1, 6), dtype=np.bool_)
    used[free if frames_only else slice(None)] = True
    noise = np.array(_FIRST_NOISE)
    width = 3 if rotations is None else 6
    for _ in range(_ROUNDS):
        sigma = np.repeat(noise, 3)[:width]

        def residuals(found: Chain, sigma: FloatArray = sigma) -> tuple[FloatArray, FloatArray]:
            position, rotation, columns = found.evaluate(joint_positions)
            parts = [position - positions]
            if rotations is not None:
                turned = Rotation.from_matrix(rotation @ np.swapaxes(rotations, 1, 2))
                parts.append(turned.as_rotvec())
            return np.hstack(parts) / sigma, columns[:, :width] / sigma[:, None]

        chain = _least_squares(chain, residuals, used, prior)
        scaled, _ = residuals(chain)
        # 1.2533: from the mean of absolute values to a standard deviation.
        for part in range(width // 3):
            spread = 1.2533 * float(np.abs(scaled[:, 3 * part : 3 * part + 3]).mean())
            noise[part] = max(noise[part] * spread, 1e-9)
    return chain


def fit_sockets(
    chain: Chain,
    joint_positions: FloatArray,
    sockets: NDArray[np.int64],
    distances: Sequence[tuple[int, int, float]],
    *,
    frames_only: bool = False,
) -> Chain:
    """The chain fitted to joint positions with a ball in sockets ``(n,)``, numbered from 0.

    ``distances`` are between pairs of sockets [m]. ``frames_only``: the ball's offset alone.
    """
    prior = np.tile([ANGLE] * 3 + [LENGTH] * 3, (chain.dof + 1, 1))
    prior[-1] = [1.0] * 3 + [_BALL_OFFSET] * 3
    used = np.zeros((chain.dof + 1, 6), dtype=np.bool_)
    used[-1, 3:] = True
    if not frames_only:
        used[1:-1] = True
    count = int(sockets.max()) + 1
    members = np.zeros((count, len(sockets)))
    members[sockets, np.arange(len(sockets))] = 1.0
    members /= members.sum(axis=1, keepdims=True)

    def residuals(found: Chain) -> tuple[FloatArray, FloatArray]:
        # The sockets are where the balls are on average: their elimination.
        position, _, columns = found.evaluate(joint_positions)
        centres = members @ position
        moved = np.einsum("cn,nip->cip", members, columns[:, :3])
        rows = [(position - centres[sockets]) / _SOCKET_NOISE]
        derivatives = [(columns[:, :3] - moved[sockets]) / _SOCKET_NOISE]
        for first, second, distance in distances:
            between = centres[first] - centres[second]
            length = float(np.linalg.norm(between))
            row = np.array([(length - distance) / _DISTANCE_NOISE, 0.0, 0.0])
            along = between / length @ (moved[first] - moved[second]) / _DISTANCE_NOISE
            rows.append(row[None])
            derivatives.append(np.stack([along, 0.0 * along, 0.0 * along])[None])
        return np.concatenate(rows), np.concatenate(derivatives)

    for _ in range(_ROUNDS):
        chain = _least_squares(chain, residuals, used, prior)
    return chain


def _least_squares(
    chain: Chain,
    residuals: Callable[[Chain], tuple[FloatArray, FloatArray]],
    used: NDArray[np.bool_],
    prior: FloatArray,
) -> Chain:
    """Levenberg-Marquardt with Huber's weights, which are fixed for the call."""
    rows, _ = residuals(chain)
    norms = np.linalg.norm(rows, axis=1) / math.sqrt(rows.shape[1])
    weights = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(norms, 1e-12)))[:, None]
    damping = 1e-3

    def cost_of(one: Chain) -> float:
        weighted, scaled = weights * residuals(one)[0], (one.motions / prior)[used]
        return float((weighted**2).sum() + scaled @ scaled)

    cost = cost_of(chain)
    for _ in range(_STEPS):
        rows, columns = residuals(chain)
        jacobian = (weights[..., None] * columns)[:, :, used.ravel()] * prior[used]
        jacobian = jacobian.reshape(-1, int(used.sum()))
        parameters = (chain.motions / prior)[used]
        normal = jacobian.T @ jacobian + np.eye(len(parameters))
        gradient = jacobian.T @ (weights * rows).ravel() + parameters
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -gradient)
        motions = chain.motions.copy()
        motions[used] += step * prior[used]
        moved = replace(chain, motions=motions)
        new = cost_of(moved)
        if new < cost:
            finished = cost - new < 1e-9 * cost
            chain, cost, damping = moved, new, damping / 10.0
            if finished:
                break
        else:
            damping *= 10.0
    return chain


def _aligned(
    chain: Chain, joint_positions: FloatArray, positions: FloatArray, rotations: FloatArray | None
) -> Chain:
    """The chain in the frame of the instrument, with the tool that is measured."""
    place, turn = chain.poses(joint_positions)
    if rotations is None:
        base, tool = _frames_of_positions(place, turn, positions)
    else:
        base, tool = _frames_of_poses(place, turn, positions, rotations)
    placements = chain.placements.copy()
    placements[0] = base @ placements[0]
    placements[-1] = placements[-1] @ tool
    return replace(chain, placements=placements)


def _frames_of_poses(
    place: FloatArray, turn: FloatArray, positions: FloatArray, rotations: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Base and tool by the rotations between all poses and some of them, then linearly."""
    base, tool = np.eye(4), np.eye(4)
    some = np.arange(0, len(place), max(1, len(place) // 20))
    nominal, measured = (
        Rotation.from_matrix(
            (one[:, None] @ np.swapaxes(one[some], 1, 2)[None]).reshape(-1, 3, 3)
        ).as_rotvec()
        for one in (turn, rotations)
    )
    # Near half a turn the sign of a rotation vector is arbitrary.
    clear = (np.linalg.norm(nominal, axis=1) < 2.8) & (np.linalg.norm(measured, axis=1) < 2.8)
    base[:3, :3] = Rotation.align_vectors(measured[clear], nominal[clear])[0].as_matrix()
    turned = base[:3, :3] @ turn
    tool[:3, :3] = Rotation.from_matrix(np.swapaxes(turned, 1, 2) @ rotations).mean().as_matrix()
    base[:3, 3], tool[:3, 3] = _shifts(place, turn, base[:3, :3], positions)
    return base, tool


def _frames_of_positions(
    place: FloatArray, turn: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Base and offset of the tool by turns, from several offsets; the best of them."""
    best: tuple[float, Any] = (math.inf, None)
    for start in np.vstack([np.zeros((1, 3)), 0.2 * np.eye(3), -0.2 * np.eye(3)]):
        base, tool = np.eye(4), np.eye(4)
        tool[:3, 3] = start
        error = math.inf
        for _ in range(60):
            points = place + turn @ tool[:3, 3]
            centred = points - points.mean(axis=0), positions - positions.mean(axis=0)
            base[:3, :3] = Rotation.align_vectors(centred[1], centred[0])[0].as_matrix()
            base[:3, 3], tool[:3, 3] = _shifts(place, turn, base[:3, :3], positions)
            moved = base[:3, 3] + (place + turn @ tool[:3, 3]) @ base[:3, :3].T
            error = float(np.linalg.norm(moved - positions, axis=1).mean())
        best = min(best, (error, (base, tool)), key=lambda one: one[0])
    base, tool = best[1]
    return base, tool


def _shifts(
    place: FloatArray, turn: FloatArray, base: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Shifts of base and tool, linear once the base's rotation is known."""
    count = len(place)
    matrix = np.concatenate([np.tile(np.eye(3), (count, 1, 1)), base @ turn], axis=2)
    rest = positions - place @ base.T
    found = np.linalg.lstsq(matrix.reshape(-1, 6), rest.ravel(), rcond=None)[0]
    return found[:3], found[3:]


def _matrix(motion: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(motion[:3]).as_matrix()
    matrix[:3, 3] = motion[3:]
    return matrix


def _link(joint: ElementTree.Element, tag: str) -> str:
    link = joint.find(tag)
    return "" if link is None else link.get("link", "")


def _vector(element: ElementTree.Element | None, key: str, default: str) -> FloatArray:
    text = default if element is None else element.get(key, default)
    return np.array([float(part) for part in text.split()])


def _origin(joint: ElementTree.Element) -> FloatArray:
    origin = np.eye(4)
    element = joint.find("origin")
    angles = _vector(element, "rpy", "0 0 0")
    origin[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    origin[:3, 3] = _vector(element, "xyz", "0 0 0")
    return origin
