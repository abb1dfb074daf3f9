"""In which order to visit joint positions, so that a robot travels little."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray

#: A detour taken out that saves less than this [rad or m] is rounding.
_ROUNDING = 1e-12


def visiting_order(start: FloatArray, joint_positions: FloatArray) -> tuple[int, ...]:
    """A short way from ``start`` through all of the joint positions: each row once.

    The nearest neighbour each time, then detours are taken out by reversing parts of the way
    (2-opt) until no reversal helps. Never longer than the order in which they are given. It
    depends on its arguments alone.

    Args:
        start: ``(dof,)`` where the robot is [rad or m].
        joint_positions: ``(n, dof)`` [rad or m].

    Returns:
        The rows in the order to visit them.
    """
    if len(joint_positions) == 0:
        return ()
    points = np.vstack([start, joint_positions])
    travel = np.zeros((len(points), len(points)))
    for joint in points.T:
        np.maximum(travel, np.abs(joint[:, np.newaxis] - joint), out=travel)
    given = np.arange(len(points))
    shortened = (_without_detours(way, travel) for way in (_nearest_neighbours(travel), given))
    best = min(shortened, key=lambda way: float(travel[way[:-1], way[1:]].sum()))
    return tuple((best[1:] - 1).tolist())


def travel_length(start: FloatArray, joint_positions: FloatArray, order: tuple[int, ...]) -> float:
    """How far it is from ``start`` through the rows in this order [rad or m].

    From one to the next it is as far as the joint that moves furthest: all joints move at the
    same time, at one limit of velocity.
    """
    way = np.vstack([start, joint_positions[list(order)]])
    return float(np.abs(np.diff(way, axis=0)).max(axis=1, initial=0.0).sum())


def _nearest_neighbours(travel: FloatArray) -> np.ndarray:
    """From point 0 to the nearest point that was not visited yet, and so on."""
    way = [0]
    left = np.ones(len(travel), dtype=bool)
    left[0] = False
    while left.any():
        nearest = int(np.where(left, travel[way[-1]], np.inf).argmin())
        way.append(nearest)
        left[nearest] = False
    return np.array(way)


def _without_detours(way: np.ndarray, travel: FloatArray) -> np.ndarray:
    """The way, whose first point stays, with parts of it reversed where that is shorter."""
    way = way.copy()
    improved = True
    while improved:
        improved = False
        for first in range(1, len(way)):
            before, lasts = way[first - 1], way[first:]
            # Reversed from 'first' to 'last': its ends change places. The end of the way is free.
            gain = travel[before, way[first]] - travel[before, lasts]
            gain[:-1] += (
                travel[lasts[:-1], way[first + 1 :]] - travel[way[first], way[first + 1 :]]
            )
            best = int(gain.argmax())
            if gain[best] > _ROUNDING:
                way[first : first + best + 1] = way[first : first + best + 1][::-1]
                improved = True
    return way
