"""Evaluation of a robot whose orientations were not calibrated. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.learned_model import learned_robot

from annik_core.dataset import MEASURED
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration.validation import evaluate_measured
from annik_training.cli.evaluate import evaluation_summary, print_measured
from annik_training.designs.registry import generate_dataset


def _calibrated(position_only: bool) -> Robot:
    definition = dict(learned_robot().definition)
    provenance = {"examples": 102, "position_only": position_only}
    definition["corrections"] = {**definition["corrections"], "provenance": provenance}
    return robot_from_definition(definition, "the test's")


@pytest.mark.parametrize("position_only", [True, False])
def test_orientations_that_were_not_calibrated_are_not_evaluated(
    position_only: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    computed = generate_dataset(load_robot("ur5e"), "sobol", 16, seed=0)
    evaluation = evaluate_measured(_calibrated(position_only), replace(computed, source=MEASURED))
    summary = evaluation_summary(evaluation)
    for value in (
        summary["learned"]["mean_orientation_error"],
        summary["nominal"]["max_orientation_error"],
        summary["orientations_within_bound"],
    ):
        assert (value is None) == position_only
    assert summary["learned"]["mean_position_error"] > 0.0
    print_measured(evaluation, "a model")
    printed = capsys.readouterr().out
    assert ("not calibrated" in printed) == position_only
    assert ("orientation [deg]" in printed) != position_only
