"""The designs of experiments against the paper's tables. ROS-free."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from annik_core.errors import InvalidValue
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.designs.central_composite_design import central_composite_design
from annik_training.designs.quadratic_model import (
    quadratic_terms,
    vanishing_combinations,
)
from annik_training.designs.registry import DESIGNS, Needs, design_names, make_design
from annik_training.designs.thirty_phase_design import phases, thirty_phase_design
from annik_training.designs.thirty_phase_plus_design import (
    interaction_phases,
    thirty_phase_plus_design,
)
from annik_training.errors import UnsupportedRobot
from benchmarks.paper.interaction_experiment import quadratic_rank
from docs.update_docs import describe_phases

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


def ruled_rows(dof: int, steps: int) -> set[tuple[Fraction, ...]]:
    """The rows of docs/training.md for any number of joints, on [0, 1], in exact arithmetic."""
    joints = range(dof)
    low, median, high = Fraction(0), Fraction(1, 2), Fraction(1)
    sweeps = {((joint,), held) for joint in joints for held in (low, median, high)}
    sweeps.add((tuple(joints), median))
    for size in (2, 3, 4):
        if size < dof:
            for start in range(0, dof, size):
                block = range(start, start + size)
                # The last block ends with the last joint.
                beyond = max(0, block.stop - dof)
                sweeps.add((tuple(joint - beyond for joint in block), median))
    for parity in (0, 1):
        half = tuple(joint for joint in joints if joint % 2 == parity)
        sweeps |= {(half, low), (half, high)}
    return swept_rows(sweeps, dof, steps)


def swept_rows(
    sweeps: set[tuple[tuple[int, ...], Fraction]], dof: int, steps: int
) -> set[tuple[Fraction, ...]]:
    """All rows of joints swept together, the others held."""
    return {
        tuple(Fraction(z, steps) if joint in swept else held for joint in range(dof))
        for swept, held in sweeps
        for z in range(steps + 1)
    }


def whole_half_steps(rows: np.ndarray, steps: int) -> list[tuple[int, ...]]:
    """Rows on [0, 1] in half steps, which are whole numbers."""
    scaled = rows * 2 * steps
    whole = np.rint(scaled)
    assert np.abs(scaled - whole).max() < 1e-9
    return [tuple(row) for row in whole.astype(int).tolist()]


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


@pytest.mark.parametrize("dof", range(1, 9))
@pytest.mark.parametrize("steps", [1, 2, 3, 6, 15])
def test_rows_are_those_of_the_documented_rule(dof: int, steps: int) -> None:
    rows = whole_half_steps(thirty_phase_design(box(dof, lower=0, upper=1), steps), steps)
    expected = {tuple(2 * steps * value for value in row) for row in ruled_rows(dof, steps)}
    assert set(rows) == expected
    assert len(rows) == len(expected)


@pytest.mark.parametrize("steps", [0, -1, 1001])
@pytest.mark.parametrize("name", ["thirty_phase", "thirty_phase_plus"])
def test_a_number_of_steps_out_of_range(name: str, steps: int) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(Subject(box()), name, steps, 0)
    assert (caught.value.value, caught.value.allowed) == (steps, "1 to 1000")


def test_the_papers_rows_need_six_joints() -> None:
    with pytest.raises(UnsupportedRobot) as caught:
        thirty_phase_design(box(7), 3, keep_paper_rows=True)
    assert (caught.value.purpose, caught.value.robot) == ("--paper-rows", "7 joints")
    assert "six" in caught.value.reason


@pytest.mark.parametrize(("positions", "levels", "count"), [(3, 1, 108), (4, 1, 256), (4, 2, 448)])
def test_workspace_grid_counts_of_table_7(
    gantry: Robot, positions: int, levels: int, count: int
) -> None:
    rows = make_design(gantry, "workspace_grid", positions, 0, {"orientation_levels": levels})
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
    rows = make_design(gantry, "workspace_grid", 3, 0)
    assert np.degrees(rows[number - 1]) == pytest.approx(row)


def test_unknown_design_lists_the_known(gantry: Robot) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(gantry, "intuition", 3, 0)
    assert caught.value.value == "intuition"
    assert caught.value.allowed.split(", ") == list(design_names())


def test_unknown_option_lists_the_known(gantry: Robot) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(gantry, "thirty_phase", 3, 0, {"colour": "blue"})
    assert (caught.value.value, caught.value.allowed) == ("colour", "steps, keep_paper_rows")


@pytest.mark.parametrize(
    ("positions", "levels", "wrong"), [(1, 1, 1), (101, 1, 101), (2, 0, 0), (2, 101, 101)]
)
def test_a_grid_out_of_range(gantry: Robot, positions: int, levels: int, wrong: int) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(gantry, "workspace_grid", positions, 0, {"orientation_levels": levels})
    assert caught.value.value == wrong


class TestInteractions:
    """What a design can and can't tell apart, in exact arithmetic."""

    @staticmethod
    def papers_rows(steps: int, scale: int | None = None) -> list[tuple[int, ...]]:
        """Table 1 by whole numbers: in half steps, or with ``scale`` as the joints' range."""
        rows = [[(scale or 2 * steps) * value for value in row] for row in table_1_rows(steps)]
        assert all(value.denominator == 1 for row in rows for value in row)
        return [tuple(int(value) for value in row) for row in rows]

    @pytest.mark.parametrize("steps", [1, 2, 3, 6, 15, 18])
    def test_the_papers_design_has_rank_24_of_28(self, steps: int) -> None:
        """And is blind to these products of joint differences."""
        rows = self.papers_rows(steps)
        assert set(rows) == set(
            whole_half_steps(thirty_phase_design(box(lower=0, upper=1), steps), steps)
        )
        assert len(quadratic_terms(6)) == 28
        assert quadratic_rank(rows) == 24
        for first, second in (((0, 1), (3, 5)), ((0, 2), (4, 5)), ((1, 3), (4, 5))):
            products = [
                (row[first[0]] - row[first[1]]) * (row[second[0]] - row[second[1]]) for row in rows
            ]
            assert set(products) == {0}

    @pytest.mark.parametrize("steps", [3, 7, 20])
    def test_more_steps_show_the_papers_design_no_more(self, steps: int) -> None:
        """A phase is a line, and a quadratic that is zero at three points of it is zero on it.

        So two steps decide what is blind for every larger number.
        """
        together = self.papers_rows(2, scale=4 * steps) + self.papers_rows(steps, scale=4 * steps)
        assert quadratic_rank(together) == 24
        assert vanishing_combinations(self.papers_rows(2)).shape == (4, 28)

    @pytest.mark.parametrize("dof", range(2, 9))
    @pytest.mark.parametrize("steps", [1, 2, 3, 7])
    def test_the_repaired_design_has_full_rank(self, dof: int, steps: int) -> None:
        rows = thirty_phase_plus_design(box(dof, lower=0, upper=1), steps)
        assert quadratic_rank(whole_half_steps(rows, steps)) == (dof + 1) * (dof + 2) // 2

    def test_the_repair_for_six_joints(self) -> None:
        """Four pairs, and no more rows than their sweeps add."""
        assert [phase.swept for phase in interaction_phases(6)] == [(0, 2), (0, 3), (0, 4), (1, 4)]
        assert len(thirty_phase_plus_design(box(), 3)) == 118

    @pytest.mark.parametrize("dof", range(1, 9))
    def test_the_central_composite_has_full_rank(self, dof: int) -> None:
        rows = central_composite_design(box(dof, lower=0, upper=1), 1)
        assert quadratic_rank(whole_half_steps(rows, 1)) == (dof + 1) * (dof + 2) // 2


