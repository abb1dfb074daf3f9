"""Before and after, in one figure."""

from __future__ import annotations

import io

import numpy as np

from annik_training.measured.evaluate_measured import REGIONS, MeasuredEvaluation

_MILLIMETRE = 1e3
_THIRDS = ("lower", "middle", "upper")
_MARKERS = "<o>"


def before_and_after(evaluation: MeasuredEvaluation) -> bytes:
    """A PNG: the error of every held-out pose, sorted, and the mean by joint and region."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    curves, regions = figure.subplots(1, 2)
    share = 100 * (np.arange(len(evaluation.dataset)) + 1) / len(evaluation.dataset)
    for label, errors, style in (
        ("nominal model", evaluation.before.distances, "tab:red"),
        ("learned model", evaluation.after.distances, "tab:blue"),
    ):
        ordered = _MILLIMETRE * np.sort(errors)
        curves.plot(share, ordered, color=style, label=f"{label}: mean {ordered.mean():.3g} mm")
    bound = _MILLIMETRE * np.sort(evaluation.bounds_of_measurements[:, 0])
    curves.plot(share, bound, color="tab:blue", linestyle=":", label="its stated 95 % bound")
    curves.set_yscale("log")
    curves.set_xlabel("held-out poses [%]")
    curves.set_ylabel("position error [mm]")
    curves.set_title(f"{len(evaluation.dataset)} poses that were not learned from")
    curves.grid(visible=True, which="both", alpha=0.3)
    curves.legend()
    joints = list(dict.fromkeys(region.joint for region in evaluation.regions))
    for shade, marker in enumerate(_MARKERS):
        rows = evaluation.regions[shade::REGIONS]
        places = np.arange(len(joints)) + 0.2 * (shade - 1)
        for label, colour, values in (
            ("nominal", "tab:red", [region.before for region in rows]),
            ("learned", "tab:blue", [region.after for region in rows]),
        ):
            regions.plot(
                _MILLIMETRE * np.array(values),
                places,
                marker,
                color=colour,
                label=f"{label}, {_THIRDS[shade]} third",
            )
    regions.set_xscale("log")
    regions.set_yticks(range(len(joints)), joints)
    regions.invert_yaxis()
    regions.set_xlabel("mean position error [mm]")
    regions.set_title("by joint and part of its working box")
    regions.grid(visible=True, axis="x", which="both", alpha=0.3)
    regions.legend(loc="center")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()
