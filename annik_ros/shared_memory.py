"""Files of shared memory that a process left half made when it was killed. Needs no ROS.

Fast DDS, the default middleware, keeps files in ``/dev/shm``, one for each port, which whoever
comes first makes. The others wait until it is made: without end and without a word if its maker
was killed meanwhile, and Ctrl-C does not reach them.
"""

import fcntl
import os
import re
import stat
import sys
import time
from pathlib import Path
from typing import Final

FOLDER: Final = Path("/dev/shm")
_PORT: Final = re.compile(r"fastrtps_port(\d+)", re.ASCII)
#: Of domain 0, and between two domains (DDSI-RTPS 2.5, 9.6.2.3); those before are of all domains.
_FIRST, _PER_DOMAIN = 7400, 250
_OF_ALL: Final = range(7000, _FIRST)
#: The first number of a file that is not made yet.
_UNMADE: Final = (0, 1)
#: After which it will never be made [s]; to make one takes a millisecond.
_PATIENCE: Final = 1.0
#: What C takes for a number: of base 16, 8 or 10.
_NUMBER: Final = re.compile(r"\s*\+?(0[xX][0-9a-fA-F]{1,8}|0[0-7]{0,9}|[1-9]\d{0,8})", re.ASCII)


def own_domain() -> int:
    """The ROS domain of this process, as ROS reads it; 0 if that is no number."""
    number = _NUMBER.match(os.environ.get("ROS_DOMAIN_ID", ""))
    if number is None:
        return 0
    digits = number[1].lower()
    return int(digits, 16 if digits.startswith("0x") else 8 if digits.startswith("0") else 10)


def remove_half_made(domain: int, folder: Path = FOLDER) -> list[str]:
    """Remove the files that hold nodes of a ROS domain up: see above.

    Waits for those that may still be in the making: a second, at most.

    Returns:
        A line for each, for people.
    """
    deadline = time.monotonic() + _PATIENCE
    return [
        f"removed {path}, which a process that was killed had left half made"
        for path in _ports(domain, folder)
        if _is_removed(path, deadline)
    ]


def _ports(domain: int, folder: Path) -> list[Path]:
    try:
        found = [match for match in map(_PORT.fullmatch, os.listdir(folder)) if match]
    except OSError:  # not on this system
        return []
    first = _FIRST + _PER_DOMAIN * domain
    own = range(first, first + _PER_DOMAIN)
    return sorted(
        folder / match[0] for match in found if int(match[1]) in own or int(match[1]) in _OF_ALL
    )


def _is_removed(path: Path, deadline: float) -> bool:
    """Whether it was half made and could be removed; waits until it is made or too old."""
    # Nobody waits for a file of another user: it can't be opened for writing.
    if not os.access(path, os.W_OK, follow_symlinks=False):
        return False
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            return False
        while not _is_made(descriptor):
            if time.time() - status.st_mtime > _PATIENCE or time.monotonic() > deadline:
                # One of several nodes that start now; the file may be another one since.
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                if not _is_made(descriptor) and path.lstat().st_ino == status.st_ino:
                    path.unlink()
                    return True
                return False
            time.sleep(0.05)
    except OSError:
        pass
    finally:
        os.close(descriptor)
    return False


def _is_made(descriptor: int) -> bool:
    first = os.pread(descriptor, 4, 0)
    return len(first) == 4 and int.from_bytes(first, sys.byteorder) not in _UNMADE
