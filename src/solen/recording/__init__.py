"""Recordings: what instruments export, read into one type with units and provenance.

`read` takes a file; `solen.recording.model` holds the type.
"""

from solen.recording.model import Channel, Provenance, Recording
from solen.recording.reader import read

__all__ = ["Channel", "Provenance", "Recording", "read"]
