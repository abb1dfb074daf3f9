"""Accepted targets are matched with the sent ones by pose and order. ROS-free."""

from __future__ import annotations

import numpy as np

from msg_tools.report.matching import TargetMatches, TimedPose, match_targets


def pose(letter: str, time_ns: int) -> TimedPose:
    return TimedPose("/target_pose", time_ns, np.array([ord(letter), 0, 0, 0, 0, 0, 1.0]))


def test_a_skipped_target_that_is_taken_does_not_turn_the_order_back() -> None:
    """A overtook B; what was sent between them was still skipped."""
    sent = [pose("A", 10), pose("C", 15), pose("B", 20), pose("C", 40)]
    accepted = [pose("B", 100), pose("A", 110), pose("C", 120)]
    assert match_targets(sent, accepted) == TargetMatches([2, 0, 3], frozenset())
