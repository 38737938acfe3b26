"""Recordings: what instruments export, read into one type with units and provenance.

`solen.recording.model` holds the type.
"""

from solen.recording.model import Channel, Provenance, Recording

__all__ = ["Channel", "Provenance", "Recording"]
