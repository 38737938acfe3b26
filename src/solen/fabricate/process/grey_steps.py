"""Light transmitted by grey pixels, determined from discs of several grey levels cured in one exposure.

The cure depth of a disc is Dp ln(E/Ec) (Jacobs). For two discs from one exposure the critical dose cancels: the light
of a grey level, relative to the full level, is exp((C - C₁)/Dp) with the thickness C, and C₁ for the full level. An
error of Dp is an error of the exponent, so it is reported as the uncertainty of `Settings.grey_power`, together with
the scatter of the discs. If light falls with rising grey level, this is due to scatter; the closest ascending values
are used instead (isotonic regression, weighted by the thickness uncertainties).

`measured_greys` returns `MeasuredGreys`, whose ``process`` contains the measured grey levels.
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

GREYS = ("grey", "gray", "grey value", "gray value")
U_THICKNESSES = tuple(f"u_{name}" for name in THICKNESSES)
DISCS = ("disc", "disk", "sample", "specimen", "id", *REPEATS)
_STEP_UM = 1e-3
MIN_GREY_LEVELS = 4
"""Minimum number of grey levels for a curve, including the full level."""
DARK = 0.5
"""A grey level below this should have been measured."""
APART = 3.0
"""Maximum fall of light with rising grey level, in standard uncertainties."""


class GreyOptions(RowOptions):
    """Options for evaluating discs of several grey levels."""

    u_thickness_um: Finite | None = Field(None, gt=0.0)
    """Standard uncertainty of the disc thickness, if the table has no column u_thickness_um and no repeats."""
    u_scale_percent: Annotated[Finite, Field(ge=0.0, le=50.0)] = 0.0
    """Standard uncertainty of the gauge scale, %, common to all thicknesses and excluded from the disc
    uncertainties.
    """


class MeasuredGreys(Measured, kw_only=True):
    """Light of grey pixels, as fractions of the light at the full grey level.

    Attributes
    ----------
    process
        The process with these grey levels; omitted from JSON.
    grey, light, u_light
        Measured grey levels, ascending, the light of each, and its standard uncertainty excluding that of Dp.
    discs
        Number of discs for each grey level.
    Dp_um, u_Dp_um
        Penetration depth used for converting thickness to light, and its uncertainty.
    u_power
        Standard uncertainty of the exponent of all light, from Dp and from the discs.
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
        """Outward shift in pixels of an edge drawn with proportional grey levels, averaged over edge positions."""
        greys = self.process.process.model_copy(update={"grey_drawn": "proportional"}).greys
        return greys.shift


def measured_greys(recording: Recording, process: Process, options: GreyOptions = GreyOptions()) -> MeasuredGreys:
    """Determine the light of grey levels from a table of discs.

    Parameters
    ----------
    recording
        Table with columns of grey level (fractions, % or 0 to 255) and thickness, for discs cured in one exposure.
    process
        Process whose Dp converts thickness to light; its other values are kept.

    Raises
    ------
    DataError
        If a column is missing, no disc has the full grey level, too few grey levels cured a disc, or light falls with
        rising grey level.
    """
    recording = chosen_rows(recording, options)
    thickness = recording.need(*THICKNESSES)
    stated = recording.find(*U_THICKNESSES)
    shares, used = _shares(recording)
    names = [used, thickness.name, *([] if stated is None else [stated.name]), *DISCS]
    beside = refuse_unused(recording, options, names)
    depth = thickness.to("um")
    set_at = np.isfinite(depth) & (depth > 0.0)
    greys, which, counts = np.unique(shares[set_at], return_inverse=True, return_counts=True)
    blank = np.flatnonzero(~np.isfinite(depth) & (shares > greys.min(initial=1.0)))
    if len(blank):
        limit = (
            f"is blank at grey level {shares[blank[0]]:g}, although grey level {greys[0]:g} cured a disc: "
            "this disc was not measured"
        )
        raise DataError(
            f"{thickness.name} in row {blank[0] + 1}", limit=limit, remedy="delete the row, or measure the disc"
        )
    if not len(greys) or greys[-1] != 1.0:
        raise DataError(
            "grey", limit="no disc with the full grey level was cured, although it is the reference for all others"
        )
    if len(greys) < MIN_GREY_LEVELS:
        limit = f"at least {MIN_GREY_LEVELS} grey levels, including the full level, must have cured a disc"
        raise DataError("grey", value=len(greys), limit=limit, remedy="expose for longer")
    u_disc = _u_um(depth[set_at], which, None if stated is None else stated.to("um")[set_at], options)
    weight = np.bincount(which, u_disc**-2)
    mean, u_mean = np.bincount(which, depth[set_at] / u_disc**2) / weight, weight**-0.5
    Dp, u_Dp = process.process.Dp_um, process.uncertainty.get("Dp_um", 0.0)
    ascending = _ascending(greys, mean, u_mean)
    log_left = np.log(
        process.process.left(ascending)
    )  # E(grey) times the fraction left at its depth is Ec for all discs
    log_light = np.minimum(log_left[-1] - log_left, 0.0)
    per_um = (log_left - np.log(process.process.left(ascending + _STEP_UM))) / _STEP_UM
    light = np.exp(log_light)
    u_log = np.hypot(u_mean * per_um, u_mean[-1] * per_um[-1])[:-1]
    u_light = np.append(light[:-1] * u_log, 0.0)
    if not log_light[0] < 0.0:
        raise DataError(
            "thickness",
            limit="all discs are as thick as the discs with the full grey level: check whether a single image was used",
        )
    u_own = _u_of_exponent(log_light[:-1], u_mean * per_um)
    u_power = float(np.hypot(np.hypot(u_Dp / Dp, 0.01 * options.u_scale_percent), u_own))
    pairs = tuple((float(grey), float(share)) for grey, share in zip(greys, light, strict=True))
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
        warnings=(*beside, *_warnings(process, shares, set_at, greys)),
    )


