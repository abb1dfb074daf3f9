"""The keys that the nodes report on /diagnostics, with their meaning. Needs no ROS.

For the documentation, and for the test that compares the reports with it.
"""

from __future__ import annotations

from annik_core.serving.statistics import LEAST_RATE, MANY

_COUNTS = {
    "{what}s received": "since the configuration; exactly the sum of accepted and refused",
    "{what}s accepted": "used",
    "{what}s refused": "not used",
    "refused: REASON": "refused for this reason; listed once it has occurred",
}
_LAST = {
    "{what} rate [Hz]": "received in the last second",
    "last refusal": "the reason in one line, with the value and what is allowed",
}


def _of(what: str, values: dict[str, str]) -> dict[str, str]:
    return {key.format(what=what): meaning for key, meaning in values.items()}


_JOINT_STATES = {
    "joint states received": "since the configuration, usable or not",
    "joint states of other joints": "of these, those that name no joint of the robot",
    "joint states unusable: FAULT": "of these, those with a malformed message, not one position "
    "per name, a joint named twice or a position not finite; listed once it has occurred",
    "measured joint positions": "known, or why not",
}

#: Key to meaning, by node.
DIAGNOSTIC_VALUES: dict[str, dict[str, str]] = {
    "ik_node": {
        "state": "of the life cycle",
        "callback errors": "unexpected errors, after which the node continued; please report "
        "them. The following keys exist once a model is loaded",
        "model": "path of the file",
        "model sha256": "first digits of its SHA-256",
        "model quality": "what it solves of random poses, by its evaluation; and what makes it "
        "poor",
        "robot": "its name",
        "mode": "network, refined or whole_robot",
        "task": "pose, position_and_axis or position: what of a target must be reached",
        "forward kinematics": "as described, or learned from how many measured poses: those of "
        "the residuals",
        **_JOINT_STATES,
        "solve time p50 [us]": "time to solve a target, of the last thousand: median",
        "solve time p99 [us]": "99th percentile",
        "solve time max [us]": "longest",
        "latency p50 [us]": "time from receiving a target to publishing its command, of the last "
        "thousand accepted: median",
        "latency p99 [us]": "99th percentile",
        "latency max [us]": "longest",
        "expected error p50 [mm]": "of a calibrated robot: expected position errors of the last "
        "thousand accepted: median",
        "expected error p99 [mm]": "99th percentile",
        "expected error max [mm]": "greatest",
        "solutions requested": "how often all solutions of a pose were asked for on "
        "solutions_target",
        "solutions found": "how many that were together",
        **_of("target", _COUNTS),
        "expected target rate [Hz]": "the parameter expected_rate, if it is not 0",
        **_of("target", _LAST),
    },
    "fake_robot": {
        "robot": "its name",
        "robot definition sha256": "first digits of its SHA-256",
        "accepted targets ignored": "for an invalid stamp or pose",
        "targets without command": "waiting for their command",
        "commands without target": "waiting for their target",
        "partners given up": "targets and commands that waited too long",
        "measurements published": "on measured_pose",
        "measurements dropped": "lost measurements of an imperfect arm",
        **_of("command", _COUNTS),
        **_of("command", _LAST),
    },
    "example_collector": {
        "robot": "its name",
        "robot definition sha256": "first digits of its SHA-256",
        "phase": "present activity",
        "examples planned": "rows of the plan",
        "examples measured": "in the journal, by this run and previous ones",
        "rows measured": "which rows of the plan those are, such as 0-4, 7",
        "examples failed": "failed attempts; each example is visited again after all others",
        "examples skipped": "that can't be reached inside the workspace box",
        "measurements repeated": "that were refused",
        "time left [s]": "at the mean rate so far; empty before the first example",
        **_JOINT_STATES,
        **_of("pose", _COUNTS),
        **_of("pose", _LAST),
    },
}

#: The conditions of the levels above OK.
LEVELS = {
    "WARN": f"something was refused in the last second, fewer than {LEAST_RATE:.0%} of "
    "expected_rate came, or other nodes publish joint_command too",
    "ERROR": f"{MANY} or more were refused in the last second and none accepted, or expected_rate "
    "is set and nothing came",
}
