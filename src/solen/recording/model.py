"""A recording made by an instrument, a person or a simulation: numeric channels with units and provenance.

A spectrum, a compression test, a working curve and bench voltages all have the same form: columns of numbers along an
axis. Numbers are kept as written in the file, in the file's unit and with gaps; code that uses a channel requests the
values in the unit it needs. The origin of the numbers is always kept: file name, checksum, format, instrument and date.

Public names: `Recording` and `Channel`.
"""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import NOTE, Caution, note, prefixed, rank_of
from solen.recording.headings import plain
from solen.results import Result, reported
from solen.units import factor

FROM_WAVENUMBERS = note("computed from the wavenumbers")
"""Note on computed wavelengths."""


class Channel(Result):
    """Values of a quantity along an axis.

    Attributes
    ----------
    name
        Name, unique within the recording: a name that occurs twice in a file is numbered, ``sample (2)``.
    quantity
        The standard name of the quantity: ``transmittance``, ``force``; empty if the file does not give it.
    unit
        As spelled in the file; ``1`` for a pure number, empty if no unit is given.
    values
        Shape (n,); NaN if the file contains no number.
    axis
        Name of the axis channel; empty for an axis itself and for columns without one.
    note
        Warnings, for example of an interrupted scan or a saturated detector.
    metadata
        Entries in the file that concern only this channel, as written there: bandwidth, scan time.
    """

    name: str
    quantity: str
    unit: str
    values: FloatArray
    axis: str = ""
    note: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)

    def to(self, unit: str) -> FloatArray:
        """Return the values in another unit; raise `DataError` if they cannot be converted to it."""
        scale = factor(self.unit, unit)
        if scale is None:
            limit = f"cannot be converted to {unit}"
            remedy = f"specify its unit in the header, as in {self.name}_{unit} or {self.name} ({unit})"
            raise DataError(f"unit of {self.name}", value=self.unit or "none", limit=limit, remedy=remedy)
        return self.values * scale

    @property
    def caution(self) -> Caution:
        """The note as a warning that names the channel."""
        return prefixed(self.name, Caution(self.note))

    def noted(self, *notes: str) -> "Channel":
        """Return a copy with further notes; empty notes are omitted."""
        ordered = sorted(filter(None, (self.note, *notes)), key=lambda text: rank_of(text) == NOTE)
        return replace(self, note="; ".join(ordered))


@dataclass(frozen=True)
class Provenance:
    """Origin of numbers: file, checksum, format, instrument.

    Attributes
    ----------
    file, sha256
        File name without the folder, and checksum of the file.
    format
        Format that was used to read the file: ``agilent-cary-csv``, ``testxpert``, ``table``.
    instrument, date
        As written in the file; empty if absent. The date is in ISO 8601 if it is unambiguous in the file.
    metadata
        All other entries in the file, as written there.
    simulated
        Whether the numbers were computed rather than measured.
    """

    file: str = ""
    sha256: str = ""
    format: str = ""
    instrument: str = ""
    date: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict, hash=False)
    simulated: bool = False

    @property
    def name(self) -> str:
        """File name for messages; ``recording`` if there is none."""
        return self.file or "recording"


class Measured(Result, kw_only=True):
    """Base class for results from files.

    Attributes
    ----------
    sources
        The files.
    warnings
        Warnings about the result.
    """

    sources: tuple[Provenance, ...] = ()
    warnings: tuple[Caution, ...] = ()

    @reported
    def simulated(self) -> bool:
        """Whether the numbers in any of the files were computed rather than measured."""
        return any(source.simulated for source in self.sources)


class Recording(Result):
    """Channels recorded together, in file order, with their provenance.

    Attributes
    ----------
    channels
        The columns of numbers.
    provenance
        The origin of the numbers.
    texts
        Text columns, and columns of numbers that label rows (replicate, orientation), keyed by name: a string for each
        row, empty if missing.
    """

    channels: tuple[Channel, ...]
    provenance: Provenance
    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return the channels and text columns over the rows, with the units of the channels."""
        channels = {channel.name: (("row",), channel.values, {"units": channel.unit}) for channel in self.channels}
        texts = {name: (("row",), np.array(values)) for name, values in self.texts.items()}
        return {**channels, **texts}, {}, {"file": self.provenance.file, "simulated": int(self.provenance.simulated)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all channels."""
        return tuple(channel.name for channel in self.channels)

    def channel(self, name: str) -> Channel:
        """Return the channel called ``name``; raise `DataError` with the most similar name if there is none."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        similar = difflib.get_close_matches(name, self.names, 1)
        remedy = f"did you mean {similar[0]}?" if similar else f"name one of {listed(self.names)}"
        raise DataError(f"trace {name}", limit=f"is not in {self.provenance.file or 'the recording'}", remedy=remedy)

    def find(self, *names: str) -> Channel | None:
        """Return the first channel whose name or quantity is one of the given names, ignoring case and spaces."""
        for name in names:
            plain_name = plain(name)
            for channel in self.channels:
                if plain_name in {plain(channel.name), plain(channel.quantity)}:
                    return channel
        return None

    def need(self, *names: str) -> Channel:
        """Return the channel that `find` returns; raise `DataError` if there is none."""
        channel = self.find(*names)
        if channel is None:
            limit = f"has no column {' or '.join(names)}"
            remedy = f"its columns are {listed(self.names)}"
            raise DataError(self.provenance.name, limit=limit, remedy=remedy)
        return channel

    def label(self, *names: str) -> tuple[str, ...] | None:
        """Return the first text column with one of the names, compared as in `find`; None if there is none."""
        for name in names:
            for column, texts in self.texts.items():
                if plain(name) == plain(column):
                    return texts
        return None

    @property
    def warnings(self) -> list[Caution]:
        """Warnings about the numbers: one for each channel that has a note."""
        return [channel.caution for channel in self.channels if channel.note]


def listed(names: Sequence[str], max_names: int = 12) -> str:
    """Return the names on one line, shortened to the first few."""
    return ", ".join(names[:max_names]) + (f" and {len(names) - max_names} more" if len(names) > max_names else "")
