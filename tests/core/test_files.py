"""Folders are checked before long work. ROS-free."""

from __future__ import annotations

from pathlib import Path

import pytest

from annik_core.errors import NotWritable
from annik_core.files import ensure_writable_folder


def test_a_folder_is_made_and_left_empty(tmp_path: Path) -> None:
    """With those above it, and once more where it is already."""
    folder = tmp_path / "one" / "two"
    for _ in range(2):
        ensure_writable_folder(folder)
        assert list(folder.iterdir()) == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NotWritable) as caught:
        ensure_writable_folder(tmp_path / "file" / "folder")
    assert caught.value.path == tmp_path / "file" / "folder"
