"""What tests of the training share."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

import pytest

if not find_spec("torch"):
    collect_ignore_glob = ["*"]


@pytest.fixture
def one_thread() -> Iterator[None]:
    """What the fit sees to by itself: to share out small matrices takes longer than they do."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
