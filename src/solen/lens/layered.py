"""The lens made of layers with vertical walls: every printed layer has its own profile.

Vertical walls preserve β, the index times the y-component of a ray, and in projection along y the ray obeys Snell's law
with √(n² − β²) in place of n. The emitter's ray that meets a layer at height y, at the projected distance r, has β = y
/ √(r² + y²). A profile that directs all these rays, in projection, to the focus has the normal √(1 − β²) u − √(n² − β²)
v, with u the unit vector from the emitter and v the unit vector to the focus; so

    dz/dx = −(√(1 − β²) u_x − √(n² − β²) v_x) / (√(1 − β²) u_z − √(n² − β²) v_z),    z(0) = 0,

an ordinary differential equation, because β changes along the profile. At y = 0 its solution is the Cartesian oval. The
offset between one layer and the next is a *ledge*, horizontal and a few micrometres wide.
"""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import check_range
from solen.errors import DesignError
from solen.lens.face import Face
from solen.lens.in_space import LensInSpace
from solen.ranks import note
from solen.results import reported

SAMPLES, STEPS = 257, 4
"""Number of points of a profile from the axis to its edge, and of fourth-order Runge–Kutta steps between two of
them.
"""
MAX_LAYERS = 4000
ROUNDING = 1e-6
"""Difference, as a fraction of a layer, that rounding may cause."""


class LayeredLens(LensInSpace, eq=True):
    """A lens with one profile for each layer, exact for the rays that meet the layer at its mid-height.

    Parameters
    ----------
    layer_mm
        Height of a layer. Layers start from the face on the build plate, y = half the thickness. There are as many
        layers as a printer makes of the body, and the last one extends to the body's other face.
    """

    shape_name: ClassVar[str] = "layered"

    layer_mm: float = 0.025

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("lens.layer_mm", self.layer_mm, above=0.0)
        if self.thickness_mm > MAX_LAYERS * self.layer_mm:
            limit = f"must be at least {self.thickness_mm / MAX_LAYERS:g} mm, which makes {MAX_LAYERS} layers"
            raise DesignError("lens.layer_mm", value=self.layer_mm, limit=limit)
        self._check_face()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        if self.layer_mm < self.half_height_mm:
            last_mm = float(self.edges_mm[1] - self.edges_mm[0])
            if abs(last_mm - self.layer_mm) <= ROUNDING * self.layer_mm:
                return ()
            count = f"{self.layers - 1} layers of {self.layer_mm:g} mm and a last layer of {last_mm:.4g} mm"
            return (note(f"lens.layer_mm: a body of {self.thickness_mm:g} mm has {count}"),)
        profiles = "one profile over the entire body, which makes the lens a cylinder"
        if self.layers > 1:
            profiles = f"only {self.layers} profiles over the entire body"
        return (
            f"lens.layer_mm = {self.layer_mm:g} in a body of {self.thickness_mm:g} mm: {profiles}; "
            "specify the layer height in mm",
        )

    @cached_property
    def edges_mm(self) -> FloatArray:
        """Heights y (L + 1,) of the boundaries of the layers in ascending order, including both faces of the body."""
        return layer_edges_mm(self.thickness_mm, self.layer_mm)

    @property
    def middles_mm(self) -> FloatArray:
        """Mid-heights (L,) of the layers."""
        return np.asarray(0.5 * (self.edges_mm[:-1] + self.edges_mm[1:]))

    @property
    def heights_mm(self) -> FloatArray:
        """Heights of the sections in the table, one for each layer."""
        return self.middles_mm

    @reported
    def layers(self) -> int:
        """Number of layers."""
        return len(self.middles_mm)

    @reported
    def widest_ledge_um(self) -> float:
        """Largest step between one layer and the next, along z, in micrometres."""
        return 1e3 * float(np.max(np.abs(np.diff(self.profiles[0], axis=0)), initial=0.0))

    @cached_property
    def profiles(self) -> tuple[FloatArray, FloatArray]:
        """Depth z and dz/dx (L, M) of every layer at M uniform steps from axis to half width; NaN beyond tangency."""
        heights, index = np.unique(np.round(np.abs(self.middles_mm), 12), return_inverse=True)
        z, slope = _profiles(self, np.asarray(heights, dtype=float))
        return z[index], slope[index]

    def z_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return z(x, y) of the face at lateral positions and heights, i.e. the depth of the layer at each height."""
        x, y = np.broadcast_arrays(np.abs(x_mm), y_mm)
        return self.profile_mm(self.layer_at(y), x)

    def slope_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return dz/dx of the face at lateral positions and heights of the same shape."""
        x, y = np.broadcast_arrays(x_mm, y_mm)
        a, b, p, q, t = self._cell(self.layer_at(y), x)
        step = self.half_width_mm / (self.profiles[0].shape[1] - 1)
        return np.asarray(
            np.sign(x) * (p + t * (6.0 * (b - a) - 4.0 * p - 2.0 * q + 3.0 * t * (2.0 * (a - b) + p + q))) / step
        )

    def layer_at(self, y_mm: FloatArray) -> IntArray:
        """Return the indices of the layers at given heights, in ascending order of y."""
        return np.clip(np.searchsorted(self.edges_mm, y_mm, side="right") - 1, 0, self.layers - 1).astype(np.int64)

    def profile_mm(self, layer: IntArray | int, x_mm: FloatArray) -> FloatArray:
        """Return the depth z of layers, given by index, at lateral positions; it is interpolated to 1e-9 mm."""
        a, b, p, q, t = self._cell(layer, x_mm)
        return np.asarray(a + t * (p + t * (3.0 * (b - a) - 2.0 * p - q + t * (2.0 * (a - b) + p + q))))

    def _cell(self, layer: IntArray | int, x_mm: FloatArray) -> tuple[FloatArray, ...]:
        """Return the data for cubic interpolation at each position.

        These are the depths at both ends of the interval, the slopes there multiplied by the width of the interval, and
        the fractional position within it.
        """
        z, slope = self.profiles
        step = self.half_width_mm / (z.shape[1] - 1)
        position = np.abs(x_mm) / step
        cell = np.minimum(position.astype(int), z.shape[1] - 2)
        ends = (z[layer, cell], z[layer, cell + 1], step * slope[layer, cell], step * slope[layer, cell + 1])
        return *ends, np.asarray(position - cell)

    @property
    def face(self) -> Face:
        """Numerical description of the face for the tracer."""
        optics = (self.distance_mm, self.focus_mm, self.design_index, math.inf)
        sizes = (self.half_width_mm, self.half_height_mm, self.depth_mm, self.nearest_mm, self.deepest_mm)
        return Face(*optics, *sizes, self.edges_mm, *self.profiles, *self._bounds)

    @property
    def _bounds(self) -> tuple[float, float, float, float, float]:
        """The last five fields of the face: bounds from the control points of its cubics."""
        (z, slope), width = self.profiles, self.half_width_mm / (self.profiles[0].shape[1] - 1)
        depths = np.stack(
            [z[:, :-1], z[:, :-1] + width / 3.0 * slope[:, :-1], z[:, 1:] - width / 3.0 * slope[:, 1:], z[:, 1:]]
        )
        slopes = 3.0 / width * np.diff(depths, axis=0)
        fall, bend = (max(-float(bound.min()), 0.0) for bound in (slopes, 2.0 / width * np.diff(slopes, axis=0)))
        step = float(np.max(np.abs(np.diff(depths, axis=1)), initial=0.0))
        return bend, float(slopes.max()), fall, step, float(np.diff(self.edges_mm).max())


