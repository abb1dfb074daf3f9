"""Measurements of a folder, and their splits into rows to calibrate with and rows to judge by."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.calibrate.geometry import Chain, FloatArray, fit_sockets

#: The end effector of a description for sockets.
BALL = "ball_link"
#: Between the two sockets of a placement [m].
SOCKET_DISTANCE = 0.05
#: Most rows that a split is judged by.
_HELD_OUT = 500
#: Largest part of the rows to calibrate with.
_MOST = 0.75
_SOCKET = re.compile(r"hole_(\d+)\.csv")


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows of a set; sockets are numbered, two to a placement."""

    joint_positions: FloatArray
    positions: FloatArray | None = None
    rotations: FloatArray | None = None
    sockets: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.joint_positions)

    def at(self, which: NDArray[np.int64]) -> Rows:
        """These rows."""
        return Rows(
            self.joint_positions[which],
            None if self.positions is None else self.positions[which],
            None if self.rotations is None else self.rotations[which],
            None if self.sockets is None else self.sockets[which],
        )

    @property
    def distances(self) -> tuple[tuple[int, int, float], ...]:
        """Known distances between sockets [m]."""
        assert self.sockets is not None
        pairs = range(0, int(self.sockets.max()) + 1, 2)
        return tuple((first, first + 1, SOCKET_DISTANCE) for first in pairs)


@dataclass(frozen=True, eq=False)
class MeasuredSet:
    """The measurements of one robot."""

    name: str
    urdf: Path
    tip: str | None
    joint_names: tuple[str, ...]  #: of the columns; empty without a header
    rows: Rows

    @property
    def has_sockets(self) -> bool:
        """Whether a ball in sockets was measured, not poses."""
        return self.rows.sockets is not None

    @property
    def chain(self) -> Chain:
        """The nominal chain."""
        return Chain.from_urdf(self.urdf.read_text("utf-8"), self.tip)

    def sizes(self, wanted: tuple[int, ...]) -> tuple[int, ...]:
        """How many rows to calibrate with: those wanted, and the most of a small set."""
        most = int(_MOST * len(self.rows))
        sizes = tuple(size for size in wanted if size <= most)
        if len(sizes) < len(wanted) and most < 2 * max(sizes, default=most):
            sizes = (*sizes, 10 * (most // 10))
        return sizes

    @property
    def placements(self) -> int:
        """Number of placements of the sockets."""
        assert self.rows.sockets is not None
        return (int(self.rows.sockets.max()) + 1) // 2

    def split(self, size: int, number: int) -> tuple[Rows, Rows]:
        """Rows to calibrate with, and others; of sockets, a placement is left out."""
        if self.rows.sockets is not None:
            held_out = self.rows.sockets // 2 == number
            rest = self.rows.at(np.flatnonzero(~held_out))
            assert rest.sockets is not None
            sockets = np.unique(rest.sockets, return_inverse=True)[1].astype(np.int64)
            return Rows(rest.joint_positions, sockets=sockets), self.rows.at(
                np.flatnonzero(held_out)
            )
        order = np.random.default_rng(number).permutation(len(self.rows))
        return self.rows.at(order[:size]), self.rows.at(order[max(size, len(order) - _HELD_OUT) :])


def find_sets(folder: Path) -> dict[str, MeasuredSet]:
    """The sets of a folder by name: in measured/ and in sockets/."""
    return {
        one.name: one for one in (*_measured(folder / "measured"), *_sockets(folder / "sockets"))
    }


@lru_cache
def cached_sets(folder: Path) -> dict[str, MeasuredSet]:
    """The same, read once in a process."""
    return find_sets(folder)


def _measured(folder: Path) -> Iterator[MeasuredSet]:
    for path in sorted(folder.glob("*/*.csv")):
        (urdf,) = path.parent.glob("*.urdf")
        with path.open(encoding="utf-8", newline="") as file:
            header, *lines = csv.reader(file)
        numbers = np.array([[float(cell) for cell in line] for line in lines])
        at = {name: numbers[:, index] for index, name in enumerate(header)}
        joints = tuple(header[: header.index("x")])
        rotations = None
        if "qw" in at:
            quaternions = np.stack([at[name] for name in ("qx", "qy", "qz", "qw")], axis=1)
            rotations = Rotation.from_quat(quaternions).as_matrix()
        positions = np.stack([at[name] for name in "xyz"], axis=1)
        joint_positions = np.stack([at[name] for name in joints], axis=1)
        rows = Rows(joint_positions, positions, rotations)
        yield MeasuredSet(path.parent.name, urdf, None, joints, rows)


def _sockets(folder: Path) -> Iterator[MeasuredSet]:
    nominal = sorted((folder / "nominal").glob("*.urdf"))
    for robot in sorted(path for path in folder.glob("*") if path.is_dir()):
        places = sorted(path for path in robot.glob("*") if (path / "hole_1.csv").exists())
        if not places:
            continue
        parts = [
            np.loadtxt(place / f"hole_{hole}.csv", delimiter=",")
            for place in places
            for hole in (0, 1)
        ]
        numbers = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        rows = Rows(np.concatenate(parts), sockets=numbers)
        urdf = _description(nominal, rows)
        if urdf is not None:
            yield MeasuredSet(robot.name, urdf, BALL, (), rows)


def _description(nominal: list[Path], rows: Rows) -> Path | None:
    """Of the descriptions with as many joints, the one whose balls are nearest to each other."""
    sockets = rows.sockets
    assert sockets is not None
    spreads = {}
    for path in nominal:
        chain = Chain.from_urdf(path.read_text("utf-8"), BALL)
        if chain.dof == rows.joint_positions.shape[1]:
            found = fit_sockets(chain, rows.joint_positions, sockets, (), frames_only=True)
            balls, _ = found.poses(rows.joint_positions)
            spreads[path] = sum(
                float(balls[sockets == socket].std(axis=0).sum()) for socket in np.unique(sockets)
            )
    return min(spreads, key=lambda path: spreads[path], default=None)
