"""Diagnostics of a design: rank, condition, interactions it can't identify, empty regions."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree
from scipy.stats import qmc

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.quadratic_model import quadratic_terms

#: Singular values below this fraction of the largest count as zero.
RANK_TOLERANCE = 1e-9
_PROBES = 2**13


@dataclass(frozen=True)
class ModelRank:
    """How well the examples identify a polynomial model in the joint positions."""

    rank: int  #: number of independent terms of the model
    terms: int
    condition: float  #: largest singular value over the smallest nonzero one, joints on [-1, 1]

    def __str__(self) -> str:
        """One line."""
        return f"rank {self.rank} of {self.terms}, condition number {self.condition:.1f}"


@dataclass(frozen=True)
class DesignDiagnostics:
    """Diagnostics of a design, in joint positions scaled to [-1, 1] over the joint box."""

    examples: int  #: number of distinct examples
    linear: ModelRank  #: model of the constant and the joint positions
    quadratic: ModelRank  #: the same with squares and products
    #: Pairs of joint names whose product these examples can't tell from other products of two
    #: joints, for any robot.
    blind_interactions: tuple[tuple[str, str], ...]
    #: Radius of the largest ball inside the box without an example, relative to half the diagonal
    #: of the box; a lower bound, found among many probes.
    largest_empty_ball: float

    def __str__(self) -> str:
        """All but the blind interactions, one line each."""
        return (
            f"linear model: {self.linear}\nquadratic model: {self.quadratic}\n"
            f"largest empty ball: {self.largest_empty_ball:.2f} of half the box's diagonal"
        )


def diagnose(joint_positions: FloatArray, box: JointLimits) -> DesignDiagnostics:
    """Diagnose joint positions ``(n, dof)`` inside a joint box; locked joints are excluded."""
    free = box.free
    lower, upper = box.lower[free], box.upper[free]
    scaled = 2.0 * (joint_positions[:, free] - lower) / (upper - lower) - 1.0
    terms = quadratic_terms(len(free))
    columns = np.stack([np.prod(scaled[:, list(term)], axis=1) for term in terms], axis=1)
    linear = [index for index, term in enumerate(terms) if len(term) < 2]
    names = [box.joint_names[joint] for joint in free]
    unseen = _unidentifiable(columns)
    return DesignDiagnostics(
        examples=len(np.unique(joint_positions, axis=0)),
        linear=_rank(columns[:, linear]),
        quadratic=_rank(columns),
        blind_interactions=tuple(
            (names[first], names[second])
            for first, second in combinations(range(len(free)), 2)
            if unseen[terms.index((first, second))]
        ),
        largest_empty_ball=_largest_empty_ball(scaled),
    )


def _rank(columns: FloatArray) -> ModelRank:
    singular, _ = _singular_values(columns)
    counted = singular[singular > RANK_TOLERANCE * singular[0]]
    return ModelRank(len(counted), columns.shape[1], float(counted[0] / counted[-1]))


def _unidentifiable(columns: FloatArray) -> list[bool]:
    """Whether each term is part of a combination that is zero on all examples."""
    singular, right = _singular_values(columns)
    rank = int((singular > RANK_TOLERANCE * singular[0]).sum())
    in_null_space = np.linalg.norm(right[rank:], axis=0) > 1e-6
    return [bool(unseen) for unseen in in_null_space]


def _singular_values(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values, the largest first, and all right singular vectors ``(terms, terms)``.

    Computed from the triangular factor, which has no more rows than there are terms.
    """
    _, singular, right = np.linalg.svd(np.linalg.qr(columns, mode="r"), full_matrices=True)
    return singular, right


def _largest_empty_ball(scaled: FloatArray) -> float:
    dof = scaled.shape[1]
    probes = 2.0 * qmc.Sobol(dof, scramble=False).random(_PROBES) - 1.0
    to_example = KDTree(scaled).query(probes)[0]
    to_wall = 1.0 - np.abs(probes).max(axis=1)
    return float(np.minimum(to_example, to_wall).max() / np.sqrt(dof))
