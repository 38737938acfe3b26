"""Recordings: files exported by instruments, read into one common type with units and provenance.

`read` reads a file; `solen.recording.model` defines the type. `spectra` returns the recording's traces with their
wavelengths, and `parameter` a parameter of a test machine's export as a number. `FORMATS` lists the supported formats;
other packages can add their own.
"""

from solen.recording.model import Channel, Measured, Provenance, Recording
from solen.recording.reader import FORMATS, Format, read, read_parts
from solen.recording.spectrum import Spectrum, spectra
from solen.recording.testxpert import parameter

__all__ = [
    "FORMATS",
    "Channel",
    "Format",
    "Measured",
    "Provenance",
    "Recording",
    "Spectrum",
    "parameter",
    "read",
    "read_parts",
    "spectra",
]
