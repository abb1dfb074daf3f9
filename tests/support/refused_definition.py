"""What every refusal of a robot definition has to say."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from annik_core.robots.errors import InvalidRobotDefinition


def refused_definition(read: Callable[[], object], *named: str) -> InvalidRobotDefinition:
    """The refusal; every one of these names, words and values must be in its problem."""
    with pytest.raises(InvalidRobotDefinition) as caught:
        read()
    assert all(word in caught.value.problem for word in named), caught.value.problem
    return caught.value
