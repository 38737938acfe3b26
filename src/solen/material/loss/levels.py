"""Power readings as levels in dB, and conversion of loss to other units.

Only ratios of powers matter, so readings in mW, volts or counts are equally suitable if they are proportional to the
power after subtraction of the dark reading.

Public names: `levels_dB`, `launched_level_dB`, `absorption_per_mm` and `smallest_loss_dB_per_cm`.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError

DB_PER_NEPER = 10.0 / math.log(10.0)
"""Decibels per factor e of power."""
MM_PER_CM = 10.0
CM_PER_UM = 1e-4
LOGARITHMIC = ("dBm", "dB")
_LAUNCHED = {"1": 1.0, "%": 100.0, "dB": 0.0}  # launched power in units that are relative to it
_MAX_SHOWN = 3  # number of readings that a message lists


def absorption_per_mm(loss_dB_per_cm: float) -> float:
    """Return the absorption coefficient per mm, base e, that corresponds to a loss in dB/cm."""
    return loss_dB_per_cm / DB_PER_NEPER / MM_PER_CM


def smallest_loss_dB_per_cm(thickness_um: float, u_T: float) -> float:
    """Return the loss in dB/cm at which a layer absorbs the fraction ``u_T``, so that smaller losses are undetectable.

    0.1 % over 25 µm corresponds to 0.4 per cm or 1.7 dB/cm.
    """
    if not (0.0 < thickness_um < math.inf and 0.0 < u_T < 1.0):
        limit = "thickness must be above 0 µm and u(T) between 0 and 1"
        raise DataError("smallest loss", value=f"{thickness_um:g} µm, {u_T:g}", limit=limit)
    return -10.0 * math.log10(1.0 - u_T) / (thickness_um * CM_PER_UM)


def levels_dB(readings: ArrayLike, unit: str, dark: float | None = None) -> FloatArray:
    """Return readings as levels in dB, up to a constant.

    Parameters
    ----------
    readings
        Shape (n,).
    unit
        ``dBm`` or ``dB`` for logarithmic readings; readings in any other unit are assumed proportional to power.
    dark
        Reading without light, in the same unit. If all readings are below it, light lowers them, and the signal is the
        difference.

    Raises
    ------
    DataError
        If a signal is not above 0.
    """
    values = np.asarray(readings, float)
    if unit not in LOGARITHMIC:
        signal = values - (dark or 0.0)
    elif dark is None:
        return values.copy()
    else:
        signal = 10.0 ** (values / 10.0) - 10.0 ** (dark / 10.0)
    if pulls_down(values, unit, dark):
        signal = -signal
    not_positive = np.flatnonzero(~(signal > 0.0)).tolist()
    if not_positive:
        raise _no_light(values, not_positive, unit, dark)
    return 10.0 * np.log10(signal)


def pulls_down(readings: ArrayLike, unit: str, dark: float | None) -> bool:
    """Whether light lowers the readings: all are below the dark reading."""
    return dark is not None and unit not in LOGARITHMIC and bool(np.all(np.asarray(readings, float) < dark))


def launched_level_dB(unit: str, launched: float | None, readings: ArrayLike) -> float | None:
    """Return the level of the launched power, on the scale of `levels_dB`; None if it is not known.

    Parameters
    ----------
    unit, readings
        As for `levels_dB`. Fractions, percentages and dB are relative to the launched power, unless a reading exceeds
        it.
    launched
        Launched power, in that unit.
    """
    if launched is None:
        launched = _LAUNCHED.get(unit)
        if launched is None or float(np.max(np.asarray(readings, float))) > launched:
            return None
    if unit in LOGARITHMIC:
        return launched
    if not launched > 0.0:
        raise DataError("launched power", value=launched, limit=f"must be above 0 {unit}")
    return 10.0 * math.log10(launched)


def _no_light(values: FloatArray, rows: list[int], unit: str, dark: float | None) -> DataError:
    shown = ", ".join(f"{values[row]:g} {unit} (reading {row + 1})" for row in rows[:_MAX_SHOWN])
    more = f" and {len(rows) - _MAX_SHOWN} more" if len(rows) > _MAX_SHOWN else ""
    limit = "be above 0" if dark is None else f"all be above, or all below, the dark reading of {dark:g} {unit}"
    remedy = (
        "remove these rows, specify the dark reading (--dark), or specify the unit if the "
        "values are logarithmic (--unit dBm)"
    )
    return DataError(
        "power",
        value=shown + more,
        limit=f"must {limit}: the level of a reading without light is undefined",
        remedy=remedy,
    )
