"""Known distances between fixed points beside those that the arm itself tells."""

from typing import NamedTuple

import numpy as np

from annik_training.calibration.errors import OtherDistance
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.observations import DISTANCE_SIGMA, Observations

#: A known distance that is further from what the arm tells is another one: by so much [m], and
#: this part of it, and so many standard deviations.
_OTHER, _PART, _CERTAIN = 3e-3, 0.02, 6.0
#: Where it is doubtful: by so much [m] and so many standard deviations.
_DOUBTFUL, _LIKELY = 1e-3, 4.0


class FoundDistance(NamedTuple):
    """A known distance between two fixed points, and what the arm tells without it."""

    first: int  #: row of ``frames.points``
    second: int
    known: float  #: [m]
    found: float  #: [m]
    deviation: float  #: standard deviation of what was found [m]

    @property
    def is_doubtful(self) -> bool:
        """Whether the arm's errors hardly explain the difference."""
        return abs(self.found - self.known) > max(_DOUBTFUL, _LIKELY * self.deviation)

    @property
    def is_another(self) -> bool:
        """Whether no errors of an arm explain the difference: it is not used."""
        explained = _OTHER + _PART * min(self.known, self.found)
        return abs(self.found - self.known) > max(explained, _CERTAIN * self.deviation)


def found_distances(fitted: Estimate, observations: Observations) -> tuple[FoundDistance, ...]:
    """The known distances of observations beside those of a fit without them.

    Raises:
        OtherDistance: if most of them are other ones than the arm tells.
    """
    unknowns = fitted.unknowns
    known = np.array([metres for *_, metres in observations.distances])
    found = known + DISTANCE_SIGMA * observations.distance_residuals(unknowns)
    by_unknowns = DISTANCE_SIGMA * observations.distance_derivatives(unknowns)
    deviations = np.linalg.norm(by_unknowns @ fitted.root[fitted.model.size :], axis=1)
    both = tuple(
        FoundDistance(*pair, *numbers)
        for (*pair, _), *numbers in zip(
            observations.distances,
            known.tolist(),
            found.tolist(),
            deviations.tolist(),
            strict=True,
        )
    )
    others = [one for one in both if one.is_another]
    if 2 * len(others) > len(both):
        medians = np.median([(one.known, one.found) for one in others], axis=0)
        raise OtherDistance(*medians.tolist())
    return both
