"""Numerical description, for the tracer, of a lens face that varies with height."""

from typing import NamedTuple

from solen.arrays import FloatArray


class Face(NamedTuple):
    """A face in the lens's own frame, in mm.

    If ``profiles`` is empty, it is the surface |P − E| + n·D = const of a `LineFocusLens`. Otherwise it consists of
    layers between the heights ``edges`` (L + 1,), with z (L, M) and dz/dx (L, M) at M uniformly spaced positions from
    the axis to the half width. The last five numbers are bounds, with which a search for intersections finds all of
    them.
    """

    distance: float
    focus: float
    design_index: float
    ring_radius: float
    """radius of the circle about the focal line from which light seems to start; infinite if collimated in y"""
    half_width: float
    half_height: float
    base_z: float
    """depth z behind which the body is a prism"""
    min_z: float
    max_z: float
    """minimum and maximum z of the face"""
    edges: FloatArray
    profiles: FloatArray
    slopes: FloatArray
    max_bend: float
    """largest magnitude of a negative second derivative, of the optical length along a line or of the profiles with
    respect to x
    """
    max_rise: float
    max_fall: float
    """largest dz/dx of the profiles, and largest −dz/dx; 0 if none is positive"""
    max_step: float
    """largest step from one layer to the next"""
    max_layer: float
    """largest height of a layer"""
