"""At most once in a while."""

from __future__ import annotations

import pytest

from annik_ros import throttle
from annik_ros.throttle import Throttle


def test_it_is_due_at_first_and_then_once_a_period(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(throttle.time, "monotonic", lambda: now)
    warning = Throttle(1.0)
    due = []
    for now in (100.0, 100.0, 100.9, 101.0, 101.5, 150.0, 150.0):  # noqa: B007
        due.append(warning.is_due())  # noqa: PERF401
    assert due == [True, False, False, True, False, True, False]
