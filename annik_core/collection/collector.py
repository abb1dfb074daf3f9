"""Collection of measured examples: what to command next, and which measurements to keep.

Which example is next, and what became of those that failed.

Drive a robot through the examples of a plan and measure where each leads. Needs no ROS.

The collector is told what was measured and when, and says what to command next; it knows no clock
and sends no message.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

import numpy as np

from annik_core.collection.errors import CollectionStopped
from annik_core.collection.journal import CollectionJournal, MeasuredExample
from annik_core.collection.measurement import (
    PoseAverage,
    Settling,
    average_poses,
    measurement_fault,
)
from annik_core.collection.motion import JointMotion, approach, place_violation
from annik_core.collection.settings import CollectionSettings
from annik_core.collection.visiting_order import visiting_order
from annik_core.pose import FloatArray, pose_distance
from annik_core.safety import measured_violation


class ExampleQueue:
    """Rows of a plan in their order; those that failed once more after all others.

    Attributes:
        missing: rows that failed, with the last reason; they may be in the queue still.
        skipped: rows that the robot is not allowed to go to, with the reason; likewise.
        failures: how often an attempt has failed.
    """

    def __init__(self, rows: Sequence[int], max_retries: int, max_failures_in_a_row: int) -> None:
        """Queue up rows; see :class:`annik_core.collection.settings.CollectionSettings`."""
        self.missing: dict[int, str] = {}
        self.skipped: dict[int, str] = {}
        self.failures = 0
        self._now = deque(rows)
        self._later: list[int] = []
        self._retries_left = max_retries
        self._first_round = True
        self._in_a_row = 0
        self._max_in_a_row = max_failures_in_a_row

    def next_row(self) -> int | None:
        """Take the next row out; None if there is none."""
        if not self._now and self._later and self._retries_left > 0:
            self._now.extend(self._later)
            self._later.clear()
            self._retries_left -= 1
            self._first_round = False
        return self._now.popleft() if self._now else None

    def record_done(self, row: int) -> None:
        """A row that was taken out is measured."""
        self.missing.pop(row, None)
        self.skipped.pop(row, None)
        self._in_a_row = 0

    def record_failed(self, row: int, reason: str) -> None:
        """A row that was taken out could not be measured this time.

        Raises:
            CollectionStopped: if it is the last of too many in a row. What is in the queue for a
                second time failed before, so then that says nothing new.
        """
        self.failures += 1
        self.skipped.pop(row, None)
        self.missing[row] = reason
        self._later.append(row)
        self._in_a_row += 1
        if self._first_round and self._in_a_row >= self._max_in_a_row:
            raise CollectionStopped(
                f"{self._in_a_row} examples failed in a row, the last because {reason}"
            )

    def record_skipped(self, row: int, reason: str, *, for_good: bool) -> None:
        """A row that was taken out can't be gone to: from anywhere, or from here."""
        self.missing.pop(row, None)
        self.skipped[row] = reason
        if not for_good:
            self._later.append(row)


#: A command that comes late takes the motion no further than this many command periods: the
#: next one would be a jump.
_LONGEST_STEP = 2.0
#: A motion has its full speed while the robot lags behind by no more than this part of
#: max_measured_step, and stands still from the other part on.
_FULL_PACE, _NO_PACE = 0.5, 0.9


class MeasuredJoints(NamedTuple):
    """Joint positions and when they arrived.

    Attributes:
        time: on the clock of whoever calls the collector [s].
        joint_positions: ``(dof,)`` [rad or m].
    """

    time: float
    joint_positions: FloatArray


class Log(Protocol):
    """Who is told of the progress, such as a node's logger."""

    def info(self, message: str, /) -> object:
        """What goes as it should."""
        ...

    def warning(self, message: str, /) -> object:
        """What does not."""
        ...


class Phase(Enum):
    """What a collector is doing."""

    WAITING = "waiting for the robot"
    MOVING = "moving"
    SETTLING = "waiting until the robot stands still"
    MEASURING = "measuring"
    DONE = "done"


