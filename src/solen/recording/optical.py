"""Transmittance, reflectance and absorbance from a recording, chosen by quantity or name, on common wavelengths.

A trace need not be named if it is the only one of its kind; of several, only the named ones are used. The order of the
traces has no meaning.

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
_SAME_NM = 0.01  # wavelengths that differ by less are treated as equal
_MAX_LISTED = 20  # maximum number of names in one line
_MAX_FRACTION = 2.0  # a larger median belongs to values in percent without a unit


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
        Warnings about the spectra.
    """

    wavelength_nm: FloatArray
    rows: Mapping[str, FloatArray]
    names: Mapping[str, tuple[str, ...]]
    unused: tuple[str, ...]
    warnings: tuple[Caution, ...]

    def mean(self, kind: str) -> FloatArray:
        """Return the mean of the repeat measurements of a kind of spectrum, shape (n,)."""
        return np.asarray(self.rows[kind].mean(axis=0))


def optical_spectra(recording: Recording, chosen: Mapping[str, Sequence[str]]) -> OpticalSpectra:
    """Return the spectra chosen for ``T``, ``R`` and ``A``, by default the only one of each kind.

    Raises
    ------
    DataError
        If a trace is missing or ambiguous, or has no wavelengths.
    """
    available = spectra(recording)
    groups = _named(recording, available, chosen) if any(chosen.values()) else _by_kind(recording, available)
    traces = {kind: [_trace(kind, spectrum) for spectrum in group] for kind, group in groups.items()}
    nm = next(iter(traces.values()))[0][0]
    names = {kind: tuple(spectrum.channel.name for spectrum in group) for kind, group in groups.items()}
    channels = [spectrum.channel for group in groups.values() for spectrum in group]
    warnings = [channel.caution for channel in channels if channel.note]
    for kind, group in traces.items():
        differing = [name for name, (trace_nm, _) in zip(names[kind], group, strict=True) if not _same(nm, trace_nm)]
        if differing:
            text = "wavelengths differ from those of the first trace: interpolated linearly, masked outside their range"
            warnings.append(warning(f"{', '.join(differing)}: {text}"))
    rows = {kind: np.array([_on(nm, *trace) for trace in group]) for kind, group in traces.items()}
    used = {channel.name for channel in channels}
    others = [spectrum.channel for spectrum in available if spectrum.channel.name not in used]
    return OpticalSpectra(nm, rows, names, tuple(other.name for other in others), tuple(warnings))


def kind_of(channel: Channel) -> str | None:
    """Return ``T``, ``R`` or ``A`` (absorbance or absorptance) from the quantity, otherwise from the unit, or None."""
    if channel.quantity:
        return _QUANTITIES.get(channel.quantity)
    by_name = "A" if channel.name.casefold() == "a" else None
    return _UNITS.get(channel.unit.strip().casefold(), by_name)


def listed(names: Sequence[str]) -> str:
    """Return the names on one line, shortened to the first few."""
    remaining = len(names) - _MAX_LISTED
    return ", ".join(names[:_MAX_LISTED]) + (
        f" and {remaining} more, which solen resin spectra lists" if remaining > 0 else ""
    )


def _named(
    recording: Recording, available: Sequence[Spectrum], chosen: Mapping[str, Sequence[str]]
) -> dict[str, list[Spectrum]]:
    by_name = {spectrum.channel.name: spectrum for spectrum in available}
    groups: dict[str, list[Spectrum]] = {}
    for kind, names in chosen.items():
        for name in names:
            actual = kind_of(recording.channel(name)) or kind
            if name not in by_name or actual != kind:
                limit = f"is a trace of {actual}" if actual != kind else "has no wavelengths"
                remedy = f"name it with {OPTIONS[actual]}" if actual != kind else "name another trace"
                raise DataError(f"{OPTIONS[kind]} {name}", limit=limit, remedy=remedy)
            groups.setdefault(kind, []).append(by_name[name])
        if len(set(names)) < len(names):
            remedy = "name a separate trace for each repeat measurement"
            raise DataError(OPTIONS[kind], limit="names a trace twice", remedy=remedy)
    return groups


def _by_kind(recording: Recording, available: Sequence[Spectrum]) -> dict[str, list[Spectrum]]:
    file = recording.provenance.file or "the recording"
    groups: dict[str, list[Spectrum]] = {}
    for spectrum in available:
        if kind := kind_of(spectrum.channel):
            groups.setdefault(kind, []).append(spectrum)
    for kind, group in groups.items():
        if len(group) > 1:
            names = listed([spectrum.channel.name for spectrum in group])
            remedy = f"choose with {OPTIONS[kind]} NAME; repeat this option for repeat measurements of one spectrum"
            raise DataError(file, limit=f"contains {len(group)} {kind} traces: {names}", remedy=remedy)
    if not groups:
        limit = f"contains no transmittance; its columns are {listed(recording.names)}"
        remedy = "name the columns wavelength_nm, T and R, or choose with --transmittance NAME"
        raise DataError(file, limit=limit, remedy=remedy)
    return groups


def _trace(kind: str, spectrum: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Return the wavelengths of a trace, ascending, and its values as pure numbers."""
    nm, values, name = spectrum.wavelength_nm, _numbers(kind, spectrum), f"trace {spectrum.channel.name}"
    finite = np.isfinite(nm)
    order = np.argsort(nm[finite], kind="stable")
    nm, values = nm[finite][order], values[finite][order]
    if not np.isfinite(values).any():
        raise DataError(name, limit="contains no number")
    if not (nm > 0.0).all():
        raise DataError(name, value=f"{nm[0]:g} nm", limit="wavelengths must be greater than 0")
    repeated = np.flatnonzero(np.diff(nm) == 0.0)
    if repeated.size:
        remedy = "keep one row per wavelength, and one column per repeat measurement"
        raise DataError(name, limit=f"has {nm[repeated[0]]:g} nm twice", remedy=remedy)
    return nm, values


def _numbers(kind: str, spectrum: Spectrum) -> FloatArray:
    channel = spectrum.channel
    if kind == "A" and channel.unit.strip().casefold() in _ABSORBANCE_UNITS:
        return channel.values
    values = spectrum.ratio()
    median = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    if kind != "A" and median > _MAX_FRACTION:
        limit, remedy = "must be a fraction from 0 to 1", f"if it is in percent, write {channel.name} (%) in the header"
        raise DataError(f"median of trace {channel.name}", value=f"{median:g}", limit=limit, remedy=remedy)
    return values


def _same(nm: FloatArray, other_nm: FloatArray) -> bool:
    return other_nm.size == nm.size and bool((np.abs(other_nm - nm) < _SAME_NM).all())


def _on(nm: FloatArray, trace_nm: FloatArray, values: FloatArray) -> FloatArray:
    """Return values interpolated to other wavelengths, NaN outside the measured range."""
    return values if _same(nm, trace_nm) else np.interp(nm, trace_nm, values, left=np.nan, right=np.nan)