def _u_of_exponent(log_light: FloatArray, u_log: FloatArray) -> float:
    """Return the standard uncertainty of the exponent of all light, by generalised least squares.

    All logarithms (N,) share the error of the full level, the last element of ``u_log`` (N + 1,), which does not
    average out.
    """
    covariance = np.diag(u_log[:-1] ** 2) + u_log[-1] ** 2
    return float(1.0 / np.sqrt(log_light @ np.linalg.solve(covariance, log_light)))


def _shares(recording: Recording) -> tuple[FloatArray, str]:
    """Return grey levels as fractions of the full level, and their column."""
    grey = recording.need(*GREYS)
    values = grey.to("1") if grey.unit == "%" else np.asarray(grey.values, float)
    if not grey.unit and np.nanmax(values) > 1.0:
        values = values / FULL
    if not (np.isfinite(values).all() and values.min() >= 0.0 and values.max() <= 1.0):
        raise DataError(
            grey.name,
            value=float(np.nanmax(values)),
            limit="must be fractions up to 1, percentages up to 100 or values up to 255",
        )
    return np.round(values, 6), grey.name


def _u_um(depth: FloatArray, which: NDArray[np.intp], stated: FloatArray | None, options: GreyOptions) -> FloatArray:
    """Return standard uncertainties of the thicknesses, from a column, an option or the scatter of repeats."""
    if stated is not None:
        if not (np.isfinite(stated).all() and (stated > 0.0).all()):
            raise DataError("u_thickness_um", limit="must be above 0 for every disc")
        return stated
    if options.u_thickness_um is not None:
        return np.full(len(depth), options.u_thickness_um)
    left = depth - (np.bincount(which, depth) / np.bincount(which))[which]
    free = len(depth) - len(np.unique(which))
    if free < 3:
        limit = "is not specified, and too few grey levels are repeated to determine it"
        raise DataError("u_thickness_um", limit=limit, remedy="add --u-thickness-um or a column u_thickness_um")
    return np.full(len(depth), float(np.sqrt(np.sum(left**2) / free)))


def _ascending(greys: FloatArray, mean: FloatArray, u: NDArray[np.floating]) -> FloatArray:
    """Return thicknesses that do not fall as grey level rises, as close as possible to the measured ones."""
    from scipy.optimize import isotonic_regression

    fitted = np.asarray(isotonic_regression(mean, weights=u**-2).x)
    worst = int(np.argmax(np.abs(fitted - mean) / u))
    if abs(fitted[worst] - mean[worst]) > APART * u[worst]:
        limit = f"is {mean[worst]:.4g} µm at grey level {greys[worst]:g}, which is out of order with its neighbours"
        raise DataError("thickness", limit=limit, remedy="check the order of the discs and their uncertainty")
    return fitted


def _with_greys(process: Process, pairs: tuple[tuple[float, float], ...], u_power: float, file: str) -> Process:
    data = process.model_dump()
    data["process"] |= {"grey": pairs, "grey_power": 1.0}
    data["uncertainty"]["grey_power"] = u_power
    data["source"] |= {"grey": f"measured: {file}", "grey_power": f"measured: {file}, with this Dp"}
    return Process(**data)


def _warnings(process: Process, shares: FloatArray, set_at: NDArray[np.bool_], greys: FloatArray) -> list[Caution]:
    warnings = []
    if "Dp_um" in process.assumptions:
        warnings.append(
            warning(
                f"Dp is assumed to be {process.process.Dp_um:g} µm, and the light of all grey levels depends on it: "
                "measure it with cure discs on the same printer"
            )
        )
    dark = np.unique(shares[~set_at])
    if len(dark):
        warnings.append(
            warning(f"grey levels up to {dark.max():g} cure nothing; below {greys[0]:g} the light is interpolated to 0")
        )
    elif greys[0] > DARK:
        warnings.append(warning(f"no grey level below {greys[0]:g} was measured; there the light is interpolated to 0"))
    return warnings
