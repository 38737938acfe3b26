"""Text files of Ocean Optics' programs, OceanView and SpectraSuite: a header of words, then wavelength and value.

The idea: two lines stand about the numbers, ``>>>>>Begin Spectral Data<<<<<`` and, in SpectraSuite's files, its end;
the header above states how many pixels there are, which is held against the rows. What the values are (counts, a
transmission, an absorbance) no line says; the name of the file or of the node may, and a note says so.

The interface: `is_ocean` and `read`.
"""

import re

import numpy as np

from solen.recording import dates
from solen.recording.model import Channel, Provenance, Recording
from solen.recording.numbers import parse
from solen.recording.source import Source
from solen.recording.table import is_simulated

_BEGIN = re.compile(r">+Begin (?:Processed )?Spectral Data<+")
_END = re.compile(r">+End (?:Processed )?Spectral Data<+")
_PIXELS = ("Number of Pixels in Spectrum", "Number of Pixels in Processed Spectrum", "Number of Pixels in File")
_UNSTATED = "the file does not state what its values are: counts, a transmission or an absorbance"


def is_ocean(source: Source) -> bool:
    """Whether a file has the line that stands above the numbers of these programs."""
    return b"Spectral Data<" in source.data and b">Begin " in source.data


def read(source: Source) -> Recording:
    """Recording of a spectrum; `DataError` with the line of what is damaged or not read."""
    lines = source.lines()
    begin = next((n for n, line in enumerate(lines) if _BEGIN.fullmatch(line.strip())), None)
    if begin is None:
        raise source.refused("", "has no whole line that begins its numbers", "export it again")
    metadata = _metadata(lines[:begin])
    if metadata.get("XAxis mode", "Wavelengths") != "Wavelengths":
        limit = f"has an axis of {metadata['XAxis mode']}, which is not read"
        raise source.refused("", limit, "save it along wavelengths")
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(lines[begin + 1 :], begin + 2):
        if _END.fullmatch(line.strip()):
            break
        if line.strip():
            rows.append(_row(source, number, line, rows[-1][0] if rows else -np.inf))
    pixels = next((metadata[key] for key in _PIXELS if key in metadata), str(len(rows)))
    if pixels != str(len(rows)) or not rows:
        limit = f"has {len(rows)} rows, where {pixels} pixels are stated: it was cut off or damaged"
        raise source.refused("", limit, "export it again")
    wave, value = np.array(rows, dtype=np.float64).T
    channels = (
        Channel("wavelength", "wavelength", "nm", wave),
        Channel("spectrum", "", "", value, axis="wavelength", note=_UNSTATED),
    )
    instrument = metadata.get("Spectrometer", metadata.get("Spectrometers", ""))
    provenance = Provenance(
        source.name, source.sha256, "ocean", instrument, dates.among(metadata), metadata, is_simulated(metadata)
    )
    return Recording(channels, provenance)


def _metadata(lines: list[str]) -> dict[str, str]:
    """What the header states, by its words; its first line is a title."""
    pairs = [line.partition(":") for line in lines if line.strip(" +")]
    stated = {key.strip(): value.strip() for key, colon, value in pairs if colon}
    title = next((key.strip() for key, colon, _ in pairs if not colon), "")
    return {"title": title} | stated if title else stated


def _row(source: Source, number: int, line: str, before: float) -> tuple[float, float]:
    """Wavelength and value of a line, with points or commas before their decimals; wavelengths rise."""
    cells = line.split()
    mark = "," if "," in line else "."
    try:
        wave, value = (parse(cell, mark) for cell in cells)
    except ValueError as bad:
        limit = "is no wavelength with its value" if len(cells) != 2 else str(bad)
        raise source.refused(f"line {number}", limit, "export it again", line.strip()[:40]) from None
    if not (np.isfinite(value) and wave > before):
        limit = f"does not follow {before:g} nm: wavelengths rise from line to line"
        raise source.refused(f"line {number}", limit, "export it again: lines are damaged", line.strip()[:40])
    return wave, value
