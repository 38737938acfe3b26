"""The working-curve figure: thickness against dose, and the dose inside a part compared with a single layer."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from solen.material.cure.discs import ComparedCurve, MeasuredCurve
from solen.material.cure.layers import StackDose
from solen.material.cure.working_curve_fit import WorkingCurve
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SPACE, series

_CURVE_ALPHA, _DISC_ALPHA = 0.18, 0.09
_MARGIN = 1.15  # factor by which the dose axis extends beyond the data


def cure_figure(curve: MeasuredCurve) -> Figure:
    """Draw discs and curve and, if the layers of a part are known, the dose inside it in a second panel."""
    figure = Figure(figsize=(5.4 if curve.stack is None else 9.6, 3.9))
    ratios = (1,) if curve.stack is None else (5, 4)
    panels = figure.subplots(1, len(ratios), width_ratios=ratios, squeeze=False)[0]
    if curve.beside:
        _draw_curves(panels[0], (curve, *curve.beside))
    else:
        _draw_curve(panels[0], curve)
    _draw_layer(panels[0], curve)
    if (irradiance := curve.irradiance_mW_per_cm2) is not None:
        top = panels[0].secondary_xaxis("top", functions=(lambda e: e / irradiance, lambda s: s * irradiance))
        top.set_xlabel(f"exposure (s) at {irradiance:g} mW/cm²")
        _plain_ticks(top.xaxis)
    panels[0].legend()
    if curve.stack is not None:
        _draw_stack(panels[1], curve.stack)
    name = f"{'simulated: ' if curve.simulated else ''}{', '.join(source.file for source in curve.sources)}"
    figure.suptitle(name if curve.beside else f"{name}: {_title(curve)}")
    return figure


def _draw_curves(axes: Axes, curves: Sequence[MeasuredCurve | ComparedCurve]) -> None:
    """Draw the line, 95 % band and discs of each table; discs of equal dose are shown as mean ± SD."""
    for number, curve in enumerate(curves):
        style = series(number)
        doses = np.array([disc.dose_mJ_per_cm2 for disc in curve.used])
        um = np.array([disc.thickness_um for disc in curve.used])
        e = np.geomspace(min(doses.min(), curve.Ec_mJ_per_cm2) / _MARGIN, doses.max() * _MARGIN, 161)
        depth, half = curve.depth_um(e), curve.half_width_um(e)
        axes.fill_between(e, depth - half, depth + half, color=style["color"], alpha=_CURVE_ALPHA, lw=0)
        axes.plot(e, depth, **style, lw=1.4, label=_label(curve))
        unique_doses = np.unique(doses)
        groups = [um[doses == dose] for dose in unique_doses]
        sd = [group.std(ddof=1) if len(group) > 1 else 0.0 for group in groups]
        means, dots = [group.mean() for group in groups], series(number, dots=True)
        axes.errorbar(unique_doses, means, sd, ms=4, capsize=2, lw=0.9, **dots)
    axes.set(xscale="log", xlabel="dose (mJ/cm²)", ylabel="thickness (µm)", ylim=(0.0, None))
    _plain_ticks(axes.xaxis)


def _label(curve: MeasuredCurve | ComparedCurve) -> str:
    """Return the name of a table with Dp and Ec of its curve."""
    return f"{Path(curve.sources[0].file).stem}: Dp {curve.Dp_um:.3g} µm, Ec {curve.Ec_mJ_per_cm2:.3g} mJ/cm²"


def _title(curve: WorkingCurve) -> str:
    low, high = curve.interval95_Dp_um
    ends = curve.interval95_Ec_mJ_per_cm2
    ec = "no interval" if ends is None else f"{ends[0]:.3g} to {ends[1]:.3g}"
    return (
        f"Dp {curve.Dp_um:.3g} µm ({low:.3g} to {high:.3g}), Ec {curve.Ec_mJ_per_cm2:.3g} mJ/cm² ({ec}), 95 % intervals"
    )


def _draw_curve(axes: Axes, curve: MeasuredCurve) -> None:
    doses = [disc.dose_mJ_per_cm2 for disc in curve.used]
    e = np.geomspace(min([*doses, curve.Ec_mJ_per_cm2]) / _MARGIN, max(doses) * _MARGIN, 161)
    depth, half, disc_half = curve.depth_um(e), curve.half_width_um(e), curve.half_width_um(e, of_one_disc=True)
    axes.fill_between(
        e, depth - disc_half, depth + disc_half, color=RIGHT, alpha=_DISC_ALPHA, lw=0, label="95 % interval of a disc"
    )
    axes.fill_between(
        e, depth - half, depth + half, color=RIGHT, alpha=_CURVE_ALPHA, lw=0, label="95 % interval of the curve"
    )
    measured = e >= min(doses)
    axes.plot(e[measured], depth[measured], color=RIGHT, lw=1.6, label="Dp ln(E/Ec)")
    axes.plot(e[~measured], depth[~measured], "--", color=RIGHT, lw=1.0)
    axes.plot(doses, [disc.thickness_um for disc in curve.used], "o", ms=4, color=INK, label="discs")
    if curve.in_lamp is not None:
        spectral = curve.in_lamp.depth_um(e)
        axes.plot(
            e[spectral > 0.0], spectral[spectral > 0.0], "-.", color=SPACE, lw=1.4, label="for the lamp's spectrum"
        )
    omitted = [entry.disc for entry in curve.left_out if np.isfinite(entry.disc.thickness_um)]
    if omitted:
        xy = [disc.dose_mJ_per_cm2 for disc in omitted], [disc.thickness_um for disc in omitted]
        axes.plot(*xy, "x", ms=6, mew=1.4, color=LEFT, label="omitted")
    highest = max(disc.thickness_um for disc in [*curve.used, *omitted])
    axes.set(xscale="log", xlabel="dose (mJ/cm²)", ylabel="thickness (µm)", ylim=(0.0, 1.12 * highest))
    _plain_ticks(axes.xaxis)


def _plain_ticks(axis: Axis) -> None:
    """Label 1, 2 and 5 in each decade of an axis."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _draw_layer(axes: Axes, curve: MeasuredCurve) -> None:
    """Draw the thickness of a layer and the cure depth from its exposure."""
    if curve.layer is not None:
        um = curve.layer.layer_um
        axes.axhline(um, color=SPACE, lw=1.2, ls=":", label=f"layer of {um:g} µm")
    if (exposure := curve.exposure) is not None:
        dose, depth = exposure.dose_mJ_per_cm2, exposure.cure_depth_um
        label = f"{exposure.exposure_s:g} s: {depth:.3g} µm"
        axes.plot([dose, dose], [0.0, max(depth, 0.0)], color=SPACE, lw=1.4, label=label)


