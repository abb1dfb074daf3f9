"""Meshes of links and joints."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_view.skeleton import Posture

#: Corners of a circle.
_CORNERS = 20
#: Radius of the first link and of the last, as shares of the reach.
_THICK, _THIN = 0.045, 0.018
#: Radius and length of a joint, as shares of the radius of its link.
_JOINT_RADIUS, _JOINT_LENGTH = 1.25, 2.7


class Mesh(NamedTuple):
    """Triangles: vertices ``(n, 3)`` [m], and the rows of vertices of each, ``(m, 3)``."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


def links(posture: Posture, reach: float) -> Mesh:
    """A tapered tube from each point of a robot to the next; the base's is the thickest."""
    points, radii = posture.points, _radii(len(posture.points), reach)
    return _joined(
        [
            tube(start, end, thick, thin)
            for start, end, thick, thin in zip(
                points[:-1], points[1:], radii[:-1], radii[1:], strict=True
            )
        ]
    )


def joints(posture: Posture, reach: float) -> Mesh:
    """A short cylinder along the axis of each joint."""
    radii = _radii(len(posture.points), reach)[1:-1]
    return _joined(
        [
            tube(
                point - 0.5 * _JOINT_LENGTH * radius * axis,
                point + 0.5 * _JOINT_LENGTH * radius * axis,
                _JOINT_RADIUS * radius,
                _JOINT_RADIUS * radius,
            )
            for point, axis, radius in zip(
                posture.points[1:-1], posture.axes, radii.tolist(), strict=True
            )
        ]
    )


def whole(posture: Posture, reach: float) -> Mesh:
    """Links and joints as one mesh."""
    return _joined([links(posture, reach), joints(posture, reach)])


def tube(start: FloatArray, end: FloatArray, first: float, last: float) -> Mesh:
    """A closed tube between two points with two radii; of no length, a disc."""
    along = end - start
    length = float(np.linalg.norm(along))
    along = np.array([0.0, 0.0, 1.0]) if length < 1e-9 else along / length
    least = np.eye(3)[np.argmin(np.abs(along))]
    across = np.cross(along, least)
    across /= np.linalg.norm(across)
    circle = _COSINES * across + _SINES * np.cross(along, across)
    lower, upper = start + first * circle, end + last * circle
    # The ends have vertices of their own, so that their edges are shaded sharply.
    vertices = np.vstack([lower, upper, lower, start, upper, end])
    return Mesh(vertices.astype(np.float32), _TUBE)


def _radii(count: int, reach: float) -> FloatArray:
    return np.linspace(_THICK * reach, _THIN * reach, count)


def _joined(parts: list[Mesh]) -> Mesh:
    before = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + start for part, start in zip(parts, before, strict=True)]
    vertices = np.vstack([part.vertices for part in parts])
    return Mesh(vertices, np.vstack(faces).astype(np.uint32))


def _tube_faces() -> NDArray[np.uint32]:
    corner = np.arange(_CORNERS)
    following = np.roll(corner, -1)
    lower, upper, below = corner, corner + _CORNERS, 2 * _CORNERS
    start, above = 3 * _CORNERS, 3 * _CORNERS + 1
    end = above + _CORNERS
    sides = [
        np.column_stack([lower, following, upper]),
        np.column_stack([following, following + _CORNERS, upper]),
    ]
    first = np.column_stack([below + following, below + corner, np.full(_CORNERS, start)])
    last = np.column_stack([above + corner, above + following, np.full(_CORNERS, end)])
    return np.vstack([*sides, first, last]).astype(np.uint32)


_ANGLES = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)[:, np.newaxis]
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)
_TUBE = _tube_faces()