@pytest.mark.parametrize(
    ("dof", "shells", "count"), [(1, 1, 3), (2, 1, 9), (6, 1, 77), (6, 3, 229), (10, 1, 1045)]
)
def test_counts_of_the_central_composite(dof: int, shells: int, count: int) -> None:
    assert len(central_composite_design(box(dof), shells)) == count


def test_the_rows_of_a_central_composite() -> None:
    """Centre, corners and face centres, the outer box first; the bounds to the last digit."""
    limits = JointLimits.from_bounds(["a", "b"], [-0.1, 1.0], [0.3, 1.7])
    rows = central_composite_design(limits, 2)
    assert rows[0] == pytest.approx(limits.centre)
    assert set(itertools.product((-0.1, 0.3), (1.0, 1.7))) == {tuple(row) for row in rows[1:5]}
    assert rows[5:9] == pytest.approx(
        np.array([[-0.1, 1.35], [0.1, 1.0], [0.3, 1.35], [0.1, 1.7]])
    )
    assert rows[9:] - limits.centre == pytest.approx((rows[1:9] - limits.centre) / 2)


@pytest.mark.parametrize("shells", [0, -1, 101])
def test_a_number_of_shells_out_of_range(shells: int) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(Subject(box()), "central_composite", shells, 0)
    assert (caught.value.value, caught.value.allowed) == (shells, "1 to 100")


