"""A short order in which a robot visits joint positions."""

from collections.abc import Sequence

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import unwrapped

#: A smaller gain than this is rounding [rad or m].
_ROUNDING = 1e-12


def visiting_order(
    start: FloatArray, joint_positions: FloatArray, turning: Sequence[int] = ()
) -> tuple[int, ...]:
    """Rows of joint positions ``(n, dof)`` in the order of a short path from ``start``.

    Nearest neighbours, improved by 2-opt; never longer than the given order. The distance of two
    joint positions is that of the joint that moves furthest; continuous joints, those with indices
    in ``turning``, go the shorter way around. Deterministic.
    """
    if len(joint_positions) == 0:
        return ()
    points = np.vstack([start, joint_positions])
    travel = np.array(
        [np.abs(unwrapped(points - point, 0.0, turning)).max(axis=1) for point in points]
    )
    given = np.arange(len(points))
    shortened = (_without_detours(way, travel) for way in (_nearest_neighbours(travel), given))
    best = min(shortened, key=lambda way: float(travel[way[:-1], way[1:]].sum()))
    return tuple((best[1:] - 1).tolist())


def _nearest_neighbours(travel: FloatArray) -> np.ndarray:
    """From point 0 to the nearest point that is not visited yet, and so on."""
    way = [0]
    left = np.ones(len(travel), dtype=bool)
    left[0] = False
    while left.any():
        nearest = int(np.where(left, travel[way[-1]], np.inf).argmin())
        way.append(nearest)
        left[nearest] = False
    return np.array(way)


def _without_detours(way: np.ndarray, travel: FloatArray) -> np.ndarray:
    """2-opt: the path with parts of it reversed where that is shorter; its start stays."""
    way = way.copy()
    improved = True
    while improved:
        improved = False
        for first in range(1, len(way)):
            before, lasts = way[first - 1], way[first:]
            # The gain of reversing from 'first' to each of 'lasts'. The end of the path is free.
            gain = travel[before, way[first]] - travel[before, lasts]
            gain[:-1] += (
                travel[lasts[:-1], way[first + 1 :]] - travel[way[first], way[first + 1 :]]
            )
            best = int(gain.argmax())
            if gain[best] > _ROUNDING:
                way[first : first + best + 1] = way[first : first + best + 1][::-1]
                improved = True
    return way
