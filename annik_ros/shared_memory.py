"""Files of shared memory that a process left half made when it was killed. Needs no ROS.

Fast DDS, the default middleware, keeps a file in ``/dev/shm`` for each port, which whoever comes
first makes. The others wait until it is made: without end and without a word if its maker was
killed meanwhile, and Ctrl-C does not reach them.
"""

import os
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

FOLDER: Final = Path("/dev/shm")
_PORT: Final = re.compile(r"fastrtps_port(\d+)")
#: Of the first port of domain 0, and between two domains (DDSI-RTPS 2.5, 9.6.2.3).
_FIRST, _PER_DOMAIN = 7400, 250
#: The first number of a file that is not made yet.
_UNMADE: Final = (0, 1)
#: After which it will never be made [s]; to make one takes a millisecond.
_PATIENCE: Final = 1.0


@dataclass(frozen=True)
class HalfMade:
    """A file that was half made, and whether it could be removed."""

    path: Path
    removed: bool

    def __str__(self) -> str:
        """One line, with what is left to do."""
        if self.removed:
            return f"removed {self.path}, which a process that was killed had left half made"
        return (
            f"{self.path} was left half made by a process that was killed: nodes that open it "
            f"wait for ever; as its owner, rm {self.path}"
        )


def own_domain() -> int:
    """The ROS domain of this process; 0 if its number is none, which rclpy refuses."""
    number = os.environ.get("ROS_DOMAIN_ID", "")
    return int(number) if number.isdecimal() else 0


def remove_half_made(domain: int, folder: Path = FOLDER) -> list[HalfMade]:
    """Remove the files of a ROS domain that nobody can use: see above.

    Takes a second if there is one that may still be in the making.
    """
    return [
        HalfMade(path, _remove(path))
        for path in _ports(domain, folder)
        if not _is_made_in_time(path)
    ]


def _ports(domain: int, folder: Path) -> list[Path]:
    try:
        found = [match for match in map(_PORT.fullmatch, os.listdir(folder)) if match]
    except OSError:  # not on this system
        return []
    first = _FIRST + _PER_DOMAIN * domain
    own = range(first, first + _PER_DOMAIN)
    return sorted(folder / match[0] for match in found if int(match[1]) in own)


def _is_made_in_time(path: Path) -> bool:
    """Also if it is gone, or not for this user to read."""
    deadline = time.monotonic() + _PATIENCE
    try:
        if time.time() - path.stat().st_mtime > _PATIENCE:
            deadline = 0.0
        while not _is_made(path):
            if time.monotonic() > deadline:
                return False
            time.sleep(0.05)
    except OSError:
        pass
    return True


def _is_made(path: Path) -> bool:
    with path.open("rb") as file:
        first = file.read(4)
    return len(first) == 4 and int.from_bytes(first, sys.byteorder) not in _UNMADE


def _remove(path: Path) -> bool:
    try:
        path.unlink()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True
