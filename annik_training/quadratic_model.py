"""The full quadratic model in the joint positions, and its rank on a set of rows, exactly.

A rank in floating point is a matter of tolerance; here it is computed with integers, so that
"blind to this interaction" is a fact of the design.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

from sympy import ZZ
from sympy.polys.matrices import DomainMatrix

#: Joints (counted from 0) whose product a term is; the empty one is the constant.
Term = tuple[int, ...]


def quadratic_terms(dof: int) -> list[Term]:
    """Constant, linear, square and product terms: (dof + 1)(dof + 2) / 2 of them."""
    joints = range(dof)
    return [(), *((joint,) for joint in joints), *combinations_with_replacement(joints, 2)]


def quadratic_rank(rows: Sequence[Sequence[int]]) -> int:
    """How many of the terms can be told apart on integer rows."""
    distinct = sorted({tuple(row) for row in rows})
    terms = quadratic_terms(len(distinct[0]))
    values = [[_value(row, term) for term in terms] for row in distinct]
    matrix = DomainMatrix(values, (len(values), len(terms)), ZZ)
    # The square matrix has the same rank over the integers, and far fewer rows.
    return int((matrix.transpose() * matrix).rank())


def _value(row: tuple[int, ...], term: Term) -> int:
    product = 1
    for joint in term:
        product *= row[joint]
    return product
