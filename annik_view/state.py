"""What is shown of a robot, without a browser: target, answer, other solutions, trails."""

import math
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from annik_core.pose import FloatArray, pose_distance
from annik_core.reachable_paths import start_positions
from annik_core.robots.description import link_poses
from annik_core.robots.robot import Robot
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.result import IkResult
from annik_view.meshes import LinkMesh
from annik_view.skeleton import Posture, Skeleton
from annik_view.solvers import nominal_of

#: Points of a trail, the oldest are dropped.
TRAIL = 600
#: Two positions of a trail are at least this far apart, as a share of the reach.
_TRAIL_STEP = 1e-3
#: Most solutions that are shown at once.
MOST_SOLUTIONS = 16
#: Points of a path, and its size as a share of the reach.
PATH_POINTS, _PATH_SIZE = 120, 0.1
_TURN = np.linspace(0.0, 2.0 * np.pi, PATH_POINTS)
#: The paths that can be played: displacements of the target, there and back, as shares of a size.
PATHS = {
    "circle": np.column_stack([np.cos(_TURN) - 1.0, np.sin(_TURN), 0.0 * _TURN]),
    "eight": np.column_stack([0.0 * _TURN, np.sin(2.0 * _TURN), np.sin(_TURN)]),
    "line": np.column_stack([0.0 * _TURN, 0.0 * _TURN, np.sin(_TURN)]),
}
#: The difference of a calibrated arm is magnified to this share of its reach.
_SEEN = 0.05


class Following(NamedTuple):
    """What a ROS 2 graph says of the robot. Errors: [m], [rad]; NaN until known."""

    position_error: float = math.nan
    orientation_error: float = math.nan


_UNKNOWN = Following()


@dataclass(eq=False)
class Examples:
    """The examples of a design, or of a plan that is being measured.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m].
        positions: ``(n, 3)`` of the end effector there [m].
        measured: the rows that are measured.
    """

    joint_positions: FloatArray
    positions: FloatArray
    measured: frozenset[int] = frozenset()

    def __len__(self) -> int:
        return len(self.joint_positions)


