"""The tuning figure: the lens deviation along x before and after, all prints so far, and the responses."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.explore import TunedPrint
from solen.explore.tuning_log import Responses, TunedResponse
from solen.report.canvas import INK, LEFT, RIGHT

BAND = 1.96


def tune_figure(tuned: TunedPrint) -> Figure:
    """Draw the deviation of this print and the next, the rms of all prints, and the change in contrast."""
    panels = 2 if tuned.response is None else 3
    figure = Figure(figsize=(3.5 * panels, 3.6))
    axes = figure.subplots(1, panels)
    _deviations(axes[0], tuned)
    _prints(axes[1], tuned)
    if tuned.response is not None:
        _changes(axes[2], tuned.response)
    return figure


def _deviations(axes: Axes, tuned: TunedPrint) -> None:
    seen = np.isfinite(tuned.measured_um)
    after, band = tuned.predicted_um[seen], BAND * tuned.u_predicted_um[seen]
    x = tuned.x_mm[seen]
    axes.fill_between(x, after - band, after + band, color=RIGHT, alpha=0.2, lw=0)
    axes.plot(tuned.x_mm, tuned.measured_um, color=LEFT, lw=1.2, label=f"print {tuned.number}")
    axes.plot(x, after, "--", color=RIGHT, lw=1.2, label="next, predicted (95 %)")
    axes.axhline(0.0, color=INK, lw=0.7)
    most = 1.1 * max(float(np.abs(tuned.measured_um[seen]).max()), float((np.abs(after) + band).max()))
    axes.set(xlabel="x (mm)", ylabel="deviation, + outwards (µm)", ylim=(-most, 1.5 * most))
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
    axes.set(xlabel="print", ylabel="deviation, rms (µm)", xlim=(0.5, number + 0.5), ylim=(0.0, top))
    axes.set_xticks([*numbers, number])
    axes.legend()


def _predicted(axes: Axes, number: int, rms: float, interval: tuple[float, float], label: str | None = None) -> None:
    away = [[rms - interval[0]], [interval[1] - rms]]
    axes.errorbar([number + 0.12], [rms], away, fmt="s", mfc="white", color=RIGHT, ms=5, capsize=3, label=label)


def _changes(axes: Axes, traced: Responses) -> None:
    for one, colour, style, name in (
        (traced.before, LEFT, "o-", "this print"),
        (traced.after, RIGHT, "s--", "next, predicted"),
    ):
        change, band = _change(one, traced.designed)
        angle = np.array(one.angle_deg)
        axes.fill_between(angle, change - band, change + band, color=colour, alpha=0.2, lw=0)
        axes.plot(angle, change, style, color=colour, ms=3.5, lw=1.2, label=name)
    axes.axhline(0.0, color=INK, lw=0.7)
    where = "in space" if traced.dimension == "extruded" else "in the plane"
    low, high = axes.get_ylim()
    axes.set(xlabel="angle (deg)", ylabel="contrast, printed − designed", ylim=(low, high + 0.3 * (high - low)))
    axes.set_title(f"response {where}")
    axes.legend()


def _change(one: TunedResponse, designed: TunedResponse) -> tuple[np.ndarray, np.ndarray]:
    """Draw the contrast minus the designed contrast, with its 95 % band."""
    change = np.array(one.contrast) - np.array(designed.contrast)
    return change, BAND * np.hypot(one.u_contrast, designed.u_contrast)