@dataclass
class _Visit:
    """The visit to one example.

    Attributes:
        row: of the plan.
        target: ``(dof,)`` [rad or m].
        motion: the way there.
        motion_time: how much of it was commanded [s].
        held_back: how long it took more, since the robot lagged behind [s].
        settling: whether the robot stands still there.
        deadline: of the phase [s].
        samples: measured poses ``(7,)``.
        joint_positions: what was measured along with them.
        repeats: how many measurements were refused.
    """

    row: int
    target: FloatArray
    motion: JointMotion
    motion_time: float
    settling: Settling
    deadline: float
    samples: list[FloatArray]
    joint_positions: list[FloatArray]
    held_back: float = 0.0
    repeats: int = 0


class Collector:
    """Goes to one example after the other, waits until the robot stands still, and measures.

    Times are those of one clock that never goes back [s].

    Attributes:
        phase: what it is doing.
        journal: what was measured.
        queue: what remains, and what failed.
        repeated: how many measurements were refused and made again.
    """

    def __init__(self, journal: CollectionJournal, settings: CollectionSettings, log: Log) -> None:
        """Prepare to go on where the journal ends; nothing is commanded before :meth:`begin`."""
        self.journal = journal
        self.phase = Phase.WAITING
        self.repeated = 0
        self.queue = ExampleQueue((), 0, 1)
        self._robot = journal.plan.robot
        self._settings = settings
        self._log = log
        self._begun = 0.0
        self._done_before = len(journal.examples)
        self._last_tick = 0.0
        self._measured: MeasuredJoints | None = None
        self._silence = 0.0
        self._visit: _Visit | None = None
        self._command = self._robot.joint_box.centre

    @property
    def command(self) -> FloatArray:
        """The last command ``(dof,)`` [rad or m]; before the first one, where the robot was."""
        return self._command

    def begin(self, now: float, measured: MeasuredJoints) -> None:
        """Begin at the joint positions where the robot is.

        The first time, the order of the examples is chosen and written down.

        Raises:
            CollectionStopped: if the robot is outside its limits or the workspace box.
            NotWritable: if the order can't be written down.
        """
        limits = self._robot.joint_limits
        # A robot at its limit may be measured a little beyond; a command may not.
        start = np.clip(measured.joint_positions, limits.lower, limits.upper)
        if np.abs(start - measured.joint_positions).max() > self._settings.settle_tolerance:
            start = measured.joint_positions
        violation = place_violation(self._robot, self._settings.command_safety, start)
        if violation is not None:
            raise CollectionStopped(
                f"the robot is where no command may take it ({violation}): move it from there"
            )
        self._command = start
        if self.journal.order is None:
            order = visiting_order(start, self.journal.plan.joint_positions)
            self.journal.begin(order, self._settings)
        self.queue = ExampleQueue(
            self.journal.remaining,
            self._settings.max_retries,
            self._settings.max_failures_in_a_row,
        )
        self._begun = self._last_tick = now
        self._measured = measured
        self._go_to_next(now)

    def tick(self, now: float, measured: MeasuredJoints | None) -> FloatArray:
        """What to command now: joint positions ``(dof,)`` [rad or m].

        To be called at the command rate, from the beginning to the end. The last command is
        repeated while the robot is to stand still.

        Args:
            now: the time.
            measured: the newest joint positions, if there are any.

        Raises:
            CollectionStopped: if the robot is silent, jumps, or is not where it was commanded to
                be; or if too many examples fail in a row.
            NotWritable: if an example can't be written down.
        """
        self._count_silence(now)
        if measured is not None:
            self._watch(measured)
        self._check_silence()
        if self._visit is not None:
            self._advance(self._visit, now)
        self._last_tick = now
        return self._command

    def on_pose(self, now: float, pose: FloatArray) -> None:
        """Take a measured pose ``(7,)``, checked and in the base frame; while moving, in vain.

        Raises:
            CollectionStopped: if too many examples fail in a row.
            NotWritable: if an example can't be written down.
        """
        visit = self._visit
        if visit is None or self.phase is not Phase.MEASURING:
            return
        visit.samples.append(pose)
        if len(visit.samples) == self._settings.samples:
            self._judge(visit, now)

    def time_left(self, now: float) -> float | None:
        """How long it will take at the pace so far [s]; None before the first example."""
        done = len(self.journal.examples) - self._done_before
        if done == 0:
            return None
        remaining = len(self.journal.plan) - len(self.journal.examples)
        return (now - self._begun) / done * remaining

    def _watch(self, measured: MeasuredJoints) -> None:
        """Hold what is measured to what was measured before, and to the command."""
        before = self._measured
        if before is not None and measured.time == before.time:
            return
        self._measured = measured
        self._silence = 0.0
        names, limit = self._robot.joint_names, self._settings.max_measured_step
        positions = measured.joint_positions
        if before is not None:
            steps = np.abs(positions - before.joint_positions)
            if not (steps <= limit).all():
                joint = int(steps.argmax())
                raise CollectionStopped(
                    f"{names[joint]} was measured at {before.joint_positions[joint]:.6g} and then "
                    f"at {positions[joint]:.6g}: a jump by more than the max_measured_step of "
                    f"{limit:.6g}"
                )
        violation = measured_violation(names, self._command, positions, limit)
        if violation is not None:
            raise CollectionStopped(
                f"the robot is not where it was commanded to be: {violation}, the "
                "max_measured_step"
            )
        visit = self._visit
        if visit is None or self.phase not in (Phase.SETTLING, Phase.MEASURING):
            return
        visit.settling.update(measured.time, positions)
        if self.phase is Phase.MEASURING:
            visit.joint_positions.append(positions)

    def _count_silence(self, now: float) -> None:
        # While this process itself was held up, as by a slow disk, nobody was heard and nothing
        # was commanded.
        settings = self._settings
        longest = max(_LONGEST_STEP / settings.command_rate, 0.25 * settings.measurement_timeout)
        self._silence += min(now - self._last_tick, longest)

    def _check_silence(self) -> None:
        timeout = self._settings.measurement_timeout
        if self._visit is not None and self._silence > timeout:
            raise CollectionStopped(
                f"no joint states for {self._silence:.3g} s, more than the measurement_timeout "
                f"of {timeout:.3g} s"
            )

    def _advance(self, visit: _Visit, now: float) -> None:
        if self.phase is Phase.MOVING:
            self._move(visit, now)
        elif self.phase is Phase.SETTLING:
            if visit.settling.is_settled:
                self._measure(visit, now)
            elif now > visit.deadline:
                self._fail(visit, now, self._not_settled(visit))
        elif self.phase is Phase.MEASURING:
            if not visit.settling.is_settled:
                self._refuse(visit, now, "the robot moved while it was measured")
            elif now > visit.deadline:
                self._refuse(
                    visit,
                    now,
                    f"{len(visit.samples)} of {self._settings.samples} measured poses came within "
                    f"the pose_timeout of {self._settings.pose_timeout:.4g} s",
                )

    def _move(self, visit: _Visit, now: float) -> None:
        period = 1.0 / self._settings.command_rate
        elapsed = min(now - self._last_tick, _LONGEST_STEP * period)
        share = self._pace()
        visit.motion_time += share * elapsed
        visit.held_back += (1.0 - share) * elapsed
        if visit.held_back > self._settings.settle_timeout:
            raise CollectionStopped(
                "the robot does not follow its commands: it lagged behind by half of the "
                f"max_measured_step of {self._settings.max_measured_step:.6g} or more, and did "
                f"not catch up within the settle_timeout of {self._settings.settle_timeout:.4g} s"
            )
        command = visit.motion.joint_positions_at(visit.motion_time)
        violation = place_violation(self._robot, self._settings.command_safety, command)
        if violation is not None:
            # The way was looked at before; this is what makes it certain.
            raise CollectionStopped(f"a command would leave what is allowed: {violation}")
        self._command = command
        if visit.motion_time >= visit.motion.duration:
            self.phase = Phase.SETTLING
            visit.deadline = now + self._settings.settle_timeout

    def _pace(self) -> float:
        """Which part of its speed a motion has: less if the robot, or what it says, is late.

        Less and less on the way to the limit of the distance, and nothing shortly before it: that
        is exceeded by what the robot does, not by what it is commanded.
        """
        if self._measured is None:
            return 0.0
        lag = float(np.abs(self._command - self._measured.joint_positions).max())
        share = lag / self._settings.max_measured_step
        return min(max((_NO_PACE - share) / (_NO_PACE - _FULL_PACE), 0.0), 1.0)

    def _measure(self, visit: _Visit, now: float) -> None:
        """Begin to measure."""
        self.phase = Phase.MEASURING
        visit.deadline = now + self._settings.pose_timeout
        visit.samples = []
        visit.joint_positions = []

    def _judge(self, visit: _Visit, now: float) -> None:
        """Believe what was measured, or not."""
        average = average_poses(visit.samples)
        plan = self.journal.plan.joint_positions[visit.row]
        nominal = self._robot.forward_kinematics.poses(plan[np.newaxis])[0]
        fault = measurement_fault(average, nominal, self._settings)
        if fault is not None:
            self._refuse(visit, now, fault)
            return
        measured = visit.joint_positions
        if not measured and self._measured is not None:
            measured = [self._measured.joint_positions]
        self.journal.record(
            MeasuredExample(
                visit.row, average.pose, average.square_sums, np.mean(measured, axis=0)
            )
        )
        self.queue.record_done(visit.row)
        self._log.info(self._progress(visit.row, average, nominal, now))
        self._go_to_next(now)

    def _refuse(self, visit: _Visit, now: float, reason: str) -> None:
        """Measure again, if that was not done often enough."""
        if visit.repeats >= self._settings.max_repeats:
            self._fail(visit, now, reason)
            return
        visit.repeats += 1
        self.repeated += 1
        self._log.warning(f"row {visit.row} is measured again: {reason}")
        if visit.settling.is_settled:
            self._measure(visit, now)
        else:
            self.phase = Phase.SETTLING
            visit.deadline = now + self._settings.settle_timeout

    def _fail(self, visit: _Visit, now: float, reason: str) -> None:
        self._log.warning(f"row {visit.row} failed: {reason}")
        self._visit = None
        self.queue.record_failed(visit.row, reason)
        self._go_to_next(now)

    def _not_settled(self, visit: _Visit) -> str:
        timeout = self._settings.settle_timeout
        if self._measured is None:
            return f"nothing was measured within {timeout:.4g} s"
        where = visit.settling.describe(self._robot.joint_names, self._measured.joint_positions)
        return (
            f"the robot did not come to rest within the settle_timeout of {timeout:.4g} s: {where}"
        )

    def _go_to_next(self, now: float) -> None:
        self._visit = None
        while (row := self.queue.next_row()) is not None:
            visit = self._visit_of(row)
            if visit is not None:
                self._visit = visit
                self.phase = Phase.MOVING
                return
        self.phase = Phase.DONE

    def _visit_of(self, row: int) -> _Visit | None:
        """The visit to a row, or None if the robot is not allowed to go there."""
        settings = self._settings
        safety = settings.command_safety
        target = self.journal.plan.joint_positions[row]
        there = place_violation(self._robot, safety, target)
        way = approach(self._robot, safety, self._command, target, settings.spacing)
        if way.waypoints is None:
            reason = there or way.violation or ""
            self.queue.record_skipped(row, reason, for_good=there is not None)
            self._log.warning(f"row {row} is skipped: {reason}")
            return None
        motion = JointMotion(
            way.waypoints, settings.max_joint_velocity, settings.max_joint_acceleration
        )
        settling = Settling(
            target, settings.settle_tolerance, settings.still_tolerance, settings.settle_time
        )
        return _Visit(row, target, motion, 0.0, settling, 0.0, [], [])

    def _progress(self, row: int, average: PoseAverage, nominal: FloatArray, now: float) -> str:
        distance, angle = pose_distance(nominal, average.pose)
        left = self.time_left(now)
        return (
            f"{len(self.journal.examples)} of {len(self.journal.plan)} examples: row {row} is "
            f"{1e3 * distance:.4g} mm and {angle:.4g} rad from nominal; "
            f"{duration_in_words(left or 0.0)} left; {self.repeated} measurements repeated, "
            f"{self.queue.failures} failed, {len(self.queue.skipped)} skipped"
        )


def duration_in_words(seconds: float) -> str:
    """A duration [s] as a person would say it, such as ``2 min 5 s``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
