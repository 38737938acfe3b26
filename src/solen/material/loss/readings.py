"""Loss of a guide from a recording: columns of length, power, guide and orientation, and their units.

`guide_loss` evaluates a recording with `CutbackOptions`; `readings` returns the rows that are used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError
from solen.material.loss.cutback import GuideLoss, cut_back
from solen.material.loss.levels import launched_level_dB, levels_dB, pulls_down
from solen.material.rows import REPEATS, RowOptions, chosen_rows, constant_number, refuse_unused, stacked_replicates
from solen.material.warning_prefixes import LAUNCHED
from solen.ranks import Caution, do_not_use, note, warning
from solen.recording import Channel, Recording
from solen.spec.strict import Finite, Wavelength
from solen.units import factor, is_unit

LENGTHS = ("length", "guide length")
POWERS = ("power", "signal", "voltage", "current", "transmittance", "level", "output", "intensity", "counts", "T")
WAVELENGTHS = ("wavelength", "lambda", "wl")
LOSSES = ("loss", "insertion loss", "attenuation")
GUIDES = ("guide", "piece", "sample", "specimen", "part", "print", "id", "name", "probe")
ORIENTATIONS = (
    "orientation",
    "build orientation",
    "direction",
    "angle",
    "ausrichtung",
    "orientierung",
    "bauorientierung",
)
PLAUSIBLE_DB_PER_CM = 50.0
"""Largest plausible loss of a guide, of which one centimetre transmits 1e-5."""
UM_PER_MM = 1e3
_LINEAR = ("W", "V", "A")
_VOLTS = ("V", "mV")
_FRACTIONS = {1.0: "1", 0.01: "%"}


class CutbackOptions(RowOptions):
    """Options for evaluating a cut-back."""

    unit: str | None = None
    """Unit of the powers, instead of that in the header: mW, µW, V, dBm, dB, %, 1 or relative."""
    dark: Finite | None = None
    """Reading without light, in the unit of the powers. If all readings are below it, light lowers the readings."""
    launched: Finite | None = None
    """Power launched into the guides, in the unit of the powers; adds the coupling loss to the result."""
    wavelength_nm: Wavelength | None = None
    """Wavelength of the light, stored in the result; default: that of the table, if it is the same in all rows."""
    keep_all: bool = False
    """Include outliers in the fit."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Rows of a table that have a length and a power.

    Attributes
    ----------
    length_mm, values, level_dB
        Length, reading in `unit`, and level of each row, shape (n,).
    unit
        Unit of the readings; empty for readings that are proportional to power.
    guide, orientation
        Guide and orientation of each row; None without such a column.
    columns
        Names of the columns that were used.
    warnings
        Warnings about assumptions and omitted rows.
    """

    length_mm: FloatArray
    values: FloatArray
    unit: str
    level_dB: FloatArray
    guide: list[str] | None
    orientation: list[str] | None
    columns: tuple[str, ...]
    warnings: list[Caution]


def guide_loss(recording: Recording, options: CutbackOptions = CutbackOptions()) -> GuideLoss:
    """Return the loss in dB/cm of guides of several lengths, and of each orientation if a column names them.

    Raises
    ------
    DataError
        If there is no length or power column, or the rows determine no loss with an uncertainty.
    """
    recording = stacked_replicates(chosen_rows(recording, options), POWERS, REPEATS)
    rows = readings(recording, options.unit, options.dark)
    notes = refuse_unused(recording, options, (*rows.columns, *REPEATS))
    launched_dB = launched_level_dB(rows.unit, options.launched, rows.values)
    loss = cut_back(
        rows.length_mm, rows.level_dB, rows.guide, rows.orientation, keep_all=options.keep_all, launched_dB=launched_dB
    )
    _refuse_rising_voltage(loss, rows, options.dark)
    return replace(
        loss,
        wavelength_nm=options.wavelength_nm or constant_number(recording, WAVELENGTHS, "nm"),
        power_unit=rows.unit or None,
        dark=options.dark,
        falls_with_light=pulls_down(rows.values, rows.unit, options.dark),
        sources=(recording.provenance,),
        warnings=(
            *_implausible(loss, recording.need(*LENGTHS).unit),
            *(channel.caution for channel in recording.channels if channel.note and channel.name in rows.columns),
            *notes,
            *rows.warnings,
            *_launch_unknown(launched_dB),
            *loss.warnings,
        ),
    )


def readings(recording: Recording, unit: str | None = None, dark: float | None = None) -> Readings:
    """Return the rows of a table that have a length and a power; a warning reports the number of omitted rows."""
    lengths = recording.need(*LENGTHS)
    length = lengths.to("mm")
    channel = recording.find(*POWERS) or recording.find(*LOSSES) or recording.need(*POWERS[:3])
    unit, warnings = _unit(channel, unit)
    complete = np.isfinite(length) & np.isfinite(channel.values)
    if not complete.all():
        missing = int(np.sum(~complete))
        warnings.append(warning(f"omitted {missing} row{'s' * (missing > 1)} without a length or a power"))
    if not complete.any():
        raise DataError(recording.provenance.file, limit="contains no row with both a length and a power")
    values = channel.values[complete] * (-1.0 if recording.find(*LOSSES) is channel else 1.0)
    (guide_column, guide), (orientation_column, orientation) = (
        _labels(recording, complete, names) for names in (GUIDES, ORIENTATIONS)
    )
    if guide is None:
        warnings.append(
            warning(
                "the table has no column named guide: the readings at each length are averaged as "
                "if they belonged to one guide, which is conservative and results in a wide interval"
            )
        )
    elif len(set(guide)) == 1 and len(guide) > 1:
        warnings.append(
            warning(
                f"all rows belong to guide {guide[0]} and are evaluated as a single guide that "
                "was cut back; other guides may differ"
            )
        )
    if unit in _VOLTS and dark is None:
        warnings.append(
            warning("the voltages have no dark reading (--dark): an offset bends the line and changes the loss")
        )
    columns = (lengths.name, channel.name, *guide_column, *orientation_column)
    return Readings(
        length[complete], values, unit, levels_dB(values, unit, dark), guide, orientation, columns, warnings
    )


def _unit(channel: Channel, option: str | None) -> tuple[str, list[Caution]]:
    """Return the unit of the powers, from the option or the header, in solen's spelling, and warnings about it."""
    unit = (option if option is not None else channel.unit).strip()
    logarithmic = {"dbm": "dBm", "db": "dB"}.get(unit.casefold())
    if logarithmic:
        return logarithmic, []
    if unit in {"", "a.u.", "counts", "relative"}:
        if option is not None:
            return "", []
        if channel.quantity == "transmittance" or channel.name == "T":
            return "1", []
        return "", [
            warning(f"{channel.name} has no unit and is assumed to be proportional to the power; specify --unit")
        ]
    if (fraction := factor(unit, "1")) in _FRACTIONS:
        return _FRACTIONS[fraction], []
    if not is_unit(unit) or all(factor(unit, linear) is None for linear in _LINEAR):
        limit = "must be a unit of power, voltage or current, %, 1, dB, dBm, or relative"
        raise DataError(f"unit of {channel.name}", value=unit, limit=limit, remedy="specify it with --unit")
    return unit, []


