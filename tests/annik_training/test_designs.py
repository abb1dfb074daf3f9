"""The designs of experiments against the paper's tables. ROS-free."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.errors import (
    DesignError,
    InvalidDesignSize,
    UnknownDesign,
    UnsupportedRobotForDesign,
)
from annik_core.joint_limits import JointLimits
from annik_core.robot import Robot
from annik_training.design_registry import make_design
from annik_training.quadratic_model import quadratic_rank, quadratic_terms
from annik_training.thirty_phase_design import describe_phases, phases, thirty_phase_design
from annik_training.thirty_phase_plus_design import interaction_phases, thirty_phase_plus_design

MIN, MED, MAX = 20, 35, 50

# Table 1, transcribed: joints swept (counted from 1) and where the others are.
TABLE_1 = [
    *(([joint], "min") for joint in range(1, 7)),
    *(([joint], "med") for joint in range(1, 7)),
    *(([joint], "max") for joint in range(1, 7)),
    ([1, 2], "med"),
    ([3, 4], "med"),
    ([5, 6], "med"),
    ([1, 2, 3], "med"),
    ([4, 5, 6], "med"),
    ([1, 2, 3, 4], "med"),
    ([3, 4, 5, 6], "med"),
    ([1, 2, 3, 4, 5, 6], ""),
    ([1, 3, 5], "min"),
    ([1, 3, 5], "max"),
    ([2, 4, 6], "min"),
    ([2, 4, 6], "max"),
]

# Table 8, proposed method: printed number, phase, joint positions. Its numbers 60-63 and 74, 75
# contradict those around them (phase 18 would end at 63, yet phase 23 still ends at 82), so only
# the rows are compared there; the rows printed after 104 belong to no phase.
TABLE_8 = [
    (1, 1, [20, 20, 20, 20, 20, 20]),
    (2, 1, [30, 20, 20, 20, 20, 20]),
    (3, 1, [40, 20, 20, 20, 20, 20]),
    (4, 1, [50, 20, 20, 20, 20, 20]),
    (5, 2, [20, 30, 20, 20, 20, 20]),
    (6, 2, [20, 40, 20, 20, 20, 20]),
    (7, 2, [20, 50, 20, 20, 20, 20]),
    (17, 6, [20, 20, 20, 20, 20, 30]),
    (18, 6, [20, 20, 20, 20, 20, 40]),
    (19, 6, [20, 20, 20, 20, 20, 50]),
    (20, 7, [20, 35, 35, 35, 35, 35]),
    (21, 7, [30, 35, 35, 35, 35, 35]),
    (22, 7, [40, 35, 35, 35, 35, 35]),
    (23, 7, [50, 35, 35, 35, 35, 35]),
    (40, 12, [35, 35, 35, 35, 35, 20]),
    (41, 12, [35, 35, 35, 35, 35, 30]),
    (42, 12, [35, 35, 35, 35, 35, 40]),
    (43, 12, [35, 35, 35, 35, 35, 50]),
    (44, 13, [20, 50, 50, 50, 50, 50]),
    (45, 13, [30, 50, 50, 50, 50, 50]),
    (46, 13, [40, 50, 50, 50, 50, 50]),
    (None, 18, [50, 50, 50, 50, 50, 20]),
    (None, 18, [50, 50, 50, 50, 50, 30]),
    (None, 18, [50, 50, 50, 50, 50, 40]),
    (None, 18, [50, 50, 50, 50, 50, 50]),
    (None, 19, [20, 20, 35, 35, 35, 35]),
    (None, 21, [35, 35, 35, 35, 50, 50]),
    (82, 23, [35, 35, 35, 50, 50, 50]),
    (83, 24, [20, 20, 20, 20, 35, 35]),
    (90, 25, [35, 35, 50, 50, 50, 50]),
    (91, 26, [30, 30, 30, 30, 30, 30]),
    (92, 26, [40, 40, 40, 40, 40, 40]),
    (93, 27, [30, 20, 30, 20, 30, 20]),
    (94, 27, [40, 20, 40, 20, 40, 20]),
    (102, 30, [50, 20, 50, 20, 50, 20]),
    (103, 30, [50, 30, 50, 30, 50, 30]),
    (104, 30, [50, 40, 50, 40, 50, 40]),
]


def box(dof: int = 6, lower: float = MIN, upper: float = MAX) -> JointLimits:
    names = [f"q{joint + 1}" for joint in range(dof)]
    return JointLimits.from_bounds(names, [lower] * dof, [upper] * dof)


def table_1_rows(steps: int) -> list[tuple[Fraction, ...]]:
    """All rows of Table 1 on [0, 1], in exact arithmetic, repeats and all."""
    held = {"min": Fraction(0), "med": Fraction(1, 2), "max": Fraction(1), "": Fraction(0)}
    return [
        tuple(Fraction(z, steps) if joint in swept else held[others] for joint in range(1, 7))
        for swept, others in TABLE_1
        for z in range(steps + 1)
    ]


def test_the_phases_are_those_of_table_1() -> None:
    assert list(describe_phases(6)) == [
        f"{number}: {', '.join(f'q{joint}' for joint in swept)} swept"
        + (f", the others at {others}" if others else "")
        for number, (swept, others) in enumerate(TABLE_1, start=1)
    ]


@pytest.mark.parametrize(("steps", "count"), [(3, 102), (6, 179), (15, 462), (18, 539)])
def test_counts_without_repeated_rows(steps: int, count: int) -> None:
    assert len(thirty_phase_design(box(), steps)) == count


@pytest.mark.parametrize(("steps", "count"), [(3, 104), (6, 194)])
def test_counts_as_the_paper_prints_them(steps: int, count: int) -> None:
    assert len(thirty_phase_design(box(), steps, keep_paper_rows=True)) == count


@pytest.mark.parametrize("steps", [1, 2, 3, 6, 7, 15, 18])
def test_rows_are_exactly_those_of_table_1(steps: int) -> None:
    """In the order of first appearance, against exact fractions."""
    expected = np.array(list(dict.fromkeys(table_1_rows(steps))), dtype=np.float64)
    assert thirty_phase_design(box(lower=0, upper=1), steps) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(("number", "phase", "row"), TABLE_8)
def test_the_printed_rows_of_table_8(number: int | None, phase: int, row: list[int]) -> None:
    rows = thirty_phase_design(box(), 3, keep_paper_rows=True)
    if number is not None:
        assert rows[number - 1] == pytest.approx(row)
    assert np.isclose(rows, row).all(axis=1).any()
    swept, others = TABLE_1[phase - 1]
    held = {"min": MIN, "med": MED, "max": MAX}
    assert all(
        value == held[others] for joint, value in enumerate(row, start=1) if joint not in swept
    )


@given(st.integers(1, 8), st.integers(1, 20))
def test_any_joint_count(dof: int, steps: int) -> None:
    """Inside the box, no row twice, every joint swept alone from end to end."""
    rows = thirty_phase_design(box(dof), steps)
    assert box(dof).contains(rows)
    assert len(np.unique(rows, axis=0)) == len(rows)
    for joint in range(dof):
        others = np.delete(rows, joint, axis=1)
        alone = rows[(others == MIN).all(axis=1), joint]
        assert len(alone) >= steps + 1
        assert {MIN, MAX} <= set(alone)
    assert len(set(phases(dof))) == len(phases(dof))


@pytest.mark.parametrize("steps", [0, -1, 1001])
def test_a_number_of_steps_out_of_range(steps: int) -> None:
    with pytest.raises(InvalidDesignSize, match="from 1 to 1000"):
        thirty_phase_design(box(), steps)


def test_the_papers_rows_need_six_joints() -> None:
    with pytest.raises(UnsupportedRobotForDesign, match="six"):
        thirty_phase_design(box(7), 3, keep_paper_rows=True)


@pytest.mark.parametrize(("positions", "levels", "count"), [(3, 1, 108), (4, 1, 256), (4, 2, 448)])
def test_workspace_grid_counts_of_table_7(
    gantry: Robot, positions: int, levels: int, count: int
) -> None:
    rows = make_design("workspace_grid", gantry, positions, 0, {"orientation_levels": levels})
    assert len(np.unique(rows.round(12), axis=0)) == count
    assert gantry.joint_box.contains(rows)


@pytest.mark.parametrize(
    ("number", "row"),
    [
        (1, [20, 20, 20, 20, 20, 20]),
        (2, [35, 20, 20, 20, 20, 20]),
        (4, [20, 35, 20, 20, 20, 20]),
        (10, [20, 20, 35, 20, 20, 20]),
        (27, [50, 50, 50, 20, 20, 20]),
        (28, [20, 20, 20, 50, 20, 20]),
        (30, [50, 20, 20, 50, 20, 20]),
        (55, [20, 20, 20, 20, 50, 20]),
        (81, [50, 50, 50, 20, 50, 20]),
    ],
)
def test_the_printed_grid_of_table_8(gantry: Robot, number: int, row: list[int]) -> None:
    rows = make_design("workspace_grid", gantry, 3, 0)
    assert np.degrees(rows[number - 1]) == pytest.approx(row)


def test_unknown_design_lists_the_known(gantry: Robot) -> None:
    with pytest.raises(UnknownDesign, match="thirty_phase, thirty_phase_plus, workspace_grid"):
        make_design("intuition", gantry, 3, 0)


def test_unknown_option_lists_the_known(gantry: Robot) -> None:
    with pytest.raises(DesignError, match="keep_paper_rows"):
        make_design("thirty_phase", gantry, 3, 0, {"colour": "blue"})


class TestInteractions:
    """What a design can and can't tell apart, in exact arithmetic."""

    @staticmethod
    def integer_rows(rows: np.ndarray, steps: int) -> list[list[int]]:
        """Rows on [0, 1] as whole half steps."""
        scaled = rows * 2 * steps
        whole = np.rint(scaled)
        assert np.abs(scaled - whole).max() < 1e-9
        return whole.astype(int).tolist()

    @pytest.mark.parametrize("steps", [2, 3, 6, 15, 18])
    def test_the_papers_design_has_rank_24_of_28(self, steps: int) -> None:
        """And is blind to these products of joint differences."""
        rows = self.integer_rows(thirty_phase_design(box(lower=0, upper=1), steps), steps)
        assert len(quadratic_terms(6)) == 28
        assert quadratic_rank(rows) == 24
        for first, second in (((0, 1), (3, 5)), ((0, 2), (4, 5)), ((1, 3), (4, 5))):
            products = [
                (row[first[0]] - row[first[1]]) * (row[second[0]] - row[second[1]]) for row in rows
            ]
            assert set(products) == {0}

    @pytest.mark.parametrize("dof", range(2, 9))
    @pytest.mark.parametrize("steps", [2, 3, 7])
    def test_the_repaired_design_has_full_rank(self, dof: int, steps: int) -> None:
        rows = thirty_phase_plus_design(box(dof, lower=0, upper=1), steps)
        assert quadratic_rank(self.integer_rows(rows, steps)) == (dof + 1) * (dof + 2) // 2

    def test_the_repair_for_six_joints(self) -> None:
        """Four pairs, and no more rows than their sweeps add."""
        assert [phase.swept for phase in interaction_phases(6)] == [(0, 2), (0, 3), (0, 4), (1, 4)]
        assert len(thirty_phase_plus_design(box(), 3)) == 118


