"""OptIK: SQP with analytical gradients and random restarts, as optik-py.

Speed mode: the first solution, within 5 ms, the time that TRAC-IK has. Its tolerance is on the
square of the norm of the error, in metres and radians together: 5e-7 in that norm; its
default of 1e-6 would be 1 mm. The first search starts at the centre of the joint box; the
limits, which it keeps to and draws restarts from, are the joint box. It runs in one thread: its
solutions are then the same in each run, and the first search usually succeeds, so that further
threads only take time.

OptIK 0.5.0 places a link wrongly after a fixed joint within a chain, so it is given a
chain whose fixed and locked joints are merged into the next joint, and its forward kinematics is
checked. Prismatic joints end the whole process in it, so robots that have one are refused.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, PeerUnavailable, imported, installed_version
from benchmarks.ik.peers.pose_matrix import pose_matrix, roll_pitch_yaw
from benchmarks.ik.peers.problem import IkProblem, free_chain
from benchmarks.ik.peers.serial_chain import SerialChain

NAME = "OptIK"
TOLERANCE = 5e-7
TIME_LIMIT = 0.005

#: How far its forward kinematics may be from the robot's [m, entries of the rotation].
RIGHT = 1e-9


class _Optik(Peer):
    name = NAME
    kind: Kind = "numerical"
    settings = (
        f"Speed, one thread, tolerance {TOLERANCE:g}, random restarts within "
        f"{1e3 * TIME_LIMIT:g} ms, start at box centre, limits = box"
    )

    def __init__(self, optik: ModuleType, problem: IkProblem) -> None:
        self._problem = problem
        self.version = installed_version("optik-py")
        chain = free_chain(problem)
        if any(joint.prismatic for joint in chain.joints):
            raise PeerUnavailable(NAME, "can't do this robot: it does revolute joints only")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "chain.urdf"
            path.write_text(_merged_urdf(chain, problem), encoding="utf-8")
            self._robot = optik.Robot.from_urdf_file(str(path), "base", "tip")
        self._robot.set_parallelism(1)
        self._config = optik.SolverConfig(
            solution_mode="speed", max_time=TIME_LIMIT, tol_f=TOLERANCE**2
        )
        theirs = np.array(self._robot.fk(problem.free_start))
        if np.abs(theirs - chain.tip_placement(problem.free_start)).max() > RIGHT:
            raise PeerUnavailable(NAME, "can't do this robot: it places the end effector wrongly")

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        free = self._problem.free_of(start)
        found = self._robot.ik(self._config, pose_matrix(pose), free)
        if found is None:
            return None
        return self._problem.with_locked(np.array(found[0]))


def make(problem: IkProblem) -> Peer:
    """OptIK for a problem.

    Raises:
        PeerUnavailable: if optik-py is not installed, or can't do the robot.
    """
    return _Optik(imported(NAME, "optik", "pip install optik-py"), problem)


def _merged_urdf(chain: SerialChain, problem: IkProblem) -> str:
    """A URDF of a chain from "base" to "tip" without fixed joints but the tip's."""
    lower, upper = problem.free_box
    parts = ['<robot name="chain"><link name="base"/>']
    parent = "base"
    for column, joint in enumerate(chain.joints):
        parts.append(
            f'<joint name="joint_{column}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{column}"/>{_origin(joint.placement)}'
            f'<axis xyz="{_text(joint.axis)}"/><limit lower="{float(lower[column])!r}" '
            f'upper="{float(upper[column])!r}" effort="1" velocity="1"/></joint>'
            f'<link name="link_{column}"/>'
        )
        parent = f"link_{column}"
    parts.append(
        f'<joint name="tip" type="fixed"><parent link="{parent}"/><child link="tip"/>'
        f'{_origin(chain.tip)}</joint><link name="tip"/></robot>'
    )
    return "".join(parts)


def _origin(placement: FloatArray) -> str:
    angles = np.array(roll_pitch_yaw(placement[:3, :3]))
    return f'<origin xyz="{_text(placement[:3, 3])}" rpy="{_text(angles)}"/>'


def _text(numbers: FloatArray) -> str:
    return " ".join(repr(number) for number in numbers.tolist())