def _labels(recording: Recording, complete: BoolArray, names: Sequence[str]) -> tuple[list[str], list[str] | None]:
    """Return the name and the cells of the column that labels the rows; None if this column is missing or empty."""
    cells = recording.label(*names)
    column = [name for name, texts in recording.texts.items() if texts is cells]
    if cells is None and (channel := recording.find(*names)) is not None:
        column, cells = [channel.name], tuple("" if math.isnan(value) else f"{value:g}" for value in channel.values)
    if cells is None or not any(cells):
        return [], None
    return column[:1], [cell for cell, kept in zip(cells, complete.tolist(), strict=True) if kept]


def _launch_unknown(launched_dB: float | None) -> list[Caution]:
    if launched_dB is not None:
        return []
    return [note(f"{LAUNCHED} (--launched), so the coupling loss is unknown; this does not affect the loss per cm")]


def _refuse_rising_voltage(loss: GuideLoss, rows: Readings, dark: float | None) -> None:
    """Raise if voltages significantly rise with length, as from a phototransistor that pulls its output down."""
    if rows.unit in _VOLTS and dark is None and loss.interval95_loss_dB_per_cm[1] < 0.0:
        limit = (
            "increases with the length of the guide, so light lowers the voltage, as with a phototransistor "
            "that pulls its output low"
        )
        highest = f"{float(np.max(rows.values)):.3g} {rows.unit}"
        remedy = (
            f"specify the reading without light, which is at least {highest}, with --dark; or check which column is "
            "the length"
        )
        raise DataError(f"column {rows.columns[1]}", limit=limit, remedy=remedy)


def _implausible(loss: GuideLoss, length_unit: str) -> list[Caution]:
    """Return a warning if the result suggests swapped columns or a wrong length unit."""
    if loss.loss_dB_per_cm <= PLAUSIBLE_DB_PER_CM:
        return []
    _, longest = loss.lengths_mm
    if_mm = loss.loss_dB_per_cm / UM_PER_MM
    if factor(length_unit, "um") == 1.0 and if_mm <= PLAUSIBLE_DB_PER_CM:
        return [
            do_not_use(
                f"the lengths, up to {longest * UM_PER_MM:.3g} µm, look like values in mm under "
                f"a header in µm: the loss would be {if_mm:.3g} dB/cm instead of {loss.loss_dB_per_cm:.3g}; "
                "correct the header"
            )
        ]
    return [
        do_not_use(
            f"at {loss.loss_dB_per_cm:.3g} dB/cm, hardly any light remains after one centimetre: "
            "check which column is the length, and its unit"
        )
    ]
