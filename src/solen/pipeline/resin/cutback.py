"""Loss of a guide from a table of received powers, from the file to plain data and a figure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.material.loss import CutBack, Line, cut_back, full_level_dB, levels_dB, smallest_loss_dB_per_cm
from solen.material.loss.cutback import cautions
from solen.material.loss.levels import absorption_per_mm, pulls_down
from solen.pipeline.outputs import check_figure, check_out, check_wavelength, leave
from solen.recording import Channel, Recording, read
from solen.units import factor, is_unit

LENGTHS = ("length", "guide length")
POWERS = ("power", "signal", "voltage", "current", "transmittance", "level", "output", "intensity", "counts", "T")
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
LAYER_UM, U_T = 25.0, 1e-3
"""The layer of the paper, and how well a good spectrophotometer knows its transmittance."""
USUAL_DB_PER_CM = 50.0
"""Beyond it a centimetre passes 1e-5: no guide."""
_LINEAR = ("W", "V", "A")
_SHARES = {1.0: "1", 0.01: "%"}


@dataclass(frozen=True)
class Readings:
    """What a table says, row by row; ``guide`` and ``orientation`` are None where it has no such column."""

    length_mm: FloatArray
    values: FloatArray
    unit: str
    level_dB: FloatArray
    guide: list[str] | None
    orientation: list[str] | None
    warnings: list[str]


def cutback(
    file: Path,
    *,
    sheet: str | None = None,
    unit: str | None = None,
    dark: float | None = None,
    launched: float | None = None,
    wavelength_nm: float | None = None,
    keep_all: bool = False,
    figure: Path | None = None,
    out: Path | None = None,
) -> dict[str, Any]:
    """Loss in dB/cm with its interval, coupling apart, by orientation where a column gives it.

    Parameters
    ----------
    file
        Any file that `solen.recording.read` takes, with a column of lengths and one of powers.
    sheet
        Of a workbook.
    unit
        Of the powers, in place of the header's.
    dark, launched
        Reading without light, and what was launched into the guides, in the unit of the powers.
    wavelength_nm
        Of the light, which the result states.
    keep_all
        Set no piece aside.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    DataError
        Where the file is damaged or no loss with an uncertainty follows.
    """
    check_figure(figure)
    check_out(out)
    for name, value in (("--dark", dark), ("--launched", launched)):
        if value is not None and not math.isfinite(value):
            raise SpecError(name, value=value, limit="must be a number")
    check_wavelength(wavelength_nm)
    recording = read(file, sheet=sheet)
    rows = readings(recording, unit, dark)
    found = cut_back(rows.length_mm, rows.level_dB, rows.guide, rows.orientation, keep_all=keep_all)
    full = full_level_dB(rows.unit, launched, rows.values)
    data = _told(found, full) | {
        "wavelength_nm": wavelength_nm,
        "readings": len(rows.values),
        "power": {
            "unit": rows.unit or None,
            "dark": dark,
            "falls_with_light": pulls_down(rows.values, rows.unit, dark),
        },
        "single_layer": {
            "thickness_um": LAYER_UM,
            "u_T": U_T,
            "smallest_loss_dB_per_cm": smallest_loss_dB_per_cm(LAYER_UM, U_T),
        },
        "sources": [recording.provenance.as_dict()],
        "warnings": [*recording.warnings, *rows.warnings, *_unlaunched(full), *cautions(found), *_unusual(found)],
    }

    def draw() -> Any:
        from solen.report.resin.cutback import cutback_figure

        return cutback_figure(found, full, recording.provenance)

    return leave(data, "cutback", out, figure, draw)


def _unusual(found: CutBack) -> list[str]:
    """What swapped columns or a wrong unit of length look like."""
    if found.line.loss_dB_per_cm <= USUAL_DB_PER_CM:
        return []
    return [
        f"{found.line.loss_dB_per_cm:.3g} dB/cm leave nothing after a centimetre, and no guide is made of that: "
        "check which column is the length, and its unit"
    ]


def readings(recording: Recording, unit: str | None = None, dark: float | None = None) -> Readings:
    """Rows of a table with a length and a power; those without either are left out and counted."""
    length = recording.need(*LENGTHS).to("mm")
    channel = recording.find(*POWERS) or recording.find(*LOSSES) or recording.need(*POWERS[:3])
    unit, warnings = _unit(channel, unit)
    there = np.isfinite(length) & np.isfinite(channel.values)
    if not there.all():
        gone = int(np.sum(~there))
        warnings.append(f"{gone} row{'s' * (gone > 1)} without a length or a power: left out")
    if not there.any():
        raise DataError(recording.provenance.file, limit="has no row with a length and a power")
    values = channel.values[there] * (-1.0 if recording.find(*LOSSES) is channel else 1.0)
    guide, way = _texts(recording, there, GUIDES), _texts(recording, there, ORIENTATIONS)
    if guide is None:
        warnings.append(
            "no column says which guide was read (guide): readings of one length are taken as those of one guide, "
            "which is safe and wide"
        )
    elif len(set(guide)) == 1 and len(guide) > 1:
        warnings.append(f"all rows are of guide {guide[0]}: it is taken as one that was cut, and others may differ")
    if unit in {"V", "mV"} and dark is None:
        warnings.append("voltages without a dark reading (--dark): an offset bends the line and changes the loss")
    return Readings(length[there], values, unit, levels_dB(values, unit, dark), guide, way, warnings)


def _unit(channel: Channel, stated: str | None) -> tuple[str, list[str]]:
    """Unit of the powers in solen's spelling, and what must be said of it."""
    given = (stated if stated is not None else channel.unit).strip()
    logarithm = {"dbm": "dBm", "db": "dB"}.get(given.casefold())
    if logarithm:
        return logarithm, []
    if given in {"", "a.u.", "counts", "relative"}:
        if stated is None and (channel.quantity == "transmittance" or channel.name == "T"):
            return "1", []
        quiet = stated is not None
        return "", [] if quiet else [f"{channel.name} has no unit: it is taken as proportional to power (--unit)"]
    if (share := factor(given, "1")) in _SHARES:
        return _SHARES[share], []
    if not is_unit(given) or all(factor(given, one) is None for one in _LINEAR):
        limit = "must be of power, voltage or current, %, 1, dB, dBm, or relative"
        raise DataError(f"unit of {channel.name}", value=given, limit=limit, remedy="state it with --unit")
    return given, []


