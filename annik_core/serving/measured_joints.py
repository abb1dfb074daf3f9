"""Measured joint positions, merged by name and time from the joint states of any publisher."""

import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np

from annik_core.errors import listed
from annik_core.pose import FloatArray


class JointStateFault(Enum):
    """Why a joint state, or a position in it, can't be used."""

    MALFORMED = "malformed"
    LENGTHS = "not one position per name"
    REPEATED = "joint named twice"
    NOT_FINITE = "position not finite"


class MeasuredPositions(NamedTuple):
    """The newest usable position of every joint [rad or m], and the earliest arrival [s]."""

    arrival: float
    joint_positions: FloatArray


class MeasuredJoints:
    """The newest usable position of each joint, however many other messages arrive.

    A position counts until ``timeout`` after its arrival. A message may hold some of the joints,
    and joints of other devices. What can't be used is counted, and changes nothing.

    Attributes:
        received: number of messages, usable or not.
        foreign: number of messages that name none of the joints.
    """

    def __init__(self, joint_names: Sequence[str], timeout: float) -> None:
        self.timeout = timeout
        self.received = 0
        self.foreign = 0
        self.faults = dict.fromkeys(JointStateFault, 0)
        self._joint_names = tuple(joint_names)
        self._index = {name: index for index, name in enumerate(self._joint_names)}
        self._positions = np.full(len(self._joint_names), math.nan)
        self._arrivals = [-math.inf] * len(self._joint_names)
        self._foreign_names: tuple[str, ...] = ()
        self._last_arrival = self._last_fault_arrival = -math.inf
        self._unknown_since: float | None = None
        self.last_fault = ""

    def update(
        self, arrival: float, names: Sequence[str], positions: Sequence[float]
    ) -> JointStateFault | None:
        """Take over the positions of one message, by name [rad or m]; returns what can't be used.

        A message without any position, such as one of velocities alone, is ignored.
        ``arrival``: on a monotonic clock [s].
        """
        fault = self._merge(arrival, names, positions)
        self._note_arrival(arrival)
        return fault

    def _merge(
        self, arrival: float, names: Sequence[str], positions: Sequence[float]
    ) -> JointStateFault | None:
        if not positions:
            return None
        own = [name for name in names if name in self._index]
        if not own:
            self.foreign += 1
            self._foreign_names = tuple(names)
            return None
        if len(names) != len(positions):
            counts = f"{len(names)} names but {len(positions)} positions"
            return self._at_fault(arrival, JointStateFault.LENGTHS, counts)
        if len(set(own)) != len(own):
            repeated = sorted({name for name in own if own.count(name) > 1})
            problem = f"{listed(repeated)} named twice"
            return self._at_fault(arrival, JointStateFault.REPEATED, problem)
        bad = []
        for name, position in zip(names, positions, strict=True):
            index = self._index.get(name)
            if index is None:
                continue
            if math.isfinite(position):
                self._positions[index] = position
                self._arrivals[index] = arrival
            else:
                bad.append(f"{name} at {position}")
        return self._at_fault(arrival, JointStateFault.NOT_FINITE, listed(bad)) if bad else None

    def malformed(self, arrival: float, problem: str) -> JointStateFault:
        """Count a message whose bytes are not those of a joint state."""
        fault = self._at_fault(arrival, JointStateFault.MALFORMED, problem)
        self._note_arrival(arrival)
        return fault

    def newest(self, now: float) -> MeasuredPositions | None:
        """The position of every joint; None if one is unknown or older than the timeout."""
        oldest = min(self._arrivals)
        if not now - oldest <= self.timeout:
            return None
        return MeasuredPositions(oldest, self._positions.copy())

    def missing(self, now: float) -> str | None:
        """Why :meth:`newest` is None although joint states arrive, as the end of a sentence.

        None if it is not None, or if no message of any kind arrived within the timeout.
        """
        if self.newest(now) is not None or now - self._last_arrival > self.timeout:
            return None
        fault = f"; last fault: {self.last_fault}" if self.last_fault else ""
        unknown = [
            name
            for name, arrival in zip(self._joint_names, self._arrivals, strict=True)
            if math.isinf(arrival)
        ]
        if unknown:
            foreign = ""
            if self._foreign_names:
                foreign = f" (others are named: {listed(self._foreign_names)}{self._prefix()})"
            return f"the joint states lack {listed(unknown)}{foreign}{fault}"
        oldest = min(self._arrivals)
        age, name = now - oldest, self._joint_names[self._arrivals.index(oldest)]
        return f"{name} was measured {age:.3g} s ago, more than {self.timeout:.3g} s{fault}"

    def stays_unknown(self, now: float) -> bool:
        """Whether messages without a fault came for longer than the timeout, and are not enough.

        Args:
            now: time [s, monotonic clock].
        """
        since = self._unknown_since
        if since is None or now - self._last_fault_arrival <= self.timeout:
            return False
        return now - since > self.timeout

    def _note_arrival(self, arrival: float) -> None:
        self.received += 1
        self._last_arrival = arrival
        if arrival - min(self._arrivals) <= self.timeout:
            self._unknown_since = None
        elif self._unknown_since is None:
            self._unknown_since = arrival

    def _at_fault(self, arrival: float, fault: JointStateFault, problem: str) -> JointStateFault:
        self.faults[fault] += 1
        self.last_fault, self._last_fault_arrival = problem, arrival
        return fault

    def _prefix(self) -> str:
        """A hint where other names are the joints' with a prefix."""
        for other in self._foreign_names:
            for name in self._joint_names:
                if other.endswith(name):
                    return f": with the prefix {other.removesuffix(name)!r}"
        return ""
