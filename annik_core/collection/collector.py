"""Collection of measured examples: the next command, and which measurements are kept. No ROS."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

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
from annik_core.errors import AnnikError
from annik_core.pose import FloatArray, pose_distance
from annik_core.safety import largest_step_beyond, measured_violation
from annik_core.serving.measured_joints import MeasuredPositions


class StopCause(Enum):
    """Why a collection stops."""

    OUTSIDE_LIMITS = "outside limits"
    SILENCE = "no joint states"
    JUMP = "jump of a measured joint"
    LAG = "robot does not follow"
    WRONG_PLACE = "robot is not at its command"
    FAILURES = "too many failed examples"


class CollectionStopped(AnnikError):
    """The robot or the set-up is at fault, so that no more commands are published."""

    def __init__(self, cause: StopCause, reason: str) -> None:
        self.cause = cause
        self.reason = reason
        super().__init__(
            f"stopped: {reason}; what was measured is kept, and the same command continues from "
            "there once the cause is removed"
        )


class CollectionIncomplete(AnnikError):
    """Some examples could not be measured: ``missing``, rows of the plan with the last reasons."""

    def __init__(self, missing: Mapping[int, str]) -> None:
        self.missing = dict(missing)
        first = "; ".join(f"row {row}: {reason}" for row, reason in sorted(missing.items())[:3])
        more = "; ..." if len(missing) > 3 else ""
        super().__init__(
            f"{len(missing)} examples could not be measured ({first}{more}): the same command "
            "visits them again, and keeps the others"
        )


class ExampleQueue:
    """Rows of a plan in their order; failed rows again after all others.

    ``missing`` rows failed, ``skipped`` rows can't be reached inside the limits, with the last
    reason for each; they may still be in the queue. ``failures`` counts failed attempts.
    """

    def __init__(self, rows: Sequence[int], max_retries: int, max_failures_in_a_row: int) -> None:
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
        """Remove and return the next row; None if there is none."""
        if not self._now and self._later and self._retries_left > 0:
            self._now.extend(self._later)
            self._later.clear()
            self._retries_left -= 1
            self._first_round = False
        return self._now.popleft() if self._now else None

    def record_done(self, row: int) -> None:
        """Record that a removed row is measured."""
        self.missing.pop(row, None)
        self.skipped.pop(row, None)
        self._in_a_row = 0

    def record_failed(self, row: int, reason: str) -> None:
        """Record that a removed row could not be measured this time.

        Raises:
            CollectionStopped: if too many failed in a row; not for rows that failed before.
        """
        self.failures += 1
        self.skipped.pop(row, None)
        self.missing[row] = reason
        self._later.append(row)
        self._in_a_row += 1
        if self._first_round and self._in_a_row >= self._max_in_a_row:
            raise CollectionStopped(
                StopCause.FAILURES,
                f"{self._in_a_row} examples failed in a row, the last because {reason}",
            )

    def record_skipped(self, row: int, reason: str, *, for_good: bool) -> None:
        """Record that a removed row can't be reached: at all, or from here."""
        self.missing.pop(row, None)
        self.skipped[row] = reason
        if not for_good:
            self._later.append(row)


#: A late command advances the motion by at most this many command periods, to avoid a jump.
_LONGEST_STEP = 2.0
#: A motion has its full speed up to a lag of the first fraction of max_measured_step, and stands
#: still from the second one on.
_FULL_PACE, _NO_PACE = 0.5, 0.9


class Log(Protocol):
    """Receives progress messages, such as the logger of a node."""

    def info(self, message: str, /) -> object:
        """Log progress."""
        ...

    def warning(self, message: str, /) -> object:
        """Log a fault."""
        ...


class Phase(Enum):
    """The present activity of a collector."""

    WAITING = "waiting for the robot"
    MOVING = "moving"
    SETTLING = "waiting until the robot stands still"
    MEASURING = "measuring"
    DONE = "done"


