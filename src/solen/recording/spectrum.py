"""Spectra in a recording: each trace with its wavelengths in nm.

Public names: `spectra`, `Spectrum` and `listing`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution, prefixed
from solen.recording.model import Channel, Measured, Recording, listed
from solen.results import HIDDEN

_MAX_RATIO = 2.0  # larger ratios of light are in percent
_MAX_NAMES = 4  # maximum number of traces that a warning names


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A trace of a recording with its wavelengths.

    Attributes
    ----------
    wavelength_nm
        Shape (n,), in file order, which may be descending.
    channel
        The trace: name, quantity, unit, values of shape (n,) and note.
    """

    wavelength_nm: FloatArray
    channel: Channel

    def ratio(self) -> FloatArray:
        """Return the values as pure numbers, 0.91 for 91 %; raise `DataError` if the unit is another one or missing."""
        channel = self.channel
        if channel.unit:
            return channel.to("1")
        top = float(np.nanmax(np.abs(channel.values), initial=0.0))
        if channel.quantity in {"transmittance", "reflectance", "absorptance"} and top > _MAX_RATIO:
            remedy = f"write {channel.name} (%) in the header if the values are in percent"
            raise DataError(channel.name, value=top, limit="has no unit, and is not a fraction", remedy=remedy)
        return channel.values


@dataclass(frozen=True)
class Trace:
    """Name, quantity, unit and range of a spectrum.

    Attributes
    ----------
    file, name
        Names of the file and of the trace.
    quantity, unit
        Quantity and unit; null if the file does not give them.
    points, empty
        Number of points, and number of points without a value.
    range_nm, range_values
        Minimum and maximum wavelength and value; null if there are no numbers.
    note
        Warnings.
    """

    file: str
    name: str
    quantity: str | None
    unit: str | None
    points: int
    empty: int
    range_nm: tuple[float, float] | None
    range_values: tuple[float, float] | None
    note: str


class Listing(Measured, kw_only=True):
    """The spectra in one or more files.

    Attributes
    ----------
    file, format
        Names of the files, and the formats that were used to read them.
    repeats
        Whether traces whose names differ only in the last number are treated as repeats.
    traces
        The spectra, in file order.
    """

    file: str
    format: str
    repeats: bool
    traces: tuple[Trace, ...]
    spectra: tuple[Spectrum, ...] = field(metadata=HIDDEN)


def spectra(recording: Recording) -> tuple[Spectrum, ...]:
    """Return all traces of a recording that have wavelengths; raise `DataError` if there is none."""
    axes = {channel.name: channel for channel in recording.channels if channel.quantity == "wavelength"}
    traces = tuple(
        Spectrum(axes[channel.axis].to("nm"), channel) for channel in recording.channels if channel.axis in axes
    )
    if not traces:
        remedy = "name the wavelength column wavelength_nm" if not axes else "add a column of values"
        raise DataError(recording.provenance.name, limit="contains no spectrum", remedy=remedy)
    return traces


def listing(recordings: Sequence[Recording], names: Sequence[str] = (), *, repeats: bool = False) -> Listing:
    """Return the named spectra in recordings, or all of them; raise `DataError` if a name is not found."""
    for name in names:
        holding = [recording for recording in recordings if name in recording.names] or recordings
        if all(holding[0].channel(name).name != spectrum.channel.name for spectrum in spectra(holding[0])):
            raise DataError(f"trace {name}", limit="has no wavelengths", remedy="name another")
    chosen = [
        (recording.provenance, spectrum)
        for recording in recordings
        for spectrum in spectra(recording)
        if not names or spectrum.channel.name in names
    ]
    sources = tuple(recording.provenance for recording in recordings)
    return Listing(
        file=", ".join(source.file for source in sources),
        format=", ".join(dict.fromkeys(source.format for source in sources)),
        repeats=repeats,
        traces=tuple(_trace(source.file, spectrum) for source, spectrum in chosen),
        spectra=tuple(spectrum for _, spectrum in chosen),
        sources=sources,
        warnings=tuple(
            text for recording in recordings for text in _cautions(recording, [spectrum for _, spectrum in chosen])
        ),
    )


def _cautions(recording: Recording, chosen: Sequence[Spectrum]) -> list[Caution]:
    """Return the notes on the used channels as warnings; identical notes are merged."""
    used = {name for spectrum in chosen for name in (spectrum.channel.axis, spectrum.channel.name)}
    names_by_note: dict[str, list[str]] = {}
    for channel in recording.channels:
        if channel.note and channel.name in used:
            names_by_note.setdefault(channel.note, []).append(channel.name)
    return [prefixed(listed(channels, _MAX_NAMES), Caution(note)) for note, channels in names_by_note.items()]


def _trace(file: str, spectrum: Spectrum) -> Trace:
    channel = spectrum.channel
    return Trace(
        file=file,
        name=channel.name,
        quantity=channel.quantity or None,
        unit=channel.unit or None,
        points=int(channel.values.size),
        empty=int(np.sum(np.isnan(channel.values))),
        range_nm=_range(spectrum.wavelength_nm),
        range_values=_range(channel.values),
        note=channel.note,
    )


def _range(values: FloatArray) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None
