"""Drawings of outlines: DXF, SVG and JSON as named strokes in mm, x to the right and z up.

A drawing is read without judgement of what its strokes form; `solen.geometry.join` chains them into closed outlines.
The layer of a DXF file, the label, class or id of an SVG element, the name in a JSON file is the name of a face.
"""

from solen.geometry.drawing.model import Drawing, Lamp, Stroke
from solen.geometry.drawing.read import read_drawing

__all__ = ["Drawing", "Lamp", "Stroke", "read_drawing"]