def _draw_stack(axes: Axes, stack: StackDose) -> None:
    """Draw the height in the part against dose, with the dose of a single layer."""
    count, h = len(stack.exposures_mJ_per_cm2), stack.layer_um
    edges = np.repeat(np.arange(count + 1) * h / 1e3, 2)[1:-1]
    high = np.repeat(stack.window_side_mJ_per_cm2, 2)
    axes.fill_betweenx(edges, high * stack.q, high, color=RIGHT, alpha=0.35, lw=0, label="within a layer")
    axes.plot(
        stack.layer_mean_mJ_per_cm2, (np.arange(count) + 0.5) * h / 1e3, ".", ms=3, color=RIGHT, label="mean of a layer"
    )
    axes.axvline(stack.single_layer_mean_mJ_per_cm2, color=LEFT, lw=1.4, label="single layer")
    axes.axvline(float(stack.exposures_mJ_per_cm2[-1]), color=LOST, lw=1.2, ls="--", label="at the window")
    axes.set(xlabel="dose (mJ/cm²)", ylabel="height in the part (mm)", xlim=(0.0, None))
    ratio = f"{stack.interior_over_single_layer:.2g} times that of one layer"
    axes.set_title(f"inside: {stack.interior_mean_mJ_per_cm2:.3g} mJ/cm², {ratio}")
    axes.legend()
