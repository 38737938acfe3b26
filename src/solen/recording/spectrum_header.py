"""Header entries of spectrum files: checks against the numbers, and the recording made from both.

Many programs record the meaning of the axis and the values, the number of points, the first and last point and the
extremes. JCAMP-DX has labels for them (``NPOINTS``, ``FIRSTX``, ``MAXY``); equivalent entries from other programs are
mapped to these labels.

Public names: `check`, `number` and `spectrum_recording`.
"""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.recording.model import FROM_WAVENUMBERS, Channel, Recording
from solen.recording.numbers import is_number, parse
from solen.recording.source import Source
from solen.recording.table import provenance_of, unique

_WAVENUMBER = "wavenumber", "1/cm"
_X = {
    **dict.fromkeys(("1/CM", "CM-1", "CM^-1", "WAVENUMBER", "WAVENUMBERS"), _WAVENUMBER),
    **dict.fromkeys(("NANOMETERS", "NM", "NM_AIR", "NM_VAC", "WAVELENGTH(NM)"), ("wavelength", "nm")),
    **dict.fromkeys(("MICROMETERS", "UM", "MICRONS"), ("wavelength", "um")),
}
_Y = {
    **dict.fromkeys(("TRANSMITTANCE", "T"), ("transmittance", "1")),
    **dict.fromkeys(("%TRANSMITTANCE", "PERCENTTRANSMITTANCE", "%T"), ("transmittance", "%")),
    **dict.fromkeys(("REFLECTANCE", "R"), ("reflectance", "1")),
    **dict.fromkeys(("%REFLECTANCE", "PERCENTREFLECTANCE", "%R"), ("reflectance", "%")),
    **dict.fromkeys(("ABSORBANCE", "ABS", "A"), ("absorbance", "1")),
    **{unit.upper(): ("power", unit) for unit in ("dBm", "mW")},
    "COUNTS": ("", "counts"),
}
CHECKED_LABELS = ("NPOINTS", "FIRSTX", "LASTX", "FIRSTY", "MAXY", "MINY")
_TOLERANCE_Y = 1e-3
"""Largest difference between a value and its header entry, as a fraction of the largest value."""
_UNKNOWN_QUANTITY = "the file does not specify whether its values are counts, transmittance or absorbance"


def number(source: Source, entries: Mapping[str, str], label: str) -> float:
    """Return the number under a label of the header; NaN if the label is absent."""
    text = entries.get(label, "")
    if text and not is_number(text):
        raise source.error("", f"contains no number for {label}", "export the file again", text[:40])
    return parse(text, "," if "," in text else ".")


def check(source: Source, entries: Mapping[str, float], x: FloatArray, y: FloatArray) -> None:
    """Raise `DataError` if the numbers contradict header entries; missing labels are not checked."""
    count = entries.get("NPOINTS", math.nan)
    if x.size < 2 or (math.isfinite(count) and count != x.size):
        limit = f"has {x.size} points, but the file specifies {count:g}: it was cut off or damaged"
        raise source.error("", limit, "export it again")
    tolerance_y = _TOLERANCE_Y * float(np.nanmax(np.abs(y), initial=0.0))
    tolerance_x = 0.5 * abs(float(x[-1] - x[0])) / (x.size - 1)
    ends = (("FIRSTX", x[0], tolerance_x), ("LASTX", x[-1], tolerance_x), ("FIRSTY", y[0], tolerance_y))
    for label, value, tolerance in (*ends, ("MAXY", np.nanmax(y), tolerance_y), ("MINY", np.nanmin(y), tolerance_y)):
        expected = entries.get(label, math.nan)
        if math.isfinite(expected) and not abs(expected - value) <= tolerance:
            raise source.error(
                "", f"specifies {expected:g} as {label}, but the numbers give {value:g}", "export it again"
            )


def spectrum_recording(
    source: Source,
    kind: str,
    metadata: Mapping[str, str],
    entries: Mapping[str, str],
    x: FloatArray,
    traces: Sequence[tuple[str, str, FloatArray]],
) -> Recording:
    """Return the recording of a spectrum, after the checks of `check`.

    Parameters
    ----------
    kind
        Name of the format.
    metadata, entries
        Header entries as written in the file, and under the labels ``XUNITS`` (default: nm), ``instrument`` and those
        in `CHECKED_LABELS`, which are compared with the first trace.
    x, traces
        Abscissas, and the name, unit and values of each trace, all of shape (n,).
    """
    check(source, {label: number(source, entries, label) for label in CHECKED_LABELS}, x, traces[0][2])
    unit = entries.get("XUNITS", "NANOMETERS")
    if _plain(unit) not in _X:
        limit = f"has an axis in {unit or 'no unit'}; wavelengths in nm and µm and wavenumbers in 1/cm are supported"
        raise source.error("", limit, "export it as a function of wavelength or wavenumber")
    channels = _axes(unit, x)
    axis = channels[-1].name
    for name, (_, unit_y, values) in zip(unique([name for name, _, _ in traces]), traces, strict=True):
        quantity, known = _Y.get(_plain(unit_y), ("", ""))
        note = "" if known else f"the unit {unit_y} is unknown" if unit_y else _UNKNOWN_QUANTITY
        channels.append(Channel(name, quantity, known, values, axis=axis, note=note))
    return Recording(tuple(channels), provenance_of(source, kind, metadata, entries.get("instrument", "")))


def _axes(unit: str, x: FloatArray) -> list[Channel]:
    """Return the axis, followed by the wavelengths if the axis is in wavenumbers."""
    name, known = _X[_plain(unit)]
    note = (
        "wavelengths in vacuum; they are 0.03 % longer than in air because of its refractive index"
        if "VAC" in unit.upper()
        else ""
    )
    axis = Channel(name, name, known, x, note=note)
    if name == "wavelength":
        return [axis]
    with np.errstate(divide="ignore"):
        return [axis, Channel("wavelength", "wavelength", "nm", 1e7 / x, note=FROM_WAVENUMBERS)]


def _plain(unit: str) -> str:
    return re.sub(r"\s", "", unit).upper()
