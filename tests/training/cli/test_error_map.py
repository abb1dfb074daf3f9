"""The map of the error: a picture of any robot, also where there is little to show. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from annik_core.robots.library import load_robot
from annik_training.cli import plots
from annik_training.designs.registry import random_dataset
from annik_training.evaluation import NetworkErrors, network_errors


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn, which is quicker coarse."""
    drawn: list[Figure] = []

    class Kept(Figure):
        def __init__(self, **arguments: object) -> None:
            super().__init__(**arguments)
            drawn.append(self)

    monkeypatch.setattr(plots, "Figure", Kept)
    return drawn


def error_map(errors: NetworkErrors) -> bytes:
    return plots.error_map(errors, dots_per_inch=30)


def measured(name: str, poses: int, off: float) -> NetworkErrors:
    """Answers that are off by so much at one half of the poses."""
    robot = load_robot(name)
    unseen = random_dataset(robot, robot.joint_box, poses, seed=0)
    answers = unseen.joint_positions.copy()
    answers[: poses // 2] += off
    return network_errors(lambda _: answers, unseen)


def labels(figure: Figure) -> list[str]:
    return [axis.get_xlabel() for axis in figure.axes if axis.axison and axis.get_xlabel()]


def test_of_an_arm_with_failures(figures: list[Figure]) -> None:
    """A panel per joint with a mark for each, the workspace, and how many were not solved."""
    seen = measured("ur5e", 60, 9.0)
    assert seen.refined is not None
    failed = int((~seen.refined.converged).sum())
    assert failed > 0
    assert error_map(seen).startswith(b"\x89PNG")
    (figure,) = figures
    assert figure.get_suptitle().endswith(f"60 random poses; {failed} not solved")
    joints = [f"{name} [deg]" for name in seen.dataset.robot.joint_names]
    assert labels(figure) == [*joints, "distance from the base axis [m]"]
    for axis in figure.axes[:6]:
        (marks,) = [line for line in axis.get_lines() if line.get_label() == "not solved"]
        assert len(marks.get_xdata()) == failed


def test_of_an_arm_without_failures(figures: list[Figure]) -> None:
    """The prismatic joint in metres; a locked joint has no panel."""
    seen = measured("scara", 40, 1e-3)
    assert error_map(seen).startswith(b"\x89PNG")
    (figure,) = figures
    assert "0 not solved" in figure.get_suptitle()
    assert labels(figure)[2] == "joint3 [m]"
    assert all(line.get_label() != "not solved" for line in figure.axes[0].get_lines())


def test_of_the_gantry_which_is_not_refined(figures: list[Figure]) -> None:
    assert error_map(measured("gantry", 40, 1e-3)).startswith(b"\x89PNG")
    (figure,) = figures
    assert "solved" not in figure.get_suptitle()


def test_of_two_poses_most_bins_are_empty(figures: list[Figure]) -> None:
    """And the answers are exact, though the scale is a logarithm; and no locked joint."""
    assert error_map(measured("panda", 2, 0.0)).startswith(b"\x89PNG")
    (figure,) = figures
    assert "panda_joint3 [deg]" not in labels(figure)
    assert len(labels(figure)) == 7


def test_the_lines_are_the_percentiles_of_the_bins(figures: list[Figure]) -> None:
    """The error is 1 mm below the middle of a joint's box, and 3 mm above it."""
    robot = load_robot("scara")
    unseen = random_dataset(robot, robot.joint_box, 300, seed=0)
    upper = unseen.joint_positions[:, 2] > robot.joint_box.centre[2]
    answers = unseen.joint_positions.copy()
    answers[:, 2] += np.where(upper, -3e-3, 1e-3)
    error_map(network_errors(lambda _: answers, unseen))
    median = figures[0].axes[2].get_lines()[0]
    assert median.get_label() == "median"
    positions, errors_mm = median.get_data()
    assert len(positions) == 15
    assert errors_mm[positions < 0.09] == pytest.approx(1.0)
    assert errors_mm[positions > 0.12] == pytest.approx(3.0)
