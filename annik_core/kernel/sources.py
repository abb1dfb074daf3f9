"""From which sources a kernel is compiled. ``setup.py`` reads this file too, before any import."""

import hashlib
from pathlib import Path


def sources_hash(folder: Path) -> str:
    """SHA-256 of the C++ sources of the kernel in a folder, or nothing if none are there."""
    sources = sorted(folder.glob("*.[ch]pp"))
    content = b"".join(path.read_bytes() for path in sources)
    return hashlib.sha256(content).hexdigest() if sources else ""
