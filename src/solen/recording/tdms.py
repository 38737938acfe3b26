"""TDMS files of LabVIEW, read with npTDMS (extra ``tdms``): channels with units, and the time of waveforms.

Public names: `is_tdms` and `read`.
"""

import io
import logging
from typing import Any

import numpy as np

from solen.errors import DataError
from solen.extras import need
from solen.recording.arrays import Array, recorded
from solen.recording.model import Recording
from solen.recording.source import Source

_MAGIC = b"TDSm"
_LEAD_IN = 28
_UNITS = ("unit_string", "NI_UnitDescription", "NI_unit_string", "unit")


def is_tdms(source: Source) -> bool:
    """Return whether a file begins like a TDMS file."""
    return source.data.startswith(_MAGIC)


def read(source: Source) -> Recording:
    """Read a TDMS file; raise `DataError` if npTDMS is missing, or the file is damaged or contains no numbers."""
    need("nptdms", what=str(source.path), doing="reading TDMS", otherwise="export a CSV", error=DataError)
    from nptdms import TdmsFile
    from nptdms.log import log_manager

    arrays: list[Array] = []
    log_manager.set_level(logging.ERROR)  # it would print the errors that are raised below
    try:
        file = TdmsFile.read(io.BytesIO(source.data))
        metadata = {str(key): str(value) for key, value in file.properties.items()}
        if file.file_status.incomplete_final_segment:
            raise ValueError("the last part was cut off")
        _check_segments(source.data)
        groups = file.groups()
        for group in groups:
            for channel in group.channels():
                prefix = f"{group.name}." if len(groups) > 1 else ""
                arrays += _arrays(prefix, channel)
    except Exception as bad:  # npTDMS may raise any exception at a damaged file
        limit = f"is a damaged TDMS file: {' '.join(str(bad).split())[:80] or type(bad).__name__}"
        raise source.error("", limit, "export it again") from None
    return recorded(source, "tdms", _without_repeated_times(arrays), metadata)


def _check_segments(data: bytes) -> None:
    """Raise `ValueError` if bytes were added or lost, so that the segments do not fill the file.

    Each segment begins with a lead-in of 28 bytes; the number of bytes that follow the lead-in is at byte 12.
    """
    offset = 0
    while offset < len(data):
        if data[offset : offset + len(_MAGIC)] != _MAGIC:
            raise ValueError("a segment does not begin at the end of the previous one")
        offset += _LEAD_IN + int.from_bytes(data[offset + 12 : offset + 20], "little")
    if offset != len(data):
        raise ValueError("the last segment does not end at the end of the file")


def _arrays(prefix: str, channel: Any) -> list[Array]:
    """Return a channel, preceded by the time of a waveform; time stamps become seconds since the first time stamp."""
    values = np.asarray(channel[:])
    unit = next((str(channel.properties[key]) for key in _UNITS if channel.properties.get(key)), "")
    if values.dtype.kind == "M":
        values, unit = (values - values[:1]) / np.timedelta64(1, "s"), "s"
    arrays = [Array(f"{prefix}{channel.name}", values, unit)]
    if channel.properties.get("wf_increment"):
        arrays.insert(0, Array(f"{prefix}time", np.asarray(channel.time_track()), "s"))
    return arrays


def _without_repeated_times(arrays: list[Array]) -> list[Array]:
    """Return the arrays without repetitions, which occur because each waveform has its own time."""
    kept: list[Array] = []
    for array in arrays:
        repeated = any(array.name == other.name and np.array_equal(array.values, other.values) for other in kept)
        if not repeated:
            kept.append(array)
    return kept
