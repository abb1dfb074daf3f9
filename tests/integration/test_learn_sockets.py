"""``./run learn --sockets``: what the simulated person records, and what is compared."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_training.calibration.measurement_files import read_sockets
from examples.learn_sockets import (
    InSockets,
    comparison,
    errors_of_path,
    guided_positions,
    real_kinematics,
    record,
    simulated_arm,
    write_arm,
)

PLACE = (0.45, 0.15, 0.05, 0.0)
ROWS = 4


@pytest.mark.slow
def test_a_person_guides_the_ball_into_both_sockets(tmp_path: Path) -> None:
    """Over DDS, by ``fake_robot`` and ``example_collector``; the real ball is where it was put."""
    arm = write_arm(tmp_path)
    (tmp_path / "logs").mkdir()
    record(tmp_path / "sockets", tmp_path / "logs", arm, simulated_arm(arm), [PLACE], ROWS)
    robot = load_robot(arm)
    read = read_sockets(robot, [tmp_path / "sockets"])
    assert read.sockets is not None
    real, described = real_kinematics(robot), robot.forward_kinematics
    for hole, place in enumerate(([0.45, 0.15, 0.05], [0.50, 0.15, 0.05])):
        own = read.joint_positions[[socket == hole for _, socket in read.sockets]]
        assert len(np.unique(own, axis=0)) == ROWS
        assert np.abs(real.poses(own)[:, :3] - place).max() < 2e-4
        assert np.abs(described.poses(own)[:, :3] - place).max() > 1e-3


def test_a_socket_is_reached_in_ways_that_differ(tmp_path: Path) -> None:
    robot = load_robot(write_arm(tmp_path))
    found = guided_positions(robot, np.array(PLACE[:3]), 50, seed=1)
    assert robot.joint_box.contains(found)
    assert (np.ptp(found, axis=0) > 0.2).all()
    spread = InSockets.of(robot, [found, found + 0.0])
    assert spread.away.shape == (100,)
    assert spread.apart == 0.0
    assert spread.away.mean() > 5e-4


def test_a_path_is_compared_after_its_best_motion() -> None:
    """A robot whose base is elsewhere misses nothing; one that is too long does."""
    rng = np.random.default_rng(0)
    targets = rng.normal(size=(30, 3))
    turn = Rotation.from_rotvec([0.1, 0.2, -0.3])

    def errors(achieved: FloatArray) -> FloatArray:
        pairs = [
            SimpleNamespace(target=tuple(target), achieved=tuple(there))
            for target, there in zip(targets, achieved, strict=True)
        ]
        return errors_of_path(SimpleNamespace(targets=pairs))  # type: ignore[arg-type]

    assert errors(turn.apply(targets) + np.array([1.0, 2.0, 3.0])).max() < 1e-12
    longer = errors(1.001 * turn.apply(targets))
    centre = targets.mean(axis=0)
    assert np.allclose(longer, 1e-3 * np.linalg.norm(targets - centre, axis=1))
    held = InSockets(longer, 0.05)
    assert comparison({"nominal": (held, longer), "learned": (held, longer)}).startswith(
        b"\x89PNG"
    )