@pytest.mark.parametrize("name", ["latin_hypercube", "sobol", "random"])
class TestSamplingDesigns:
    """Inside the box, as many as asked for, the same for the same seed."""

    @given(examples=st.integers(1, 300))
    def test_size_and_box(self, gantry: Robot, name: str, examples: int) -> None:
        rows = make_design(name, gantry, examples, seed=1)
        assert rows.shape == (examples, 6)
        assert gantry.joint_box.contains(rows)

    def test_the_seed_decides(self, gantry: Robot, name: str) -> None:
        first = make_design(name, gantry, 50, seed=1)
        assert np.array_equal(first, make_design(name, gantry, 50, seed=1))
        assert not np.array_equal(first, make_design(name, gantry, 50, seed=2))

    @pytest.mark.parametrize("examples", [0, -3, 1_000_001])
    def test_size_out_of_range(self, gantry: Robot, name: str, examples: int) -> None:
        with pytest.raises(InvalidDesignSize, match=name):
            make_design(name, gantry, examples, seed=1)


def test_a_latin_hypercube_has_one_example_in_every_slice(gantry: Robot) -> None:
    limits = gantry.joint_box
    rows = make_design("latin_hypercube", gantry, 40, seed=3)
    slices = np.floor(40 * (rows - limits.lower) / (limits.upper - limits.lower)).astype(int)
    assert all(sorted(column) == list(range(40)) for column in slices.T)


def test_a_longer_sobol_design_begins_with_a_shorter(gantry: Robot) -> None:
    longer = make_design("sobol", gantry, 100, seed=4)
    assert np.array_equal(longer[:37], make_design("sobol", gantry, 37, seed=4))
