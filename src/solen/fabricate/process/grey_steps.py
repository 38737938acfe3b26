"""Light of grey pixels, measured with discs of several grey levels that are cured in one exposure.

The cure depth of a disc is Dp ln(E/Ec) (Jacobs). For two discs of one exposure, the critical dose cancels: the light of
a grey level, relative to the full level, is exp((C - C₁)/Dp), where C is the thickness of its disc and C₁ that of the
full level. An error of Dp is an error of the exponent, which is reported as the uncertainty of `Settings.grey_power`,
together with the scatter of the discs. Scatter may make the thickness fall slightly with increasing grey level; the
closest ascending values are then used (isotonic regression, weighted by the uncertainties of the thickness).

`measured_greys` returns `MeasuredGreys`, whose ``process`` contains the measured grey response.
"""

from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.grey import FULL
from solen.fabricate.process.process_file import Process
from solen.material.cure.disc_table import THICKNESSES
from solen.material.rows import REPEATS, RowOptions, chosen_rows, refuse_unused
from solen.ranks import Caution, warning
from solen.recording import Measured, Recording
from solen.results import HIDDEN, reported
from solen.spec.strict import Finite

GREY_COLUMNS = ("grey", "gray", "grey value", "gray value")
U_THICKNESS_COLUMNS = tuple(f"u_{name}" for name in THICKNESSES)
OTHER_COLUMNS = ("disc", "disk", "sample", "specimen", "id", *REPEATS)
_STEP_UM = 1e-3
MIN_GREY_LEVELS = 4
"""Minimum number of grey levels for a curve, including the full level."""
MAX_DARKEST = 0.5
"""Maximum lowest grey level without a warning."""
MAX_FALL = 3.0
"""Maximum difference between a measured thickness and the fitted ascending one, in standard uncertainties."""


class GreyOptions(RowOptions):
    """Options for the evaluation of grey-step discs."""

    u_thickness_um: Finite | None = Field(None, gt=0.0)
    """Standard uncertainty of the thickness of a disc, for a table without a column u_thickness_um; default: from the
    scatter of discs of the same grey level."""
    u_scale_percent: Annotated[Finite, Field(ge=0.0, le=50.0)] = 0.0
    """Standard uncertainty of the scale of the gauge in percent, which is common to all discs and not included in their
    uncertainties.
    """


class MeasuredGreys(Measured, kw_only=True):
    """Light of grey pixels, as fractions of the light of the full grey level.

    Attributes
    ----------
    process
        The process with this grey response; omitted from JSON.
    grey, light, u_light
        Measured grey levels in ascending order, their light, and its standard uncertainty without that of Dp.
    discs
        Number of discs of each grey level.
    Dp_um, u_Dp_um
        Penetration depth with which thickness is converted to light, and its uncertainty.
    u_power
        Standard uncertainty of the exponent of the light, from Dp and from the discs.
    """

    process: Process = field(metadata=HIDDEN)
    grey: FloatArray
    light: FloatArray
    u_light: FloatArray
    discs: tuple[int, ...]
    Dp_um: float
    u_Dp_um: float
    u_power: float

    @reported
    def edge_shift_px(self) -> float:
        """Mean outward shift, in pixels, of an edge that is drawn with grey levels proportional to coverage."""
        return self.process.process.model_copy(update={"grey_drawn": "proportional"}).greys.shift


def measured_greys(recording: Recording, process: Process, options: GreyOptions = GreyOptions()) -> MeasuredGreys:
    """Return the light of grey levels, determined from a table of discs.

    Parameters
    ----------
    recording
        Table with a grey column (fractions, % or 0 to 255) and a thickness column, of discs cured in one exposure.
    process
        Process whose Dp converts thickness to light, and to which the grey response is added.

    Raises
    ------
    DataError
        If a column is missing, no disc of the full grey level was cured, too few grey levels cured a disc, or the
        thickness falls with increasing grey level.
    """
    recording = chosen_rows(recording, options)
    thickness = recording.need(*THICKNESSES)
    u_thickness = recording.find(*U_THICKNESS_COLUMNS)
    levels, grey_column = _levels(recording)
    columns = [grey_column, thickness.name, *([] if u_thickness is None else [u_thickness.name]), *OTHER_COLUMNS]
    unused = refuse_unused(recording, options, columns)
    depth = thickness.to("um")
    cured = np.isfinite(depth) & (depth > 0.0)
    greys, index, counts = np.unique(levels[cured], return_inverse=True, return_counts=True)
    _check_greys(levels, depth, greys, thickness.name)
    u_disc = _u_um(depth[cured], index, None if u_thickness is None else u_thickness.to("um")[cured], options)
    weight = np.bincount(index, u_disc**-2)
    mean, u_mean = np.bincount(index, depth[cured] / u_disc**2) / weight, weight**-0.5
    Dp, u_Dp = process.process.Dp_um, process.uncertainty.get("Dp_um", 0.0)
    ascending = _ascending(greys, mean, u_mean)
    # the dose of a grey level times the fraction transmitted to the depth of its disc is Ec for all discs
    log_transmitted = np.log(process.process.transmitted(ascending))
    log_light = np.minimum(log_transmitted[-1] - log_transmitted, 0.0)
    per_um = (log_transmitted - np.log(process.process.transmitted(ascending + _STEP_UM))) / _STEP_UM
    light = np.exp(log_light)
    u_log = np.hypot(u_mean * per_um, u_mean[-1] * per_um[-1])[:-1]
    u_light = np.append(light[:-1] * u_log, 0.0)
    if not log_light[0] < 0.0:
        limit = "must fall with decreasing grey level: all discs are as thick as those of the full level"
        raise DataError("thickness", limit=limit, remedy="check that all discs are from one exposure of grey steps")
    u_discs = _u_exponent(log_light[:-1], u_mean * per_um)
    u_power = float(np.hypot(np.hypot(u_Dp / Dp, 0.01 * options.u_scale_percent), u_discs))
    pairs = tuple((float(grey), float(fraction)) for grey, fraction in zip(greys, light, strict=True))
    return MeasuredGreys(
        process=_with_greys(process, pairs, u_power, recording.provenance.file or "a table of grey steps"),
        grey=greys,
        light=light,
        u_light=u_light,
        discs=tuple(counts.tolist()),
        Dp_um=Dp,
        u_Dp_um=u_Dp,
        u_power=u_power,
        sources=(recording.provenance,),
        warnings=(*unused, *_warnings(process, levels[~cured], greys)),
    )


