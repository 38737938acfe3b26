"""What spectra a file holds, from the file to plain data and a figure."""

from pathlib import Path
from typing import Any

import numpy as np

from solen.errors import DataError
from solen.pipeline.outputs import check_figure, leave
from solen.recording import Recording, Spectrum, read
from solen.recording import spectra as spectra_of


def spectra(
    file: Path, *, sheet: str | None = None, traces: tuple[str, ...] = (), figure: Path | None = None
) -> dict[str, Any]:
    """Traces of a file, in their order, with what each is and how far it reaches.

    Parameters
    ----------
    file
        Any file that `solen.recording.read` takes and that holds wavelengths.
    sheet
        Of a workbook.
    traces
        Names of those that are wanted; by default all.
    figure
        Where to draw them.

    Raises
    ------
    DataError
        Where the file is damaged, holds no spectrum, or has no trace of a name.
    OutputError
        Where the figure cannot be written.
    """
    check_figure(figure)
    recording = read(file, sheet=sheet)
    chosen = _chosen(recording, traces)
    found = {
        "file": recording.provenance.file,
        "format": recording.provenance.format,
        "traces": [_told(one) for one in chosen],
        "sources": [recording.provenance.as_dict()],
        "warnings": _warnings(recording, chosen),
    }

    def draw() -> Any:
        from solen.report.resin.spectra import spectra_figure

        return spectra_figure(chosen, recording.provenance)

    return leave(found, "spectra", None, figure, draw)


def _chosen(recording: Recording, names: tuple[str, ...]) -> tuple[Spectrum, ...]:
    every = spectra_of(recording)
    for name in names:
        if recording.channel(name).name not in {one.channel.name for one in every}:
            raise DataError(f"trace {name}", limit="runs along no wavelength", remedy="name another")
    return tuple(one for one in every if not names or one.channel.name in names)


def _told(one: Spectrum) -> dict[str, Any]:
    """A trace as plain data; ranges of one without numbers are None."""
    channel = one.channel
    return {
        "name": channel.name,
        "quantity": channel.quantity or None,
        "unit": channel.unit or None,
        "points": int(channel.values.size),
        "wavelength_nm": _range(one.wavelength_nm),
        "values": _range(channel.values),
        "empty": int(np.sum(np.isnan(channel.values))),
        "note": channel.note,
    }


def _range(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float | None]:
    there = values[np.isfinite(values)]
    return [float(there.min()), float(there.max())] if there.size else [None, None]


def _warnings(recording: Recording, chosen: tuple[Spectrum, ...]) -> list[str]:
    """What must be known of the traces and their axes, each remark once, with the traces that it is about."""
    used = {one.channel.axis for one in chosen} | {one.channel.name for one in chosen}
    remarks: dict[str, list[str]] = {}
    for channel in recording.channels:
        if channel.note and channel.name in used:
            remarks.setdefault(channel.note, []).append(channel.name)
    return [f"{_listed(names)}: {note}" for note, names in remarks.items()]


def _listed(names: list[str], most: int = 4) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