def layer_edges_mm(thickness_mm: float, layer_mm: float) -> FloatArray:
    """Return heights y (L + 1,) of the boundaries of layers in ascending order; the last layer ends at the face."""
    edges = 0.5 * thickness_mm - layer_mm * np.arange(max(layer_count(thickness_mm, layer_mm), 1))
    return np.append(-0.5 * thickness_mm, edges[::-1])


def layer_count(height_mm: float, layer_mm: float) -> int:
    """Return the number of layers that a printer makes of a body: those whose mid-height is within it."""
    return math.ceil(height_mm / layer_mm + 0.5 - ROUNDING) - 1


def _profiles(lens: LayeredLens, heights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return depth z and dz/dx (H, SAMPLES) of the profiles at heights (H,)."""
    step = lens.half_width_mm / ((SAMPLES - 1) * STEPS)
    z, slope = np.zeros((len(heights), SAMPLES)), np.zeros((len(heights), SAMPLES))
    z_now = np.zeros(len(heights))
    for i in range(1, SAMPLES):
        for k in range(STEPS):
            x = ((i - 1) * STEPS + k) * step
            k1 = _slope(lens, x, z_now, heights)
            k2 = _slope(lens, x + 0.5 * step, z_now + 0.5 * step * k1, heights)
            k3 = _slope(lens, x + 0.5 * step, z_now + 0.5 * step * k2, heights)
            k4 = _slope(lens, x + step, z_now + step * k3, heights)
            z_now = z_now + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        z[:, i], slope[:, i] = z_now, _slope(lens, i * step * STEPS, z_now, heights)
    return z, slope


def _slope(lens: LayeredLens, x: float, z: FloatArray, y: FloatArray) -> FloatArray:
    """Return dz/dx from Snell's law in projection; NaN from where the emitter's ray is tangent to the profile."""
    to_emitter, to_focus = np.hypot(x, z + lens.distance_mm), np.hypot(x, lens.focus_mm - z)
    beta2 = y * y / (to_emitter * to_emitter + y * y)
    n1, n2 = np.sqrt(lens.outside_index**2 * (1.0 - beta2)), np.sqrt(lens.design_index**2 - beta2)
    ux, uz, vx, vz = x / to_emitter, (z + lens.distance_mm) / to_emitter, -x / to_focus, (lens.focus_mm - z) / to_focus
    beyond_tangency = n1 >= n2 * (ux * vx + uz * vz)
    return np.where(beyond_tangency, np.nan, -(n1 * ux - n2 * vx) / (n1 * uz - n2 * vz))
