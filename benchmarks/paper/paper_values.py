"""The figures that the paper prints, with its slips undone. Millimetres."""

from __future__ import annotations

from collections.abc import Mapping

#: The two ways of choosing examples: the paper's, and the one that it compares with.
METHODS = ("thirty_phase", "known")
METHOD_TITLES: Mapping[str, str] = {
    "thirty_phase": "thirty phases (PrM)",
    "known": "workspace grid (KnM)",
}
SETS = ("set1", "set2", "set3")
SET_TITLES: Mapping[str, str] = {"set1": "Set 1", "set2": "Set 2", "set3": "Set 3"}

#: Numbers of examples: Table 7 and section 2.
COUNTS: Mapping[str, Mapping[str, int]] = {
    "thirty_phase": {"set1": 104, "set2": 194, "set3": 448, "section2": 382},
    "known": {"set1": 108, "set2": 256, "set3": 448, "section2": 375},
}

#: Table 4: mean square error of the four networks of a cross-validation, in the units of F.
TABLE_4: Mapping[str, tuple[float, ...]] = {
    "thirty_phase": (2.25e-4, 1.83e-4, 2.39e-4, 1.93e-4),
    "known": (8.37e-2, 8.34e-2, 8.45e-2, 7.88e-2),
}

#: Table 9: position error [mm] at the points of the path, from the first one on. What stands
#: beside point n belongs to point n + 1, and what stands in the header to point 1; the table ends
#: at the ninth (in two columns at the eighth) of 15 points.
TABLE_9: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    "thirty_phase": {
        "set1": (0.0833, 0.2298, 0.3284, 0.4247, 0.5645, 0.7743, 1.0592, 1.4172, 1.8491),
        "set2": (0.0015, 0.0093, 0.0102, 0.0105, 0.0144, 0.0203, 0.0291, 0.0471, 0.0808),
        "set3": (0.0418, 0.0795, 0.0774, 0.0426, 0.0316, 0.0783, 0.0917, 0.0674, 0.0424),
    },
    "known": {
        "set1": (1.4620, 18.6663, 31.9270, 39.0282, 39.9710, 35.3201, 26.4539, 15.9495, 10.3252),
        "set2": (0.1597, 6.0701, 8.5636, 7.7047, 5.9324, 9.6531, 17.6429, 26.2353),
        "set3": (0.0000, 0.0914, 0.0831, 0.0408, 0.0143, 0.0076, 0.0145, 0.0428),
    },
}
#: How many points of the path the paper prints errors for.
PRINTED_POINTS = 9

#: What the paper's conclusions say of the position error [mm] on the whole path.
CONCLUSIONS: Mapping[tuple[str, str], str] = {
    ("thirty_phase", "set2"): "< 1",
    ("thirty_phase", "set3"): "< 0.25",
    ("known", "set2"): "< 39",
    ("known", "set3"): "< 0.1",
}