@dataclass
class _Visit:
    """The visit to an example: ``joint_positions`` and ``samples`` are measured together.

    Continuous joints of ``target`` are full turns from the plan's. Times [s]: in the motion up to
    the last command, delay by the lag of the robot, and end of the phase.
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
    """Moves to each example, waits until the robot stands still, and measures.

    Times are those of one monotonic clock [s]. ``repeated`` counts the refused measurements.
    """

    def __init__(self, journal: CollectionJournal, settings: CollectionSettings, log: Log) -> None:
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
        self._measured: MeasuredPositions | None = None
        self._silence = 0.0
        self._visit: _Visit | None = None
        self._command = self._robot.joint_box.centre

    @property
    def command(self) -> FloatArray:
        """The last command ``(dof,)`` [rad or m]; before the first one, the measured positions."""
        return self._command

    def begin(self, now: float, measured: MeasuredPositions) -> None:
        """Begin at the measured joint positions.

        The first time, the order of the examples is chosen and written to the journal.

        Raises:
            CollectionStopped: if the robot is outside its limits or the workspace box.
            NotWritable: if the journal can't be written.
        """
        limits = self._robot.joint_limits
        # A robot at its limit may be measured slightly beyond it; a command may not be.
        start = np.clip(measured.joint_positions, limits.lower, limits.upper)
        if np.abs(start - measured.joint_positions).max() > self._settings.settle_tolerance:
            start = measured.joint_positions
        violation = place_violation(self._robot, self._settings.command_safety, start)
        if violation is not None:
            raise CollectionStopped(
                StopCause.OUTSIDE_LIMITS,
                f"the robot is where no command is allowed ({violation}): move it away from there",
            )
        self._command = start
        if self.journal.order is None:
            order = visiting_order(start, self.journal.plan.joint_positions, self._robot.turning)
            self.journal.begin(order, self._settings)
        self.queue = ExampleQueue(
            self.journal.remaining,
            self._settings.max_retries,
            self._settings.max_failures_in_a_row,
        )
        self._begun = self._last_tick = now
        self._measured = measured
        self._go_to_next(now)

    def tick(
        self, now: float, measured: MeasuredPositions | None, fault: str | None = None
    ) -> FloatArray:
        """The next command: joint positions ``(dof,)`` [rad or m], the last one to stand still.

        To be called at the command rate with the newest joint positions. If there are none
        although messages arrive, ``fault`` says why, as the end of a sentence.

        Raises:
            CollectionStopped: if joint states are missing, jump, or are far from the command; or
                if too many examples fail in a row.
            NotWritable: if the journal can't be written.
        """
        self._count_silence(now)
        if measured is not None:
            self._watch(measured)
        self._check_silence(fault)
        if self._visit is not None:
            self._advance(self._visit, now)
        self._last_tick = now
        return self._command

    def on_pose(self, now: float, pose: FloatArray) -> None:
        """Add a measured pose ``(7,)``, checked and in the base frame; ignored while moving.

        Its errors are those of :meth:`tick`.
        """
        visit = self._visit
        if visit is None or self.phase is not Phase.MEASURING:
            return
        visit.samples.append(pose)
        if len(visit.samples) == self._settings.samples:
            self._judge(visit, now)

    def time_left(self, now: float) -> float | None:
        """Time left at the mean rate so far [s]; None before the first example."""
        done = len(self.journal.examples) - self._done_before
        if done == 0:
            return None
        remaining = len(self.journal.plan) - len(self.journal.examples)
        return (now - self._begun) / done * remaining

    def _watch(self, measured: MeasuredPositions) -> None:
        """Check measured joint positions against the previous ones and against the command."""
        before, positions = self._measured, measured.joint_positions
        self._measured = measured
        if before is None or measured.arrival != before.arrival:
            self._silence = 0.0
        # Joints in other messages than the oldest may have moved.
        elif np.array_equal(positions, before.joint_positions):
            return
        robot, limit = self._robot, self._settings.max_measured_step
        if before is not None:
            jump = largest_step_beyond(limit, robot, positions, before.joint_positions)
            if jump is not None:
                joint = jump[0]
                raise CollectionStopped(
                    StopCause.JUMP,
                    f"{robot.joint_names[joint]} was measured at "
                    f"{before.joint_positions[joint]:.6g} and then at {positions[joint]:.6g}: a "
                    f"jump by more than the max_measured_step of {limit:.6g}",
                )
        violation = measured_violation(robot, self._command, positions, limit)
        if violation is not None:
            raise CollectionStopped(
                StopCause.WRONG_PLACE,
                f"the robot is not where it was commanded to be: {violation}, the "
                "max_measured_step",
            )
        visit = self._visit
        if visit is None or self.phase not in (Phase.SETTLING, Phase.MEASURING):
            return
        visit.settling.update(measured.arrival, robot.unwrapped(positions, visit.target))
        if self.phase is Phase.MEASURING:
            visit.joint_positions.append(positions)

    def _count_silence(self, now: float) -> None:
        # Delays of this process, as by a slow disk, are not silence of the robot.
        settings = self._settings
        longest = max(_LONGEST_STEP / settings.command_rate, 0.25 * settings.measurement_timeout)
        self._silence += min(now - self._last_tick, longest)

    def _check_silence(self, fault: str | None) -> None:
        timeout = self._settings.measurement_timeout
        if self._visit is not None and self._silence > timeout:
            raise CollectionStopped(
                StopCause.SILENCE,
                f"no joint states for {self._silence:.3g} s, more than the measurement_timeout "
                f"of {timeout:.3g} s" + (f": {fault}" if fault else ""),
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
                StopCause.LAG,
                "the robot does not follow its commands: it lagged behind by half of the "
                f"max_measured_step of {self._settings.max_measured_step:.6g} or more, and did "
                f"not catch up within the settle_timeout of {self._settings.settle_timeout:.4g} s",
            )
        command = visit.motion.joint_positions_at(visit.motion_time)
        violation = place_violation(self._robot, self._settings.command_safety, command)
        if violation is not None:
            # The path was checked at points; this checks the command itself.
            raise CollectionStopped(
                StopCause.OUTSIDE_LIMITS, f"a command is not allowed: {violation}"
            )
        self._command = command
        if visit.motion_time >= visit.motion.duration:
            self.phase = Phase.SETTLING
            visit.deadline = now + self._settings.settle_timeout

    def _pace(self) -> float:
        """The fraction of its speed at the present lag; 0 shortly before max_measured_step."""
        if self._measured is None:
            return 0.0
        lag = float(
            np.abs(self._robot.difference(self._command, self._measured.joint_positions)).max()
        )
        share = lag / self._settings.max_measured_step
        return min(max((_NO_PACE - share) / (_NO_PACE - _FULL_PACE), 0.0), 1.0)

    def _measure(self, visit: _Visit, now: float) -> None:
        self.phase = Phase.MEASURING
        visit.deadline = now + self._settings.pose_timeout
        visit.samples = []
        visit.joint_positions = []

    def _judge(self, visit: _Visit, now: float) -> None:
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
                visit.row,
                average.pose,
                average.square_sums,
                np.mean(self._robot.unwrapped(np.array(measured), plan), axis=0),
            )
        )
        self.queue.record_done(visit.row)
        self._log.info(self._progress(visit.row, average, nominal, now))
        self._go_to_next(now)

    def _refuse(self, visit: _Visit, now: float, reason: str) -> None:
        """Repeat a measurement, unless it was repeated max_repeats times."""
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
        measured = self._robot.unwrapped(self._measured.joint_positions, visit.target)
        where = visit.settling.describe(self._robot.joint_names, measured)
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
        """The visit to a row, or None if it can't be reached."""
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
        target = way.waypoints[-1]
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
    """A duration [s] in words, such as ``2 min 5 s``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
