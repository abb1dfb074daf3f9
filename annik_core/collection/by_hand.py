"""Joint positions of an arm that a person guides by hand, as rows of a file. Needs no ROS."""

import os
from collections import deque
from pathlib import Path

import numpy as np

from annik_core.errors import AnnikError, InvalidValue, listed
from annik_core.files import ensure_writable_folder, read_text
from annik_core.pose import FloatArray

#: A joint that has moved by less than this [rad or m] tells a calibration little.
LEAST_MOTION = 0.5


class ArmMoves(AnnikError):
    """An arm that is to be recorded moves: ``motion`` [rad or m] is that of the ``joint``."""

    def __init__(self, joint: str, motion: float, tolerance: float) -> None:
        self.joint = joint
        self.motion = motion
        super().__init__(
            f"not recorded: {joint} moved by {motion:.3g}, more than {tolerance:.3g}, just now; "
            "hold the arm still"
        )


class NotYetStill(AnnikError):
    """The joint positions have not been known for long enough to say that the arm is still."""


class HandGuided:
    """Records where a guided arm stands still, one row of joint positions a call.

    The file has the joint positions [rad or m], in the order of the names, without a header.
    Rows that are in it are kept and count.
    """

    def __init__(
        self, path: Path, joint_names: tuple[str, ...], still_tolerance: float, still_time: float
    ) -> None:
        """Continue the file, or begin it; ``still_tolerance`` [rad or m], ``still_time`` [s].

        Raises:
            InvalidValue: if the file has other columns than the joints, or can't be used.
        """
        self.path = path
        self._names = joint_names
        self._tolerance, self._time = still_tolerance, still_time
        self._latest: deque[tuple[float, FloatArray]] = deque()
        try:
            ensure_writable_folder(path.parent)
            lines = read_text(path).splitlines() if path.exists() else []
        except (OSError, ValueError) as error:
            raise InvalidValue("by_hand", str(path), f"a file to write ({error})") from error
        self.rows: list[FloatArray] = []
        for line in lines:
            try:
                row = np.array([float(number) for number in line.split(",")])
            except ValueError:
                row = np.zeros(0)
            if len(row) != len(joint_names):
                allowed = f"rows of {len(joint_names)} numbers, one a joint"
                raise InvalidValue(str(path), line[:80], allowed)
            self.rows.append(row)

    def update(self, now: float, joint_positions: FloatArray | None) -> None:
        """Take note of measured joint positions ``(dof,)`` at a time [s]; None: unknown."""
        if joint_positions is None:
            self._latest.clear()
            return
        self._latest.append((now, joint_positions))
        while len(self._latest) > 2 and self._latest[1][0] <= now - self._time:
            self._latest.popleft()

    def record(self) -> str:
        """Write the present joint positions; returns the progress in words.

        Raises:
            ArmMoves: if a joint moved within the last ``still_time``.
            NotYetStill: if the joint positions are not known for so long.
            OSError: if the file can't be written.
        """
        if not self._latest or self._latest[-1][0] - self._latest[0][0] < self._time:
            raise NotYetStill(
                f"not recorded: all joints must be measured for {self._time:g} s; try again, and "
                "look whether joint_states come"
            )
        moved = np.ptp([positions for _, positions in self._latest], axis=0)
        joint = int(moved.argmax())
        if moved[joint] > self._tolerance:
            raise ArmMoves(self._names[joint], float(moved[joint]), self._tolerance)
        row = self._latest[-1][1]
        with self.path.open("a", encoding="utf-8") as file:
            file.write(",".join(map(repr, row.tolist())) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.rows.append(row)
        return self.progress()

    @property
    def little_moved(self) -> list[str]:
        """The joints that have moved too little so far."""
        ranges = np.ptp(self.rows, axis=0) if self.rows else np.zeros(len(self._names))
        return [
            name for name, moved in zip(self._names, ranges, strict=True) if moved < LEAST_MOTION
        ]

    def progress(self) -> str:
        """How much is recorded, and which joints to move more."""
        missing = self.little_moved
        more = f"; move more: {listed(missing)}" if missing else "; all joints have moved"
        return f"{len(self.rows)} rows in {self.path}{more}"
