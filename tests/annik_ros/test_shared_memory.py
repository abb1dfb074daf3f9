"""What nodes remove that a killed process left. Without ROS."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from annik_ros.shared_memory import own_domain, remove_half_made

#: First bytes of a file that is made, and of those that are not.
MADE = b"\2\0\0\0"
UNMADE = (b"", b"\2", b"\0\0\0\0" + bytes(100), b"\1\0\0\0" + bytes(100))


def write(path: Path, first: bytes, age: float) -> Path:
    path.write_bytes(first)
    os.utime(path, (time.time() - age,) * 2)
    return path


@pytest.mark.parametrize("first", UNMADE)
@pytest.mark.parametrize("age", [60.0, -60.0], ids=["old", "from the future"])
def test_what_is_half_made_is_removed(tmp_path: Path, first: bytes, age: float) -> None:
    paths = [write(tmp_path / f"fastrtps_port{port}", first, age) for port in (7000, 7913)]
    lines = remove_half_made(2, tmp_path)
    assert all(str(path) in line for path, line in zip(paths, lines, strict=True))
    assert not any(path.exists() for path in paths)


def test_everything_else_stays(tmp_path: Path) -> None:
    """What is in use, what is corrupt, which the middleware itself removes, and other files.

    The last is of another domain.
    """
    kept = [
        write(tmp_path / "fastrtps_port7411", MADE + bytes(100), 60.0),
        write(tmp_path / "fastrtps_port7415", b"\3\0\0\0", 60.0),
        write(tmp_path / "fastrtps_port7413_el", b"", 60.0),
        write(tmp_path / "fastrtps_00f1d81a4c2b3e5f", b"", 60.0),
        write(tmp_path / "port7413", b"", 60.0),
        write(tmp_path / "fastrtps_port7661", b"", 60.0),
    ]
    assert remove_half_made(0, tmp_path) == []
    assert all(path.exists() for path in kept)


@pytest.mark.parametrize(
    ("given", "domain"),
    [
        *(("7", 7), ("0", 0), ("010", 8), ("0x1f", 31), (" 7", 7), ("+7", 7), ("7x", 7)),
        *(("", 0), ("x", 0), ("-1", 0), (None, 0)),
    ],
)
def test_the_domain_is_that_of_the_process(
    monkeypatch: pytest.MonkeyPatch, given: str | None, domain: int
) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    if given is not None:
        monkeypatch.setenv("ROS_DOMAIN_ID", given)
    assert own_domain() == domain


def test_what_is_in_the_making_is_waited_for(tmp_path: Path) -> None:
    path = write(tmp_path / "fastrtps_port7413", b"", 0.0)
    maker = threading.Timer(0.2, lambda: path.write_bytes(MADE))
    maker.start()
    assert remove_half_made(0, tmp_path) == []
    maker.join()
    assert path.exists()


def test_what_is_no_file_stays(tmp_path: Path) -> None:
    """Nor does it hold a node up."""
    os.mkfifo(tmp_path / "fastrtps_port7411")
    (tmp_path / "fastrtps_port7413").mkdir()
    (tmp_path / "fastrtps_port7415").symlink_to(write(tmp_path / "empty", b"", 60.0))
    (tmp_path / "fastrtps_port7417").symlink_to("missing")
    assert remove_half_made(0, tmp_path) == []
    assert len(list(tmp_path.iterdir())) == 5


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_the_file_of_another_user_stays(tmp_path: Path) -> None:
    path = write(tmp_path / "fastrtps_port7413", b"", 60.0)
    path.chmod(0o444)
    assert remove_half_made(0, tmp_path) == []


def test_a_system_without_such_a_folder_has_none(tmp_path: Path) -> None:
    assert remove_half_made(0, tmp_path / "none") == []
