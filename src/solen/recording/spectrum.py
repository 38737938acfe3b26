"""Spectra in a recording: each trace with its wavelengths in nm.

Public names: `spectra`, `Spectrum` and `listing`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution, prefixed
from solen.recording.model import Channel, Measured, Recording
from solen.results import HIDDEN

_MAX_RATIO = 2.0  # a larger ratio of light is in percent
_MAX_NAMES = 4  # most traces that a warning names


@dataclass(frozen=True, eq=False)
class Spectrum:
    """A trace from a recording.

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
        """Return the values as pure numbers, 0.91 for 91 %.

        Raises `DataError` for another unit, or if a missing unit is needed.
        """
        channel = self.channel
        if channel.unit:
            return channel.to("1")
        top = float(np.nanmax(np.abs(channel.values), initial=0.0))
        if channel.quantity in {"transmittance", "reflectance", "absorptance"} and top > _MAX_RATIO:
            remedy = f"write {channel.name} (%) in the header if the values are in percent"
            raise DataError(channel.name, value=top, limit="has no unit and is not a fraction", remedy=remedy)
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
        Whether traces whose names differ only in the last number are repeats of the same spectrum.
    traces
        The spectra, in file order.
    """

    file: str
    format: str
    repeats: bool
    traces: tuple[Trace, ...]
    spectra: tuple[Spectrum, ...] = field(metadata=HIDDEN)


def spectra(recording: Recording) -> tuple[Spectrum, ...]:
    """Return all traces of a recording along a wavelength; raise `DataError` if there is none."""
    axes = {channel.name: channel for channel in recording.channels if channel.quantity == "wavelength"}
    found = tuple(
        Spectrum(axes[channel.axis].to("nm"), channel) for channel in recording.channels if channel.axis in axes
    )
    if not found:
        remedy = "name the wavelength column wavelength_nm" if not axes else "add a column of values"
        raise DataError(recording.provenance.name, limit="holds no spectrum", remedy=remedy)
    return found


def listing(recordings: Sequence[Recording], names: Sequence[str] = (), *, repeats: bool = False) -> Listing:
    """Return the named spectra in recordings, or all of them; raise `DataError` if a name is not found."""
    for name in names:
        there = [recording for recording in recordings if name in recording.names] or recordings
        if all(there[0].channel(name).name != spectrum.channel.name for spectrum in spectra(there[0])):
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
        traces=tuple(_trace(source.file, one) for source, one in chosen),
        spectra=tuple(one for _, one in chosen),
        sources=sources,
        warnings=tuple(text for recording in recordings for text in _remarks(recording, [one for _, one in chosen])),
    )


def _remarks(recording: Recording, chosen: Sequence[Spectrum]) -> list[Caution]:
    """Return the notes on the used channels; identical notes are merged."""
    used = {one.channel.axis for one in chosen} | {one.channel.name for one in chosen}
    remarks: dict[str, list[str]] = {}
    for channel in recording.channels:
        if channel.note and channel.name in used:
            remarks.setdefault(channel.note, []).append(channel.name)
    return [prefixed(_listed(channels), Caution(note)) for note, channels in remarks.items()]


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
    there = values[np.isfinite(values)]
    return (float(there.min()), float(there.max())) if there.size else None


def _listed(names: list[str]) -> str:
    more = len(names) - _MAX_NAMES
    return ", ".join(names[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "")