def test_a_central_composite_of_too_many_joints() -> None:
    with pytest.raises(UnsupportedRobot) as caught:
        central_composite_design(box(11), 1)
    assert (caught.value.purpose, caught.value.robot) == ("design central_composite", "11 joints")
    assert "2^11 corners" in caught.value.reason


@dataclass(frozen=True)
class Subject:
    """What a design is made for, if it is no robot."""

    joint_box: JointLimits
    name: str = "function"


@st.composite
def joint_boxes(draw: st.DrawFn) -> JointLimits:
    """Two to eight joints, one or more of them free."""
    dof = draw(st.integers(2, 8))
    lower = draw(st.lists(st.floats(-10, 10), min_size=dof, max_size=dof))
    widths = draw(
        st.lists(st.just(0.0) | st.floats(1e-3, 10), min_size=dof, max_size=dof).filter(any)
    )
    upper = [low + width for low, width in zip(lower, widths, strict=True)]
    return JointLimits.from_bounds([f"q{joint}" for joint in range(dof)], lower, upper)


def expected_count(name: str, free: int, size: int) -> int:
    """How many examples a design in a joint box has, by its documented rule."""
    if name == "central_composite":
        return size * (2**free + 2 * free) + 1 if free > 1 else 2 * size + 1
    if name.startswith("thirty_phase"):
        rows = ruled_rows(free, size)
        if name.endswith("_plus"):
            pairs = {(phase.swept, Fraction(1, 2)) for phase in interaction_phases(free)}
            rows |= swept_rows(pairs, free, size)
        return len(rows)
    return size


@pytest.mark.parametrize(
    "name", sorted(set(DESIGNS) - {"workspace_grid", "active", "identifiability"})
)
@settings(max_examples=15)
@given(limits=joint_boxes(), size=st.integers(1, 12), seed=st.integers(0, 2**32))
def test_every_design_of_joint_positions(
    name: str, limits: JointLimits, size: int, seed: int
) -> None:
    """Inside the box, the same for the same seed, no row twice, as many as the rule says."""
    rows = make_design(Subject(limits), name, size, seed)
    assert limits.contains(rows)
    assert np.array_equal(rows, make_design(Subject(limits), name, size, seed))
    assert len(np.unique(rows, axis=0)) == len(rows)
    free = int((limits.upper > limits.lower).sum())
    assert rows.shape == (expected_count(name, free, size), len(limits.joint_names))


@settings(max_examples=15)
@given(
    bounds=st.lists(
        st.tuples(st.floats(0.4, 0.6), st.just(0.0) | st.floats(1e-3, 0.2)), min_size=6, max_size=6
    ).filter(lambda joints: any(width for _, width in joints)),
    positions=st.integers(2, 4),
    levels=st.integers(1, 3),
)
def test_every_workspace_grid(
    gantry: Robot, bounds: list[tuple[float, float]], positions: int, levels: int
) -> None:
    """As for the others; a locked joint divides nothing."""
    robot = gantry_with_box(gantry, [[low, low + width] for low, width in bounds])
    options = {"orientation_levels": levels}
    rows = make_design(robot, "workspace_grid", positions, 0, options)
    assert robot.joint_box.contains(rows)
    assert np.array_equal(rows, make_design(robot, "workspace_grid", positions, 1, options))
    assert len(np.unique(rows.round(9), axis=0)) == len(rows)
    free = robot.joint_box.upper > robot.joint_box.lower
    assert len(rows) == positions ** free[:3].sum() * (1 + levels * free[3:].sum())


