"""The pair plot: what is drawn, how it is labelled, and what marks a blind pair. ROS-free."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.cli.plots import png
from annik_training.designs.diagnostics import diagnose
from annik_training.designs.plot import pair_figure
from annik_training.designs.registry import make_design


def figure_of(rows: np.ndarray, box: JointLimits, types: tuple[str, ...] | None = None) -> Figure:
    types = types or ("revolute",) * len(box.joint_names)
    return pair_figure(rows, box, types, diagnose(rows, box), "title")


def random_figure(
    names: list[str], lower: list[float], upper: list[float], types: tuple[str, ...]
) -> Figure:
    box = JointLimits.from_bounds(names, lower, upper)
    rows = np.random.default_rng(0).uniform(box.lower, box.upper, (30, len(names)))
    return figure_of(rows, box, types)


@pytest.fixture(scope="module")
def papers_figure(gantry: Robot) -> Figure:
    return figure_of(make_design(gantry, "thirty_phase", 3, seed=0), gantry.joint_box)


def scatter_panels(figure: Figure) -> list[Axes]:
    """In the order of the lower triangle, row by row."""
    return [axes for axes in figure.axes if axes.collections]


def legend_text(figure: Figure) -> str:
    (legend,) = figure.legends
    lines = [legend.get_title(), *legend.get_texts()]
    return " ".join(" ".join(line.get_text() for line in lines).split())


def labels(figure: Figure) -> set[str]:
    return {text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())} - {""}


def test_a_png_of_a_reasonable_size() -> None:
    box = JointLimits.from_bounds(["a", "b"], [0, 0], [1, 1])
    rows = np.random.default_rng(0).uniform(0, 1, (30, 2))
    picture = png(pair_figure(rows, box, ("revolute",) * 2, diagnose(rows, box), "title"))
    assert picture.startswith(b"\x89PNG")
    assert 10_000 < len(picture) < 1_000_000


def test_every_pair_and_every_joint_has_a_panel(gantry: Robot, papers_figure: Figure) -> None:
    assert len(papers_figure.axes) == 6 * 7 // 2
    assert len(scatter_panels(papers_figure)) == 6 * 5 // 2
    assert labels(papers_figure) == {f"{name}\n[deg]" for name in gantry.joint_names}


def test_positions_are_drawn_in_degrees(gantry: Robot, papers_figure: Figure) -> None:
    """All examples are there, once where several coincide."""
    first = scatter_panels(papers_figure)[0]
    drawn = np.asarray(first.collections[0].get_offsets())
    rows = np.degrees(make_design(gantry, "thirty_phase", 3, seed=0))[:, :2]
    assert np.unique(drawn.round(6), axis=0) == pytest.approx(np.unique(rows.round(6), axis=0))
    assert len(drawn) == len(np.unique(rows.round(6), axis=0))


def test_blind_pairs_differ_in_marker_frame_and_colour(papers_figure: Figure) -> None:
    """And only they: the three others are x with y, z with roll, pitch with yaw."""
    panels = scatter_panels(papers_figure)
    pairs = [(row, column) for row in range(6) for column in range(row)]
    seen = [pair in ((1, 0), (3, 2), (5, 4)) for pair in pairs]
    colours = [to_hex(panel.collections[0].get_facecolor()[0]) for panel in panels]
    corners = [len(panel.collections[0].get_paths()[0].vertices) for panel in panels]
    frames = [panel.spines["left"].get_linewidth() for panel in panels]
    for quality in (colours, corners, frames):
        (sighted,) = {value for value, is_seen in zip(quality, seen, strict=True) if is_seen}
        (blind,) = {value for value, is_seen in zip(quality, seen, strict=True) if not is_seen}
        assert sighted != blind


def test_the_legend_says_what_a_frame_means(papers_figure: Figure) -> None:
    text = legend_text(papers_figure)
    assert "blind pair, framed" in text
    assert "rank 24 of 28" in text
    assert "largest empty ball" in text


def test_the_legend_of_a_design_that_is_not_blind_has_no_frames() -> None:
    text = legend_text(random_figure(["a", "b"], [0, 0], [1, 1], ("revolute",) * 2))
    assert "blind" not in text
    assert "rank 6 of 6" in text


def test_units_follow_the_kind_and_the_range_of_a_joint() -> None:
    figure = random_figure(
        ["a", "b", "c"], [-1, 0, 0], [1, 0.5, 2], ("revolute", "prismatic", "prismatic")
    )
    assert labels(figure) == {"a\n[deg]", "b\n[mm]", "c\n[m]"}
    assert [text.get_text() for text in figure.axes[-1].get_xticklabels()] == ["0", "1", "2"]


def test_a_locked_joint_is_left_out_and_named() -> None:
    figure = random_figure(["a", "b", "c"], [-1, 0.5, 0], [1, 0.5, 2], ("revolute",) * 3)
    assert len(scatter_panels(figure)) == 1
    assert "locked: b" in legend_text(figure)


def test_a_single_joint_has_a_histogram() -> None:
    figure = random_figure(["a"], [0], [1], ("revolute",))
    assert len(figure.axes) == 1
    assert not scatter_panels(figure)


def test_many_examples_are_thinned_out_and_it_is_said() -> None:
    box = JointLimits.from_bounds(["a", "b"], [0, 0], [1, 1])
    figure = figure_of(np.random.default_rng(0).uniform(0, 1, (9000, 2)), box)
    assert len(scatter_panels(figure)[0].collections[0].get_offsets()) == 3000
    assert "one in 3 is drawn" in legend_text(figure)


@pytest.mark.parametrize("count", [2, 7])
def test_names_and_numbers_stay_on_the_figure_and_apart(count: int) -> None:
    """Whatever they are: dollar signs are no mathematics, long names are broken at underscores."""
    names = [f"left_arm_shoulder_{joint}_joint_$x$" for joint in range(count)]
    figure = random_figure(names, [-2.345] * count, [1.234] * count, ("prismatic",) * count)
    figure.draw_without_rendering()
    whole = figure.bbox
    across = [axes.xaxis.label.get_window_extent() for axes in figure.axes if axes.get_xlabel()]
    up = [axes.yaxis.label.get_window_extent() for axes in figure.axes if axes.get_ylabel()]
    assert all(whole.x0 <= box.x0 and whole.y0 <= box.y0 for box in (*across, *up))
    numbers = [
        text.get_window_extent()
        for axes in figure.axes
        if axes.get_xlabel()
        for text in axes.get_xticklabels()
        if text.get_visible()
    ]
    for boxes in (across, up, numbers):
        assert not any(first.overlaps(second) for first, second in combinations(boxes, 2))
