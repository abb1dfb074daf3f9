"""The full quadratic model in the joint positions, and its exact rank on a set of rows.

The rank is computed in integers and fractions: in floating point it would depend on a tolerance.
"""

from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import prod
from typing import Any

from sympy import QQ, ZZ
from sympy.polys.matrices import DomainMatrix

#: Joints (counted from 0) whose product a term is; the empty tuple is the constant.
Term = tuple[int, ...]
#: A matrix of integers or fractions; SymPy ships no types.
ExactMatrix = Any


def quadratic_terms(dof: int) -> list[Term]:
    """Constant, linear, square and product terms: (dof + 1)(dof + 2) / 2 of them."""
    joints = range(dof)
    return [(), *((joint,) for joint in joints), *combinations_with_replacement(joints, 2)]


def term_values(rows: Sequence[Sequence[int]]) -> ExactMatrix:
    """Values of all terms ``(distinct rows, terms)`` on integer rows ``(n, dof)``."""
    distinct = sorted({tuple(row) for row in rows})
    terms = quadratic_terms(len(distinct[0]))
    values = [[prod(row[joint] for joint in term) for term in terms] for row in distinct]
    return DomainMatrix(values, (len(values), len(terms)), ZZ)


def vanishing_combinations(rows: Sequence[Sequence[int]]) -> ExactMatrix:
    """Coefficients ``(k, terms)`` of quadratics that are zero on all integer rows ``(n, dof)``.

    They span all such quadratics. If all terms are linearly independent, there are none.
    """
    return _square(term_values(rows)).nullspace()


def _square(values: ExactMatrix) -> ExactMatrix:
    """A matrix of the same rank and null space with far fewer rows: real numbers square to > 0."""
    return (values.transpose() * values).convert_to(QQ)
