"""A log survives what ends its process, and is refused if it was altered. ROS-free."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from annik_core.append_log import AppendLog
from annik_core.errors import DamagedRecord, InUse

RECORDS = ({"a": 1}, {"b": [0.1, None, "x"]}, {})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A log of :data:`RECORDS`, in a folder that did not exist."""
    path = tmp_path / "folder" / "log.jsonl"
    with AppendLog(path) as log:
        for record in RECORDS:
            log.append(record)
    return path


def test_records_are_read_back_and_appended_to(path: Path) -> None:
    with AppendLog(path) as log:
        assert log.records == RECORDS
        assert not log.truncated
        log.append({"c": 2})
        log.reload()
        assert log.records == (*RECORDS, {"c": 2})


def test_a_record_is_on_the_disk_before_append_returns(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not only handed to the operating system, which a loss of power would not survive."""
    at_sync: list[bytes] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: at_sync.append(path.read_bytes()))
    with AppendLog(path) as log:
        log.append({"c": 2})
        assert at_sync[-1] == path.read_bytes()
        assert b'"c": 2' in at_sync[-1]


def test_an_incomplete_last_line_is_removed(path: Path) -> None:
    complete = path.read_bytes()
    path.write_bytes(complete + b'{"c": 2, "chec')
    with AppendLog(path) as log:
        assert log.truncated
        assert log.records == RECORDS
    assert path.read_bytes() == complete


@pytest.mark.parametrize("line", [1, 2, 3])
def test_an_altered_line_is_named_and_kept(path: Path, line: int) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    lines[line - 1] = lines[line - 1].replace(b"{", b'{"z": 0, ', 1)
    path.write_bytes(b"".join(lines))
    with pytest.raises(DamagedRecord) as caught:
        AppendLog(path)
    assert (caught.value.path, caught.value.line) == (path, line)
    assert path.read_bytes() == b"".join(lines)


def test_only_a_header_can_not_be_done_without(path: Path) -> None:
    with AppendLog(path, has_header=True) as log:
        assert "delete this line" not in str(log.damaged(1, "wrong"))
        assert "delete this line" in str(log.damaged(2, "wrong"))


def test_a_log_is_open_once(path: Path) -> None:
    with AppendLog(path), pytest.raises(InUse) as caught:
        AppendLog(path)
    assert caught.value.path == path
    AppendLog(path).close()
