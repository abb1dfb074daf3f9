"""Options of a solver, and what it returns for every target, accepted or refused."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray, Numbers
from annik_core.robots.robot import NO_REFERENCE
from annik_core.safety import UNKNOWN, IkStatus, Refusal
from annik_core.settings import CheckedSettings, setting


@dataclass(frozen=True)
class RefinementOptions(CheckedSettings):
    """When a refinement ends."""

    max_newton_steps: int = setting(
        10,
        "Most iterations of the refinement of one target, which bounds its time; a solution that "
        "has not converged by then is refused.",
        within=(0, 1000),
    )
    tolerance: float = setting(
        5e-7,
        "The refinement has converged when distance and angle to the target are at most this.",
        unit="m and rad",
        within=(1e-12, 1.0),
    )


class RefinementResult(NamedTuple):
    """Where a refinement ended.

    Attributes:
        joint_positions: ``(dof,)`` [rad or m], inside the box.
        position_residual: distance to the target at exactly these [m].
        orientation_residual: angle to the target's orientation [rad].
        converged: whether both residuals are within the tolerance.
    """

    joint_positions: FloatArray
    position_residual: float
    orientation_residual: float
    newton_steps: int
    converged: bool


class RefinementResults(NamedTuple):
    """Where the refinements of n targets ended: :class:`RefinementResult` column by column."""

    joint_positions: FloatArray  #: ``(n, dof)`` [rad or m]
    position_residual: FloatArray  #: ``(n,)`` [m]
    orientation_residual: FloatArray  #: ``(n,)`` [rad]
    newton_steps: NDArray[np.int32]  #: ``(n,)``
    converged: NDArray[np.bool_]  #: ``(n,)``

    def row(self, index: int) -> RefinementResult:
        """Where one of them ended."""
        columns = (column[index].item() for column in self[1:])
        return RefinementResult(self.joint_positions[index], *columns)


@dataclass(frozen=True, eq=False)
class IkResult:
    """Solution or refusal of one target pose.

    Attributes:
        status: the outcome.
        joint_positions: ``(dof,)`` [rad or m], in the order of the robot's joint names, or None if
            the target was refused. Read-only.
        position_residual: distance between the target and the pose that the forward kinematics
            gives for exactly these joint positions [m]; NaN if it was refused before that.
        orientation_residual: angle between the two orientations [rad]; NaN likewise.
        newton_steps: refinement steps taken; 0 in network mode.
        reason: one line saying why it was refused, with the value and the allowed range; empty on
            success.
        target: ``(7,)`` the checked target, its quaternion normalised; None if refused.
        reference: what to give the workspace with the next target, so that it stays on this
            solution where the pose leaves a choice; None if refused.
        expected_position_error: for a calibrated robot, a bound on the distance between its pose
            and that of the model, which holds for 95 of 100 poses [m]; NaN if unknown or refused.
        expected_orientation_error: likewise the angle [rad].
    """

    status: IkStatus
    joint_positions: FloatArray | None
    position_residual: float
    orientation_residual: float
    newton_steps: int
    reason: str
    target: FloatArray | None = None
    reference: Numbers | None = None
    expected_position_error: float = math.nan
    expected_orientation_error: float = math.nan

    def __init__(
        self,
        status: IkStatus,
        joint_positions: FloatArray | None,
        position_residual: float,
        orientation_residual: float,
        newton_steps: int,
        reason: str,
        target: FloatArray | None = None,
        reference: Numbers | None = None,
        expected_position_error: float = math.nan,
        expected_orientation_error: float = math.nan,
    ) -> None:
        # The generated one, of a frozen class, takes twice as long.
        vars(self).update(
            status=status,
            joint_positions=joint_positions,
            position_residual=position_residual,
            orientation_residual=orientation_residual,
            newton_steps=newton_steps,
            reason=reason,
            target=target,
            reference=reference,
            expected_position_error=expected_position_error,
            expected_orientation_error=expected_orientation_error,
        )

    @property
    def accepted(self) -> bool:
        """Whether the joint positions may be commanded."""
        return self.status is IkStatus.SUCCESS

    @classmethod
    def refused(
        cls, refusal: Refusal, residuals: tuple[float, float] = UNKNOWN, newton_steps: int = 0
    ) -> "IkResult":
        """A refusal; ``residuals``: distance [m] and angle [rad] to the target, if computed."""
        return cls(refusal.status, None, *residuals, newton_steps, refusal.reason)


class IkResults(Sequence[IkResult]):
    """Results of n targets, in their order: a sequence, and the same as arrays.

    Attributes:
        accepted: ``(n,)`` whether the joint positions may be commanded.
        joint_positions: ``(n, dof)`` [rad or m], NaN where the target was refused. Read-only.
    """

    def __init__(
        self,
        targets: FloatArray,
        refined: RefinementResults,
        expected_errors: FloatArray,
        others: Mapping[int, IkResult],
    ) -> None:
        """From the columns of accepted solutions, and results that take the place of some rows.

        Args:
            targets: ``(n, 7)``, checked.
            refined: of them.
            expected_errors: ``(n, 2)`` [m], [rad].
            others: by row.
        """
        self._targets, self._refined, self._errors = targets, refined, expected_errors
        self._others = others
        self.joint_positions = refined.joint_positions
        self.accepted = np.ones(len(targets), np.bool_)
        for row, result in others.items():
            self.accepted[row] = result.accepted
            positions = result.joint_positions
            self.joint_positions[row] = math.nan if positions is None else positions
        for array in (self.joint_positions, self.accepted, targets):
            array.setflags(write=False)

    def __len__(self) -> int:
        """How many targets there were."""
        return len(self._targets)

    @overload
    def __getitem__(self, index: int) -> IkResult: ...

    @overload
    def __getitem__(self, index: slice) -> list[IkResult]: ...

    def __getitem__(self, index: int | slice) -> IkResult | list[IkResult]:
        """The result of one target, or those of several."""
        if isinstance(index, slice):
            return [self[row] for row in range(len(self))[index]]
        row = range(len(self))[index]
        other = self._others.get(row)
        if other is not None:
            return other
        one = self._refined.row(row)
        return IkResult(
            *(IkStatus.SUCCESS, *one[:-1], ""),
            *(self._targets[row], NO_REFERENCE, *self._errors[row].tolist()),
        )
