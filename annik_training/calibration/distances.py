"""Known distances between fixed points beside those that the arm itself tells."""

from typing import NamedTuple

import numpy as np

from annik_training.calibration.errors import OtherDistance
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.observations import DISTANCE_SIGMA, Observations

#: A known distance that is further from what the arm tells is another one: by so much [m], and
#: this part of it, and so many standard deviations.
_OTHER, _PART, _CERTAIN = 4e-3, 0.02, 6.0
#: Where it is doubtful: by so much [m] and so many standard deviations.
_DOUBTFUL, _LIKELY = 1e-3, 4.0


class FoundDistance(NamedTuple):
    """A known distance, and what the arm tells without it."""

    known: float  #: [m]
    found: float  #: [m]
    deviation: float  #: standard deviation of what was found [m]

    @property
    def is_doubtful(self) -> bool:
        """Whether the arm's errors hardly explain the difference."""
        return abs(self.found - self.known) > max(_DOUBTFUL, _LIKELY * self.deviation)


def found_distances(fitted: Estimate, observations: Observations) -> tuple[FoundDistance, ...]:
    """The known distances of observations beside those of a fit without them.

    Raises:
        OtherDistance: if most of them differ by more than any error of an arm.
    """
    unknowns = fitted.unknowns
    known = np.array([metres for *_, metres in observations.distances])
    found = known + DISTANCE_SIGMA * observations.distance_residuals(unknowns)
    by_unknowns = DISTANCE_SIGMA * observations.distance_derivatives(unknowns)
    deviations = np.linalg.norm(by_unknowns @ fitted.root[fitted.model.size :], axis=1)
    largest = np.maximum(_OTHER + _PART * np.minimum(known, found), _CERTAIN * deviations)
    other = np.abs(found - known) > largest
    if 2 * other.sum() > len(known):
        raise OtherDistance(float(np.median(known[other])), float(np.median(found[other])))
    return tuple(
        FoundDistance(*one)
        for one in zip(known.tolist(), found.tolist(), deviations.tolist(), strict=True)
    )
