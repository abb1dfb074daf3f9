"""The report of a calibration: a page and tables that say what they were given. ROS-free."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from annik_core.errors import NotWritable
from annik_core.robots.library import load_robot
from annik_training.calibration.calibrate import CalibrationOptions, calibrate
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import Part
from annik_training.cli.calibration_report import (
    CalibrationReport,
    Parameter,
    calibration_report,
    write_calibration_report,
)

UR5E = load_robot("ur5e")


def report() -> CalibrationReport:
    rng = np.random.default_rng(0)
    outliers = np.zeros(30, dtype=np.bool_)
    outliers[7] = True
    return CalibrationReport(
        UR5E,
        UR5E.joint_box.sample(30, rng),
        rng.uniform(1e-3, 2e-3, 30),
        np.where(outliers, 0.05, rng.uniform(1e-4, 2e-4, 30)),
        outliers,
        tuple(f"<poses>.csv, line {line}" for line in range(2, 32)),
        (
            Parameter("elbow_joint: zero", math.radians(0.25), math.radians(0.01), True, True),
            Parameter("elbow_joint: offset", 1e-3, 9e-4, False, False),
        ),
        UR5E.joint_box.sample(10, rng),
        notes=("a note",),
    )


def test_a_page_and_two_tables(tmp_path: Path) -> None:
    write_calibration_report(report(), tmp_path / "new")
    page = (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    assert "&lt;poses&gt;.csv, line 9" in page
    assert "0.2500 ± 0.0100 degrees" in page
    assert "1.0000 ± 0.9000 mm" in page
    assert "a note" in page
    assert report().unidentified == {"elbow_joint": ["offset"]}
    with (tmp_path / "new" / "residuals.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["outlier"] for row in rows].index("1") == 7
    assert len(rows) == 30
    following = np.loadtxt(tmp_path / "new" / "next_configurations.csv", delimiter=",", skiprows=1)
    assert np.array_equal(following, report().following)


def test_regions_are_parts_of_what_was_measured() -> None:
    regions = list(report().regions())
    of_elbow = [region for region in regions if region[0] == "elbow_joint"]
    assert sum(rows for _, _, rows, _, _ in of_elbow) == 29
    assert all(after < 3e-4 < before for *_, before, after in regions)


def with_ball_at(point: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Joint positions with the flange of the arm as described at a point."""
    kinematics, box = UR5E.forward_kinematics, UR5E.joint_box
    found = box.sample(500, rng)
    for _ in range(40):
        away = point - kinematics.poses(found)[:, :3]
        steps = np.linalg.pinv(kinematics.jacobians(found)[:, :3]) @ away[..., np.newaxis]
        found = found + np.clip(steps[..., 0], -0.2, 0.2)
    there = np.linalg.norm(kinematics.poses(found)[:, :3] - point, axis=1) < 1e-9
    inside = ((found > box.lower) & (found < box.upper)).all(axis=1)
    return found[there & inside][:count]


def test_what_to_measure_next_with_sockets_has_the_ball_in_one() -> None:
    rng = np.random.default_rng(0)
    points = np.array([[0.4, 0.1, 0.2], [0.45, 0.1, 0.2], [0.2, -0.4, 0.3], [0.25, -0.4, 0.3]])
    rows = np.concatenate([with_ball_at(point, 12, rng) for point in points])
    measurements = Measurements(
        rows,
        fixed_points=np.repeat(np.arange(4), 12),
        distances=[KnownDistance(0, 1, 0.05), KnownDistance(2, 3, 0.05)],
    )
    options = CalibrationOptions(candidates=(frozenset({Part.GEOMETRY}),))
    calibrated = calibrate(UR5E, measurements, options)
    places = [f"hole_{row // 12}.csv, line {row % 12 + 1}" for row in range(48)]
    made = calibration_report(calibrated, places)
    assert len(made.following) == len(made.sockets) == 10
    reached = UR5E.forward_kinematics.poses(made.following)[:, :3]
    for position, socket in zip(reached, made.sockets, strict=True):
        point = points[int(socket.removeprefix("hole_").removesuffix(".csv"))]
        assert np.linalg.norm(position - point) < 2e-3
    assert "base" in made.unidentified or "shoulder_pan_joint" in made.unidentified


def test_a_folder_that_can_not_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NotWritable):
        write_calibration_report(report(), tmp_path / "file" / "out")