def gantry_with_box(gantry: Robot, bounds: list[list[float]]) -> Robot:
    """The gantry, with other joint boxes [rad]."""
    joints = [
        {**joint, "box": bound}
        for joint, bound in zip(gantry.definition["joints"], bounds, strict=True)
    ]
    definition: dict[str, Any] = {**gantry.definition, "joints": joints}
    return robot_from_definition(definition, "of the test")


def test_default_sizes(gantry: Robot) -> None:
    counts = {
        name: len(make_design(gantry, name, design.size.default, 0))
        for name, design in DESIGNS.items()
        if name != "active" and design.needs is not Needs.ARM  # it takes its time
    }
    assert counts == {
        "thirty_phase": 179,
        "thirty_phase_plus": 203,
        "workspace_grid": 256,
        "central_composite": 77,
        "latin_hypercube": 100,
        "sobol": 100,
        "random": 100,
    }


@pytest.mark.parametrize("name", DESIGNS)
def test_a_robot_whose_joints_are_all_locked(gantry: Robot, name: str) -> None:
    locked = gantry_with_box(gantry, [[0.5, 0.5]] * 6)
    with pytest.raises(UnsupportedRobot) as caught:
        make_design(locked, name, DESIGNS[name].size.default, 0)
    assert (caught.value.robot, caught.value.purpose) == ("gantry", f"design {name}")
    assert caught.value.reason == "all its joints are locked"


def test_a_workspace_grid_needs_a_robot() -> None:
    with pytest.raises(UnsupportedRobot) as caught:
        make_design(Subject(box()), "workspace_grid", 3, 0)
    assert (caught.value.robot, caught.value.purpose) == (Subject.name, "design workspace_grid")
    assert "workspace" in caught.value.reason


@pytest.mark.parametrize("name", ["latin_hypercube", "sobol", "random"])
class TestSamplingDesigns:
    """Inside the box, as many as asked for, the same for the same seed."""

    @given(examples=st.integers(1, 300))
    def test_size_and_box(self, gantry: Robot, name: str, examples: int) -> None:
        rows = make_design(gantry, name, examples, seed=1)
        assert rows.shape == (examples, 6)
        assert gantry.joint_box.contains(rows)

    def test_the_seed_decides(self, gantry: Robot, name: str) -> None:
        first = make_design(gantry, name, 50, seed=1)
        assert np.array_equal(first, make_design(gantry, name, 50, seed=1))
        assert not np.array_equal(first, make_design(gantry, name, 50, seed=2))

    @pytest.mark.parametrize("examples", [0, -3, 1_000_001])
    def test_size_out_of_range(self, gantry: Robot, name: str, examples: int) -> None:
        with pytest.raises(InvalidValue) as caught:
            make_design(gantry, name, examples, seed=1)
        error = caught.value
        assert (error.value, error.allowed) == (examples, "1 to 1000000")
        assert name in error.name


def test_a_latin_hypercube_has_one_example_in_every_slice(gantry: Robot) -> None:
    limits = gantry.joint_box
    rows = make_design(gantry, "latin_hypercube", 40, seed=3)
    slices = np.floor(40 * (rows - limits.lower) / (limits.upper - limits.lower)).astype(int)
    assert all(sorted(column) == list(range(40)) for column in slices.T)


def test_a_longer_sobol_design_begins_with_a_shorter(gantry: Robot) -> None:
    longer = make_design(gantry, "sobol", 100, seed=4)
    assert np.array_equal(longer[:37], make_design(gantry, "sobol", 37, seed=4))
