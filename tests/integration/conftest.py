"""What the tests over real DDS share."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.ros_processes import client, domain, launch, make_client, other_robots_model

__all__ = ["client", "domain", "launch", "make_client", "other_robots_model"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test of this folder as one that needs ROS."""
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.ros)