def _check_greys(levels: FloatArray, depth: FloatArray, greys: FloatArray, column: str) -> None:
    """Raise `DataError` if a disc was not measured, or if the grey levels that cured a disc do not suffice."""
    blank = np.flatnonzero(~np.isfinite(depth) & (levels > greys.min(initial=1.0)))
    if len(blank):
        limit = f"is blank at grey level {levels[blank[0]]:g}, although grey level {greys[0]:g} cured a disc"
        remedy = "measure the disc, or delete the row"
        raise DataError(f"{column} in row {blank[0] + 1}", limit=limit, remedy=remedy)
    if not len(greys) or greys[-1] != 1.0:
        limit = "requires a cured disc of the full grey level, which is the reference for all others"
        raise DataError("grey", limit=limit, remedy="add a disc of grey level 1, or expose for longer")
    if len(greys) < MIN_GREY_LEVELS:
        limit = f"requires discs of at least {MIN_GREY_LEVELS} grey levels, but only {len(greys)} cured a disc"
        raise DataError("grey", limit=limit, remedy="expose for longer")


def _u_exponent(log_light: FloatArray, u_log: FloatArray) -> float:
    """Return the standard uncertainty of the exponent of the light, by generalised least squares.

    All logarithms (N,) share the error of the full level, which is the last element of ``u_log`` (N + 1,) and does not
    average out.
    """
    covariance = np.diag(u_log[:-1] ** 2) + u_log[-1] ** 2
    return float(1.0 / np.sqrt(log_light @ np.linalg.solve(covariance, log_light)))


def _levels(recording: Recording) -> tuple[FloatArray, str]:
    """Return the grey levels as fractions of the full level, and the name of their column."""
    grey = recording.need(*GREY_COLUMNS)
    values = grey.to("1") if grey.unit == "%" else np.asarray(grey.values, float)
    if not grey.unit and np.nanmax(values) > 1.0:
        values = values / FULL
    valid = (values >= 0.0) & (values <= 1.0)
    if not valid.all():
        limit = "must be fractions from 0 to 1, percentages from 0 to 100 or values from 0 to 255"
        raise DataError(grey.name, value=float(np.asarray(grey.values, float)[~valid][0]), limit=limit)
    return np.round(values, 6), grey.name


def _u_um(depth: FloatArray, index: NDArray[np.intp], column: FloatArray | None, options: GreyOptions) -> FloatArray:
    """Return the standard uncertainties of the thickness, from a column, an option or the scatter of repeated discs."""
    if column is not None:
        if not (np.isfinite(column).all() and (column > 0.0).all()):
            raise DataError("u_thickness_um", limit="must be above 0 for every disc")
        return column
    if options.u_thickness_um is not None:
        return np.full(len(depth), options.u_thickness_um)
    residuals = depth - (np.bincount(index, depth) / np.bincount(index))[index]
    df = len(depth) - len(np.unique(index))
    if df < 3:
        limit = "is missing, and too few discs have the same grey level to determine it"
        raise DataError("u_thickness_um", limit=limit, remedy="specify --u-thickness-um or add a column u_thickness_um")
    return np.full(len(depth), float(np.sqrt(np.sum(residuals**2) / df)))


def _ascending(greys: FloatArray, mean: FloatArray, u: NDArray[np.floating]) -> FloatArray:
    """Return thicknesses that do not fall with increasing grey level, as close as possible to the measured ones."""
    from scipy.optimize import isotonic_regression

    fitted = np.asarray(isotonic_regression(mean, weights=u**-2).x)
    worst = int(np.argmax(np.abs(fitted - mean) / u))
    if abs(fitted[worst] - mean[worst]) > MAX_FALL * u[worst]:
        limit = f"must not fall with increasing grey level: it is {mean[worst]:.4g} µm at grey level {greys[worst]:g}"
        raise DataError("thickness", limit=limit, remedy="check the order of the discs and their uncertainties")
    return fitted


def _with_greys(process: Process, pairs: tuple[tuple[float, float], ...], u_power: float, file: str) -> Process:
    data = process.model_dump()
    data["process"] |= {"grey": pairs, "grey_power": 1.0}
    data["uncertainty"]["grey_power"] = u_power
    data["source"] |= {"grey": f"measured: {file}", "grey_power": f"measured: {file}, with this Dp"}
    return Process(**data)


def _warnings(process: Process, uncured: FloatArray, greys: FloatArray) -> list[Caution]:
    warnings = []
    if "Dp_um" in process.assumptions:
        text = f"Dp is assumed to be {process.process.Dp_um:g} µm, and the light of all grey levels depends on it"
        warnings.append(warning(f"{text}: measure it with cure discs on the same printer"))
    interpolated = f"below {greys[0]:g}, the light is interpolated to 0"
    if len(uncured):
        warnings.append(warning(f"grey levels up to {uncured.max():g} cured nothing; {interpolated}"))
    elif greys[0] > MAX_DARKEST:
        warnings.append(warning(f"no grey level below {greys[0]:g} was measured; {interpolated}"))
    return warnings
