"""Numbers of a face that is not an upright wall, for the tracer."""

from typing import NamedTuple

from solen.arrays import FloatArray


class Face(NamedTuple):
    """A face in the lens's own frame, in mm.

    It is a surface |P − E| + n·D = const where ``profiles`` is empty, else layers between ``edges`` (L + 1,) with
    z (L, M) and dz/dx (L, M) at M places evenly from the axis to the half width. The last five numbers are bounds, by
    which a search for intersections is complete.
    """

    distance: float
    focus: float
    design_index: float
    ring: float
    """radius about the focal line on which light seems to start from; infinite for light collimated in y"""
    half_width: float
    half_height: float
    base: float
    """depth z behind which the body is a prism"""
    first: float
    deepest: float
    """least and largest z of the face"""
    edges: FloatArray
    profiles: FloatArray
    slopes: FloatArray
    bend: float
    """second derivative along a line of the optical length, or of profiles by x: how far below 0 it may lie"""
    rise: float
    fall: float
    """largest dz/dx of profiles, and how far below 0 the least lies"""
    step: float
    """largest step from one layer to the next"""
    thickest: float
    """largest height of a layer"""
