"""What tests of bags and reports share."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from support.robot_recording import RobotRecording


@pytest.fixture
def recording() -> Callable[..., RobotRecording]:
    """The maker of recordings."""
    return RobotRecording
