"""What the tests over real DDS share."""

from __future__ import annotations

from importlib.util import find_spec

if find_spec("rclpy"):
    from support.client import client, make_client
    from support.nodes import domain, launch, other_robots_model

    __all__ = ["client", "domain", "launch", "make_client", "other_robots_model"]
else:
    collect_ignore_glob = ["*"]