@dataclass(eq=False)
class ViewState:
    """A robot, its target and the answer; each change of the target is solved at once.

    Attributes:
        follows: the robot moves by itself, as :meth:`measured` says: an answer does not move it.
        joint_positions: ``(dof,)`` where the robot is shown [rad or m].
        target: ``(7,)`` the target pose in the base frame.
        answer: the last answer; None until there is one.
        solve_time: how long it took [s].
        solutions: all solutions of the target, if they were asked for; nearest first.
        target_trail, achieved_trail: positions ``(3,)`` [m], oldest first.
        path: targets ``(n, 7)`` that are being played, and ``path_index``, the next of them.
        examples: examples that are shown where they put the end effector; None: no design.
        meshes: what the links look like, in place of tubes; empty: unknown.
    """

    solver: IkSolver
    follows: bool = False
    joint_positions: FloatArray = field(init=False)
    target: FloatArray = field(init=False)
    answer: IkResult | None = None
    solve_time: float = math.nan
    solutions: list[IkResult] = field(default_factory=list)
    target_trail: deque[FloatArray] = field(default_factory=lambda: deque(maxlen=TRAIL))
    achieved_trail: deque[FloatArray] = field(default_factory=lambda: deque(maxlen=TRAIL))
    path: FloatArray = field(default_factory=lambda: np.empty((0, 7)))
    path_index: int = 0
    following: Following = _UNKNOWN
    examples: Examples | None = None
    meshes: Sequence[LinkMesh] = ()

    def __post_init__(self) -> None:
        """Put the robot where it is seen well, and the target at its end effector."""
        self.show_joints(self._start())
        self.move_target(self.target)

    @property
    def robot(self) -> Robot:
        """The robot that is shown."""
        return self.solver.robot

    @cached_property
    def skeleton(self) -> Skeleton:
        """The links of the robot."""
        return Skeleton(self.robot)

    @cached_property
    def nominal(self) -> Skeleton | None:
        """The links of a calibrated robot as it was described before; None if not calibrated."""
        nominal = nominal_of(self.robot)
        return None if nominal is None else Skeleton(nominal)

    @property
    def refused(self) -> bool:
        """Whether the last answer is a refusal."""
        return self.answer is not None and not self.answer.accepted

    @property
    def achieved(self) -> FloatArray:
        """End-effector pose ``(7,)`` at the shown joint positions."""
        return self._pose(self.joint_positions)

    def move_target(self, pose: ArrayLike) -> IkResult:
        """Solve a target pose ``(7,)`` on the branch of the shown joint positions.

        If the answer is accepted, the robot is shown there, unless it follows its own state.
        """
        self.target = np.array(pose, dtype=np.float64)
        self.solutions = []
        started = time.perf_counter()
        answer = self.solver.solve(self.target, self.joint_positions)
        self.solve_time = time.perf_counter() - started
        self.answer = answer
        self._extend(self.target_trail, self.target[:3])
        if answer.joint_positions is not None and not self.follows:
            self._move(answer.joint_positions)
        return answer

    def find_solutions(self) -> None:
        """Find all solutions of the target, nearest to the shown joint positions first."""
        found = self.solver.solutions(self.target, self.joint_positions)
        self.solutions = found[:MOST_SOLUTIONS]

    def choose(self, index: int) -> None:
        """Show the robot at one of :attr:`solutions`: the target is then solved on its branch."""
        chosen = self.solutions[index]
        assert chosen.joint_positions is not None
        self.answer = chosen
        if not self.follows:
            self._move(chosen.joint_positions)

    def show_joints(self, joint_positions: ArrayLike) -> None:
        """Show the robot at joint positions ``(dof,)`` [rad or m], the target at its end."""
        self._move(np.array(joint_positions, dtype=np.float64))
        self.target = self.achieved
        self.answer, self.solutions, self.solve_time = None, [], math.nan

    def show_example(self, row: int) -> None:
        """Show the robot at the joint positions of an example."""
        assert self.examples is not None
        self.show_joints(self.examples.joint_positions[row])

    def start_path(self, name: str) -> None:
        """Choose one of :data:`PATHS` from the target on, to be played by :meth:`next_target`."""
        moved = self.target[:3] + _PATH_SIZE * self.skeleton.reach * PATHS[name]
        self.path = np.column_stack([moved, np.tile(self.target[3:], (len(moved), 1))])
        self.path_index = 0

    def stop_path(self) -> None:
        """Play no further."""
        self.path_index = len(self.path)

    def next_target(self) -> FloatArray | None:
        """The next target of the path; None if it is at its end."""
        if self.path_index >= len(self.path):
            return None
        self.path_index += 1
        pose: FloatArray = self.path[self.path_index - 1]
        return pose

    def clear_trails(self) -> None:
        """Forget where target and end effector have been."""
        self.target_trail.clear()
        self.achieved_trail.clear()

    def measured(self, joint_positions: FloatArray) -> None:
        """The robot says where it is: ``(dof,)`` [rad or m]."""
        self._move(joint_positions)

    def accepted(self, pose: FloatArray) -> None:
        """A target ``(7,)`` was accepted by the node that commands the robot."""
        self._extend(self.target_trail, pose[:3])

    def achieved_at(self, pose: FloatArray) -> None:
        """The end effector was measured at a pose ``(7,)``."""
        self._extend(self.achieved_trail, pose[:3])

    def posture(self) -> Posture:
        """Links and joints of the robot as shown."""
        return self.skeleton.posture(self.joint_positions)

    def mesh_poses(self) -> list[list[float] | None]:
        """The pose ``(7,)`` of each of :attr:`meshes`; None: its link is not one of the arm's."""
        if not self.meshes:
            return []
        poses = link_poses(self.robot, self.joint_positions)
        poses[self.robot.base_frame] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        return [poses.get(mesh.link) for mesh in self.meshes]

    def magnified_nominal(self, magnification: float) -> Posture | None:
        """The nominal arm at the same joint positions, its difference magnified."""
        if self.nominal is None:
            return None
        calibrated, nominal = self.posture(), self.nominal.posture(self.joint_positions)
        away = magnification * (nominal.points - calibrated.points)
        return Posture(calibrated.points + away, nominal.axes)

    @cached_property
    def suited_magnification(self) -> float:
        """A magnification by which the difference is seen: 1, 2, 5, 10, ...; at most 1000."""
        difference = self.difference
        if not difference:
            return 1.0
        wanted = math.log10(max(_SEEN * self.skeleton.reach / difference, 1.0))
        digits = [1.0, 2.0, 5.0][int(3.0 * (wanted % 1.0))]
        return min(digits * 10.0 ** math.floor(wanted), 1000.0)

    @property
    def difference(self) -> float:
        """Distance of the end effector from the nominal arm's [m]; zero if not calibrated."""
        if self.nominal is None:
            return 0.0
        nominal = self.nominal.robot.forward_kinematics.poses(self.joint_positions[np.newaxis])
        return float(pose_distance(nominal, self.achieved[np.newaxis])[0][0])

    def readout(self) -> list[tuple[str, str]]:
        """What the page says in words: a name and a value each."""
        answer = self.answer
        rows = [("target", f"{_numbers(self.target[:3])} m")]
        if answer is not None and answer.accepted:
            rows += [
                ("answer", "accepted"),
                ("position residual", f"{1e6 * answer.position_residual:.3g} um"),
                ("orientation residual", f"{1e6 * answer.orientation_residual:.3g} urad"),
            ]
        elif answer is not None:
            rows += [("answer", f"refused: {answer.status.value}"), ("reason", answer.reason)]
        if math.isfinite(self.solve_time):
            rows.append(("solve time", f"{1e6 * self.solve_time:.0f} us"))
        if answer is not None and math.isfinite(answer.expected_position_error):
            expected = f"{1e3 * answer.expected_position_error:.3g} mm"
            rows.append(("expected error (95 %)", expected))
        if self.solutions:
            rows.append(("solutions", f"{len(self.solutions)}"))
        if math.isfinite(self.following.position_error):
            degrees = math.degrees(self.following.orientation_error)
            error = f"{1e3 * self.following.position_error:.3g} mm, {degrees:.3g} degrees"
            rows.append(("tracking error", error))
        if self.examples is not None:
            measured = f", {len(self.examples.measured)} measured" if self.follows else ""
            rows.append(("examples", f"{len(self.examples)}{measured}"))
        if self.nominal is not None:
            rows.append(("nominal arm away by", f"{1e3 * self.difference:.3g} mm"))
        return rows

    def _start(self) -> FloatArray:
        """Of an arm, joint positions off singularities; of the gantry, where its paths start."""
        start = start_positions(self.robot)
        if self.robot.kind != "arm":
            return start
        box = self.robot.joint_box
        return np.clip(start + 0.1 * (box.upper - box.lower), box.lower, box.upper)

    def _pose(self, joint_positions: FloatArray) -> FloatArray:
        pose: FloatArray = self.robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]
        return pose

    def _move(self, joint_positions: FloatArray) -> None:
        self.joint_positions = joint_positions
        if not self.follows:
            self._extend(self.achieved_trail, self.achieved[:3])

    def _extend(self, trail: deque[FloatArray], position: FloatArray) -> None:
        if not np.isfinite(position).all():
            return
        if not trail or math.dist(trail[-1], position) >= _TRAIL_STEP * self.skeleton.reach:
            trail.append(position.copy())


def _numbers(values: FloatArray) -> str:
    return ", ".join(f"{value:.3f}" for value in values.tolist())
