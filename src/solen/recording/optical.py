"""Transmittance, reflectance and absorbance from a recording, chosen by quantity or name, on common wavelengths.

The only trace of a kind is used without being named; if there are several, the user must name those to use, and only
these are used. The order of the traces has no meaning.

Public names: `optical_spectra`, `OpticalSpectra` and `kind_of`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution, warning
from solen.recording.model import Channel, Recording
from solen.recording.spectrum import Spectrum, spectra

OPTIONS = {"T": "--transmittance", "R": "--reflectance", "A": "--absorbance"}
_QUANTITIES = {"transmittance": "T", "reflectance": "R", "absorbance": "A", "absorptance": "A"}
_UNITS = {"%t": "T", "%r": "R", "abs": "A"}
_ABSORBANCE_UNITS = ("abs", "au", "a.u.", "a")
_SAME_NM = 0.01  # wavelengths that differ by less are the same
_MAX_LISTED = 20  # most names in one line
_MAX_FRACTION = 2.0  # a median above this is a percentage without its unit


@dataclass(frozen=True, eq=False)
class OpticalSpectra:
    """Spectra on common wavelengths.

    Attributes
    ----------
    wavelength_nm
        Shape (n,), ascending.
    rows
        The chosen traces for each of ``T``, ``R`` and ``A`` that is present, shape (repeats, n); NaN for missing
        numbers.
    names
        Names of these traces.
    unused
        Names of the spectra that were not chosen.
    warnings
        Warnings as sentences.
    """

    wavelength_nm: FloatArray
    rows: Mapping[str, FloatArray]
    names: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...]
    warnings: tuple[Caution, ...]

    def mean(self, kind: str) -> FloatArray:
        """Return the mean of the repeats for a kind of spectrum, shape (n,)."""
        return np.asarray(self.rows[kind].mean(axis=0))


def optical_spectra(recording: Recording, chosen: Mapping[str, Sequence[str]]) -> OpticalSpectra:
    """Return the spectra named for ``T``, ``R`` and ``A``, or by default the only one of each kind.

    Raises
    ------
    DataError
        If a trace is missing or ambiguous, or has no wavelengths.
    """
    available = spectra(recording)
    groups = _named(recording, available, chosen) if any(chosen.values()) else _only(recording, available)
    traces = {kind: [_trace(kind, spectrum) for spectrum in group] for kind, group in groups.items()}
    nm = next(iter(traces.values()))[0][0]
    names = {kind: tuple(spectrum.channel.name for spectrum in group) for kind, group in groups.items()}
    taken = [spectrum.channel for group in groups.values() for spectrum in group]
    warnings = [channel.remark for channel in taken if channel.note]
    for kind, group in traces.items():
        moved = [name for name, (own, _) in zip(names[kind], group, strict=True) if not _same(nm, own)]
        if moved:
            what = (
                "different wavelengths from the first trace: interpolated linearly, masked outside the measured range"
            )
            warnings.append(warning(f"{', '.join(moved)} has {what}"))
    rows = {kind: np.array([_on(nm, *trace) for trace in group]) for kind, group in traces.items()}
    used = {channel.name for channel in taken}
    others = [spectrum.channel for spectrum in available if spectrum.channel.name not in used]
    return OpticalSpectra(nm, rows, names, tuple(other.name for other in others), tuple(warnings))


def kind_of(channel: Channel) -> str | None:
    """Return ``T``, ``R`` or ``A`` (absorbance or absorptance) from a quantity, or else from a unit; or None."""
    if channel.quantity:
        return _QUANTITIES.get(channel.quantity)
    by_name = "A" if channel.name.casefold() == "a" else None
    return _UNITS.get(channel.unit.strip().casefold(), by_name)


def listed(names: Sequence[str]) -> str:
    """Return the names on one line, shortened to the first few."""
    more = len(names) - _MAX_LISTED
    return ", ".join(names[:_MAX_LISTED]) + (f" and {more} more, which solen resin spectra lists" if more > 0 else "")


def _named(
    recording: Recording, available: Sequence[Spectrum], chosen: Mapping[str, Sequence[str]]
) -> dict[str, list[Spectrum]]:
    by_name = {spectrum.channel.name: spectrum for spectrum in available}
    groups: dict[str, list[Spectrum]] = {}
    for kind, names in chosen.items():
        for name in names:
            other = kind_of(recording.channel(name)) or kind
            if name not in by_name or other != kind:
                limit = f"is a {other} trace" if other != kind else "has no wavelengths"
                remedy = f"name it with {OPTIONS[other]}" if other != kind else "name another"
                raise DataError(f"{OPTIONS[kind]} {name}", limit=limit, remedy=remedy)
            groups.setdefault(kind, []).append(by_name[name])
        if len(set(names)) < len(names):
            raise DataError(
                OPTIONS[kind], limit="names a trace twice", remedy="each repeat must be a separate spectrum"
            )
    return groups


def _only(recording: Recording, available: Sequence[Spectrum]) -> dict[str, list[Spectrum]]:
    file = recording.provenance.file or "the recording"
    groups: dict[str, list[Spectrum]] = {}
    for spectrum in available:
        if kind := kind_of(spectrum.channel):
            groups.setdefault(kind, []).append(spectrum)
    for kind, group in groups.items():
        if len(group) > 1:
            names = listed([spectrum.channel.name for spectrum in group])
            remedy = f"choose with {OPTIONS[kind]} NAME, used several times for repeats of the same spectrum"
            raise DataError(file, limit=f"contains {len(group)} {kind} traces: {names}", remedy=remedy)
    if not groups:
        limit = f"contains no transmittance; its columns are {listed(recording.names)}"
        remedy = "name the columns wavelength_nm, T and R, or choose with --transmittance NAME"
        raise DataError(file, limit=limit, remedy=remedy)
    return groups


def _trace(kind: str, spectrum: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Return the wavelengths of a trace, ascending, and its values as pure numbers."""
    nm, values, what = spectrum.wavelength_nm, _numbers(kind, spectrum), f"trace {spectrum.channel.name}"
    seen = np.isfinite(nm)
    order = np.argsort(nm[seen], kind="stable")
    nm, values = nm[seen][order], values[seen][order]
    if not np.isfinite(values).any():
        raise DataError(what, limit="holds no number")
    if not (nm > 0.0).all():
        raise DataError(what, value=f"{nm[0]:g} nm", limit="wavelengths must be greater than 0")
    twice = np.flatnonzero(np.diff(nm) == 0.0)
    if twice.size:
        remedy = "keep one row per wavelength; repeats belong in columns"
        raise DataError(what, limit=f"has {nm[twice[0]]:g} nm twice", remedy=remedy)
    return nm, values


def _numbers(kind: str, spectrum: Spectrum) -> FloatArray:
    channel = spectrum.channel
    if kind == "A" and channel.unit.strip().casefold() in _ABSORBANCE_UNITS:
        return channel.values
    values = spectrum.ratio()
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    if kind != "A" and middle > _MAX_FRACTION:
        limit, remedy = "a fraction is between 0 and 1", f"write the unit in the header: {channel.name} (%)"
        raise DataError(f"trace {channel.name}", value=f"its median is {middle:g}", limit=limit, remedy=remedy)
    return values


def _same(nm: FloatArray, own: FloatArray) -> bool:
    return own.size == nm.size and bool((np.abs(own - nm) < _SAME_NM).all())


def _on(nm: FloatArray, own: FloatArray, values: FloatArray) -> FloatArray:
    """Return values interpolated to other wavelengths, NaN outside the measured range."""
    return values if _same(nm, own) else np.interp(nm, own, values, left=np.nan, right=np.nan)
