"""Joint positions anywhere within the joint limits: one solution of a pose, or all of them.

Newton's method finds a solution from a start that is near to it. Starts are, in this order: those
given, such as a network's; the joint positions of stored examples whose poses are nearest to the
target; those beyond a singularity close to a solution that was found; and a sequence that covers
the limits, until two batches of it bring nothing new. All is deterministic, and the number of
starts is bounded.

Examples are near in few dimensions. The first joint turns the pose about an axis of the base, or
moves it along one, and the last joint turns it about an axis of the end effector: both find their
positions by themselves. Of six joints, four are left, and of a pose the same number of dimensions.

Starts on one side of a known solution would find it again. Two solutions that are close lie on
both sides of a singularity, which the derivative of the least singular value tells the distance
of: within a part of that distance of a solution there is no other, and a search that comes there
ends.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from annik_core.pose import FloatArray
from annik_core.robots.task import Task
from annik_core.settings import CheckedSettings, setting

#: A target within this distance of the previous pose, in radians and half reaches, continues its
#: branch only by a straight motion of the end effector, and no joint moves much further than that
#: needs; ``search.hpp`` has the same.
NEAR = 0.2


@dataclass(frozen=True)
class SearchOptions(CheckedSettings):
    """How a solution is sought within the joint limits of a whole robot."""

    max_starts: int = setting(
        1000,
        "Most starts of the search for one target, which bounds its time.",
        within=(1, 1_000_000),
    )
    spacing: float = setting(
        0.5,
        "Of an arm with more than six joints, how far apart the solutions are that are listed.",
        unit="rad or m",
        within=(1e-3, math.inf),
    )
    task: Task = setting(
        Task.AUTO,
        "What of a target must be reached; its orientation is as near as possible besides. pose: "
        "all of it; position_and_axis: position, and z axis of the end effector; position: the "
        "position; auto: the pose, or, of an arm whose end effector moves in fewer than six "
        "independent directions, the position.",
    )
    allow_branch_change: bool = setting(
        False,
        "Where the branch of the previous command ends: command the nearest solution on another "
        "branch, if the limits on steps allow it. Otherwise such a target is refused.",
    )


class FoundSolution(NamedTuple):
    """Where a search ended.

    Attributes:
        joint_positions: ``(dof,)`` [rad or m].
        position_residual: distance to the target at exactly these [m].
        orientation_residual: angle to the target's orientation [rad].
        effort: starts or steps that it took.
        found: whether this is a solution.
    """

    joint_positions: FloatArray
    position_residual: float
    orientation_residual: float
    effort: int
    found: bool


class FoundSolutions(NamedTuple):
    """All solutions that were found, ``(n, dof)`` and ``(n,)``, and the number of starts."""

    joint_positions: FloatArray
    position_residuals: FloatArray
    orientation_residuals: FloatArray
    starts: int


class Search(Protocol):
    """Solutions of one robot within its limits."""

    def first(self, target: FloatArray, starts: FloatArray, most: int) -> FoundSolution:
        """The first solution of a target ``(7,)``, beginning at starts ``(n, dof)``."""
        ...

    def all(
        self, target: FloatArray, starts: FloatArray, most: int, spacing: float
    ) -> FoundSolutions:
        """All solutions, in the order in which they are found.

        ``spacing``: the distance between solutions of redundant joints [rad or m].
        """
        ...

    def follow(self, previous: FloatArray, target: FloatArray) -> FoundSolution:
        """The solution to which joints move steadily from ``previous`` ``(dof,)``.

        While the end effector moves straight to the target. Not found: it is where that ends.
        """
        ...

    def same_branch(self, first: FloatArray, second: FloatArray) -> bool:
        """Whether the straight joint motion from one to the other ``(dof,)`` has no singularity.

        But at its ends: branches meet there. Of an arm of six joints; others have no branches by
        this.
        """
        ...
