"""Numerical description, for the tracer, of a face that is not a vertical wall."""

from typing import NamedTuple

from solen.arrays import FloatArray


class Face(NamedTuple):
    """A face in the lens's own frame, in mm.

    If ``profiles`` is empty, it is the surface |P − E| + n·D = const. Otherwise it consists of layers between ``edges``
    (L + 1,), with z (L, M) and dz/dx (L, M) at M uniformly spaced positions from the axis to the half width. The last
    five numbers are bounds, with which a search for intersections finds all of them.
    """

    distance: float
    focus: float
    design_index: float
    ring: float
    """radius of the circle about the focal line from which light seems to start; infinite if collimated in y"""
    half_width: float
    half_height: float
    base: float
    """depth z behind which the body is a prism"""
    first: float
    deepest: float
    """minimum and maximum z of the face"""
    edges: FloatArray
    profiles: FloatArray
    slopes: FloatArray
    bend: float
    """bound for negative second derivatives, of the optical length along a line or of the profiles with respect to x"""
    rise: float
    fall: float
    """bounds for dz/dx of the profiles: the largest value, and how far the smallest is below 0"""
    step: float
    """largest step from one layer to the next"""
    thickest: float
    """largest height of a layer"""
