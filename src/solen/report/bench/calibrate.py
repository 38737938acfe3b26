"""The calibration figure: the curves, the decoded angles against the true angles, and the errors.

There is one row for each calibration. Left is orange and right is blue; lines are solid for rising angles and dashed
for falling angles.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.calibration import Calibration, CalibrationFile, Check, SensorCalibrations
from solen.arrays import IndexArray
from solen.recording.stimulus import Stimulus
from solen.report.bench.analyse import add_title, label_of
from solen.report.canvas import INK, LOST, RIGHT, SOFT, receiver

_MAX_POINTS = 3000


def calibration_figure(result: SensorCalibrations) -> Figure:
    """Draw three panels for each calibration."""
    count = len(result.calibrations)
    figure = Figure(figsize=(10.4, 3.1 * count + 0.3))
    axes = figure.subplots(count, 3, squeeze=False)
    for calibration, check, row in zip(result.calibrations, result.checks, axes, strict=True):
        _draw_calibration(row, calibration, check)
    add_title(figure, result.simulated, result.smoothing)
    return figure


def _draw_calibration(row: Sequence[Axes], file: CalibrationFile, check: Check | None) -> None:
    curves, angles, errors = row
    stimulus = file.stimulus_of
    _draw_curves(curves, file.calibration, file.unit)
    curves.set_xlabel(stimulus.label)
    curves.set_title(f"{file.sensor}: {file.cycles} cycles, ± 2 SD of a new reading", loc="left")
    if check is None:
        for panel in (angles, errors):
            panel.text(0.5, 0.5, "not checked: too few", ha="center", transform=panel.transAxes, color=LOST)
        return
    fold = "cycles" if file.leave_one_sensor_out is None else "prints"
    _draw_angles(angles, check, stimulus)
    angles.set(xlabel=stimulus.known_label, ylabel=f"decoded {stimulus.label}")
    angles.set_title(f"held-out {fold}: RMS error {check.total.rms_deg:.2g}{stimulus.sign}", loc="left")
    _draw_errors(errors, check, stimulus)
    errors.set(xlabel=stimulus.known_label, ylabel=f"error ({stimulus.sign.strip()})")
    fractions = f"{100 * check.total.within_68:.0f} and {100 * check.total.within_95:.0f} %"
    errors.set_title(f"within the 68 and 95 % bands: {fractions}", loc="left")


def _draw_curves(axes: Axes, calibration: Calibration, unit: str) -> None:
    for index, name in enumerate(("left", "right")):
        style = receiver(name)
        rising, falling = calibration.curves_V[..., index]
        half = 2.0 * np.sqrt(calibration.total[:, index, index])
        middle = 0.5 * (rising + falling)
        axes.fill_between(calibration.angle_deg, middle - half, middle + half, color=style["color"], alpha=0.25, lw=0)
        axes.plot(calibration.angle_deg, rising, **style, lw=1.5, label=name)
        axes.plot(calibration.angle_deg, falling, "--", **style, lw=1.0)
    axes.set_ylabel(label_of(unit))
    axes.legend()


def _drawn_rows(check: Check) -> IndexArray:
    """Return the readings to draw, in order of the true angle."""
    order = np.argsort(check.true_deg, kind="stable")
    return order[:: max(1, order.size // _MAX_POINTS)]


def _draw_angles(axes: Axes, check: Check, stimulus: Stimulus) -> None:
    rows = _drawn_rows(check)
    true = check.true_deg[rows]
    axes.vlines(true, check.low_deg[rows, 1], check.high_deg[rows, 1], color=RIGHT, alpha=0.15, lw=0.8)
    axes.plot(true, check.angle_deg[rows], ".", color=RIGHT, ms=2.5, label="decoded, with its 95 % band")
    ends = np.array([true.min(), true.max()])
    axes.plot(ends, ends, color=INK, lw=0.8, label=stimulus.known)
    axes.legend()


def _draw_errors(axes: Axes, check: Check, stimulus: Stimulus) -> None:
    rows = _drawn_rows(check)
    true, decoded = check.true_deg[rows], check.angle_deg[rows]
    low, high = check.low_deg[rows, 1] - decoded, check.high_deg[rows, 1] - decoded
    axes.plot(true, decoded - true, ".", color=RIGHT, ms=2.5, label=f"decoded − {stimulus.known}", zorder=3)
    axes.vlines(true, low, high, color=SOFT, lw=0.8)
    axes.plot(np.nan, np.nan, color=SOFT, label="95 % band")
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.legend()
