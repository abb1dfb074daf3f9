"""Before and after, in one figure."""

from __future__ import annotations

import io

import numpy as np

from annik_training.measured.evaluate_measured import REGIONS, MeasuredEvaluation

_MILLIMETRE = 1e3


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
    bound = _MILLIMETRE * np.sort(evaluation.bounds[:, 0])
    curves.plot(
        share, bound, color="tab:blue", linestyle=":", label="stated 95 % bound of the robot"
    )
    curves.set_yscale("log")
    curves.set_xlabel("held-out poses [%]")
    curves.set_ylabel("position error [mm]")
    curves.set_title(f"{len(evaluation.dataset)} poses that were not learned from")
    curves.grid(visible=True, which="both", alpha=0.3)
    curves.legend()
    joints = list(dict.fromkeys(region.joint for region in evaluation.regions))
    height = 0.8 / REGIONS
    for shade in range(REGIONS):
        rows = evaluation.regions[shade::REGIONS]
        places = np.arange(len(joints)) + (shade - (REGIONS - 1) / 2) * height
        for label, colour, values in (
            ("nominal", "tab:red", [region.before for region in rows]),
            ("learned", "tab:blue", [region.after for region in rows]),
        ):
            regions.barh(
                places,
                _MILLIMETRE * np.array(values),
                height=0.9 * height,
                color=colour,
                alpha=0.45 + 0.2 * shade,
                label=label if shade == REGIONS - 1 else None,
            )
    regions.set_xscale("log")
    regions.set_yticks(range(len(joints)), joints)
    regions.invert_yaxis()
    regions.set_xlabel("mean position error [mm]")
    regions.set_title("by joint: lower, middle and upper third of its box")
    regions.grid(visible=True, axis="x", which="both", alpha=0.3)
    regions.legend()
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()
