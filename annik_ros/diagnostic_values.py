"""What the nodes report on /diagnostics, key by key. Needs no ROS.

For the documentation, and for the test that holds the nodes to it.
"""

from __future__ import annotations

#: Less than this part of the expected rate is a warning.
LEAST_RATE = 0.8
#: So many refused in a period, and none accepted, is an error.
MANY = 10

_COUNTS = {
    "{what}s received": "since the configuration; accepted and refused add up to it, exactly",
    "{what}s accepted": "acted on",
    "{what}s refused": "not acted on",
    "refused: REASON": "refused for this reason; only reasons that occurred",
}
_LAST = {
    "{what} rate [Hz]": "received in the last second",
    "last refusal": "why, in one line, with the value and what is allowed",
}


def _of(what: str, values: dict[str, str]) -> dict[str, str]:
    return {key.format(what=what): meaning for key, meaning in values.items()}


#: Key to meaning, by node.
DIAGNOSTIC_VALUES: dict[str, dict[str, str]] = {
    "ik_node": {
        "state": "of the life cycle",
        "callback errors": "that nobody foresaw, after which the node went on; please report "
        "them. What follows here is there once a model is loaded",
        "model": "path of the file",
        "model sha256": "first digits of its SHA-256",
        "robot": "its name",
        "mode": "network or refined",
        "forward kinematics": "as described, or learned from how many measured poses: the "
        "residuals are by these",
        "solve time p50 [us]": "time to answer a target, the last thousand: median",
        "solve time p99 [us]": "99th percentile",
        "solve time max [us]": "longest",
        "latency p50 [us]": "time from taking up a target to its command, the last thousand "
        "accepted: median",
        "latency p99 [us]": "99th percentile",
        "latency max [us]": "longest",
        "expected error p50 [mm]": "of a learned model: expected position errors of the last "
        "thousand accepted: median",
        "expected error p99 [mm]": "99th percentile",
        "expected error max [mm]": "greatest",
        **_of("target", _COUNTS),
        "expected target rate [Hz]": "the parameter expected_rate, if it is set",
        **_of("target", _LAST),
    },
    "fake_robot": {
        "robot": "its name",
        "robot definition sha256": "first digits of its SHA-256",
        "accepted targets ignored": "that could not be paired, for an impossible stamp or pose",
        "targets without command": "that wait for their command",
        "commands without target": "that wait for their target",
        "partners given up": "that waited too long",
        "measurements published": "on measured_pose",
        "measurements dropped": "of an imperfect arm, on purpose",
        **_of("command", _COUNTS),
        **_of("command", _LAST),
    },
    "example_collector": {
        "robot": "its name",
        "robot definition sha256": "first digits of its SHA-256",
        "phase": "what it is doing",
        "examples planned": "rows of the plan",
        "examples measured": "that are in the journal, of this run and of those before",
        "examples failed": "attempts that failed; each is tried again after all others",
        "examples skipped": "that can't be gone to inside the workspace box",
        "measurements repeated": "that were refused and made again",
        "time left [s]": "at the pace so far; empty before the first example",
        **_of("pose", _COUNTS),
        **_of("pose", _LAST),
    },
}

#: When a report is more than OK.
LEVELS = {
    "WARN": f"something was refused in the last second, or fewer than {LEAST_RATE:.0%} of "
    "expected_rate came",
    "ERROR": f"{MANY} or more were refused in the last second and none accepted, or expected_rate "
    "is set and nothing came",
}
