"""The tuning figure: deviation of the lens before and after the correction, all prints, and the responses."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.explore import TunedPrint
from solen.explore.tuning_log import Responses, TunedResponse
from solen.report.canvas import INK, LEFT, RIGHT

BAND = 1.96
"""Half width of a 95 % interval in standard uncertainties."""


def tune_figure(tuned: TunedPrint) -> Figure:
    """Draw the deviations of this print and the next one, the RMS deviations of all prints, and changes of contrast."""
    panels = 2 if tuned.response is None else 3
    figure = Figure(figsize=(3.5 * panels, 3.6))
    axes = figure.subplots(1, panels)
    _deviations(axes[0], tuned)
    _prints(axes[1], tuned)
    if tuned.response is not None:
        _changes(axes[2], tuned.response)
    return figure


def _deviations(axes: Axes, tuned: TunedPrint) -> None:
    measured = np.isfinite(tuned.measured_um)
    after, band = tuned.predicted_um[measured], BAND * tuned.u_predicted_um[measured]
    x = tuned.x_mm[measured]
    axes.fill_between(x, after - band, after + band, color=RIGHT, alpha=0.2, lw=0)
    axes.plot(tuned.x_mm, tuned.measured_um, color=LEFT, lw=1.2, label=f"print {tuned.number}")
    axes.plot(x, after, "--", color=RIGHT, lw=1.2, label="next, predicted (95 %)")
    axes.axhline(0.0, color=INK, lw=0.7)
    limit = 1.1 * max(float(np.abs(tuned.measured_um[measured]).max()), float((np.abs(after) + band).max()))
    axes.set(xlabel="x (mm)", ylabel="deviation (µm), positive outwards", ylim=(-limit, 1.5 * limit))
    axes.set_title(f"{'simulated: ' if tuned.simulated else ''}{tuned.design}")
    axes.legend()


def _prints(axes: Axes, tuned: TunedPrint) -> None:
    for step in tuned.history:
        if step.predicted is not None:
            _predicted(axes, step.number, step.predicted.rms_um, step.predicted.interval95_rms_um)
    number = tuned.number + 1
    _predicted(axes, number, tuned.predicted.rms_um, tuned.predicted.interval95_rms_um, label="predicted (95 %)")
    numbers = [step.number for step in tuned.history]
    rms, u = ([getattr(step, key) for step in tuned.history] for key in ("rms_um", "u_rms_um"))
    axes.errorbar(numbers, rms, np.multiply(BAND, u), fmt="o", color=LEFT, ms=5, capsize=3, label="measured (95 %)")
    top = 1.45 * max(*rms, *(step.predicted.interval95_rms_um[1] for step in tuned.history if step.predicted),
                     tuned.predicted.interval95_rms_um[1])  # fmt: skip
    axes.set(xlabel="print", ylabel="RMS deviation (µm)", xlim=(0.5, number + 0.5), ylim=(0.0, top))
    axes.set_xticks([*numbers, number])
    axes.legend()


def _predicted(axes: Axes, number: int, rms: float, interval: tuple[float, float], label: str | None = None) -> None:
    errors = [[rms - interval[0]], [interval[1] - rms]]
    axes.errorbar([number + 0.12], [rms], errors, fmt="s", mfc="white", color=RIGHT, ms=5, capsize=3, label=label)


def _changes(axes: Axes, traced: Responses) -> None:
    for response, colour, style, name in (
        (traced.before, LEFT, "o-", "this print"),
        (traced.after, RIGHT, "s--", "next, predicted"),
    ):
        change, band = _change(response, traced.designed)
        angle = np.array(response.angle_deg)
        axes.fill_between(angle, change - band, change + band, color=colour, alpha=0.2, lw=0)
        axes.plot(angle, change, style, color=colour, ms=3.5, lw=1.2, label=name)
    axes.axhline(0.0, color=INK, lw=0.7)
    dimension = "in space" if traced.dimension == "extruded" else "in the plane"
    low, high = axes.get_ylim()
    axes.set(xlabel="angle (deg)", ylabel="contrast, printed − designed", ylim=(low, high + 0.3 * (high - low)))
    axes.set_title(f"response {dimension}")
    axes.legend()


def _change(response: TunedResponse, designed: TunedResponse) -> tuple[np.ndarray, np.ndarray]:
    """Return the contrast minus the designed contrast, and half the width of its 95 % interval."""
    change = np.array(response.contrast) - np.array(designed.contrast)
    return change, BAND * np.hypot(response.u_contrast, designed.u_contrast)