def _texts(recording: Recording, there: np.ndarray[Any, np.dtype[np.bool_]], names: Sequence[str]) -> list[str] | None:
    """Column that names the rows, as texts; None where there is none or it says nothing."""
    texts = recording.label(*names)
    if texts is None and (channel := recording.find(*names)) is not None:
        texts = tuple("" if math.isnan(value) else f"{value:g}" for value in channel.values)
    if texts is None or not any(texts):
        return None
    return [text for text, kept in zip(texts, there.tolist(), strict=True) if kept]


def _unlaunched(full: float | None) -> list[str]:
    if full is not None:
        return []
    return ["what was launched is not known (--launched), so the coupling loss is not: the loss per cm needs neither"]


def _told(found: CutBack, full: float | None) -> dict[str, Any]:
    line = found.line
    lengths = [piece.length_mm for piece in found.pieces]
    return _line(line, full) | {
        "lengths_mm": [min(lengths), max(lengths)],
        "scatter": {"piece_dB": found.piece_dB, "guide_dB": found.guide_dB, "reading_dB": found.reading_dB},
        "set_aside": [
            {
                "guide": bad.piece.guide,
                "orientation": bad.piece.orientation or None,
                "length_mm": bad.piece.length_mm,
                "off_dB": bad.off_dB,
                "t": bad.t,
            }
            for bad in found.set_aside
        ],
        "with_all": _line(found.line_with_all, full) if found.set_aside else None,
        "by_orientation": {one.orientation: _line(one, full) for one in found.by_orientation},
        "p_orientation": found.p_orientation,
        "p_curved": found.p_curved,
    }


def _line(line: Line, full: float | None) -> dict[str, Any]:
    """A line as plain data; an absorption that comes out negative is none."""
    lossy = line.loss_dB_per_cm > 0.0
    low, high = line.interval95
    start_low, start_high = line.start_interval95
    return {
        "loss_dB_per_cm": line.loss_dB_per_cm,
        "u_loss_dB_per_cm": line.u_loss_dB_per_cm,
        "interval95": [low, high],
        "absorption_per_mm": line.absorption_per_mm if lossy else None,
        "u_absorption_per_mm": line.u_absorption_per_mm if lossy else None,
        "absorption_interval95_per_mm": [absorption_per_mm(low), absorption_per_mm(high)],
        "coupling_loss_dB": None if full is None else full - line.start_dB,
        "u_coupling_loss_dB": None if full is None else line.u_start_dB,
        "coupling_interval95_dB": None if full is None else [full - start_high, full - start_low],
        "start_dB": line.start_dB,
        "degrees_of_freedom": line.df,
        "guides": line.guides,
        "pieces": line.pieces,
        "lengths": line.lengths,
    }
