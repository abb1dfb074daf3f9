"""What tests of every part share."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, settings

from annik_core.robot import Robot
from annik_core.robot_library import load_robot

# A loaded machine is slow, not wrong; and the gantry is frozen, so that examples may share it.
settings.register_profile(
    "annik", deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
settings.load_profile("annik")


@pytest.fixture(scope="session")
def gantry() -> Robot:
    """The paper's robot."""
    return load_robot("gantry")
