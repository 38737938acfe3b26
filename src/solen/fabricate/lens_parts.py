"""Parts whose lens varies with height: a stack of layers, or a prism cut by a smooth face.

Heights y of a lens are measured from mid-height of the body; the build plate is at y = thickness / 2. The part of a
layered lens has a prism for each layer. The part of a smooth lens is a prism with a straight front (the blank), minus
the space in front of the face. This space is a `Hollow`, which provides the blank and the solid that is cut from it, as
triangles or as a B-spline surface.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from solen.arrays import FloatArray, IntArray
from solen.curve import Segment
from solen.errors import DesignError, SpecError
from solen.fabricate.bspline import FIT_TOLERANCE_MM
from solen.fabricate.part import Cut, Part, Prism, sensor_prism
from solen.geometry import Body, section, with_front
from solen.geometry.measures import area_mm2
from solen.lens import LayeredLens, LensInSpace
from solen.lens.build import DEFAULT_LAYER_MM
from solen.ranks import Caution, do_not_use, note, warning
from solen.spec import Design, with_values

FRONT_GAP_MM, OVERHANG_MM = 0.2, 0.02
"""Distance between the front of the blank and the face, and overhang of the hollow beyond the sides of the body."""
MIN_SPANS, MAX_SPANS = 16, 2048
"""Minimum and maximum number of grid intervals across the lens."""
GAUSS_NODES = 12
"""Number of sections of a smooth lens over which its volume is integrated."""


def cut_for(design: Design, layer_um: float) -> Design:
    """Return the design; a layered lens without a layer height or a profile gets one profile per printer layer."""
    lens = design.lens
    if lens.shape != "layered" or lens.layer_mm is not None or lens.profile is not None:
        return design
    is_default = math.isclose(1e-3 * layer_um, DEFAULT_LAYER_MM)
    return design if is_default else with_values(design, {"lens.layer_mm": round(1e-3 * layer_um, 9)})


def required_orientation(part: Part, rotation: FloatArray, layer_um: float) -> tuple[str | None, list[Caution]]:
    """Return the required orientation of a part whose lens varies with height (None for a prism), and warnings."""
    if not isinstance(part, StackedPart | FacedPart):
        return None, []
    orientation = "flat, with the faces of the body parallel to the plate: each layer contains its own lens profile"
    warnings = []
    if rotation[2, 2] != 1.0:
        text = "the lens varies with height, but in this orientation, the printed layers cut across its profiles"
        warnings.append(do_not_use(f"{text}; print the part flat"))
    if isinstance(part, StackedPart):
        profile_um = 1e3 * part.prisms[0].height_mm
        text = f"the lens has {len(part.prisms)} profiles, each {profile_um:.4g} µm high"
        if math.isclose(profile_um, layer_um, rel_tol=1e-6):
            warnings.append(note(f"{text}, as the layers of the printer"))
        else:
            warnings.append(warning(f"{text}, but the printer's layers are {layer_um:g} µm; set lens.layer_mm"))
    return orientation, warnings


def stacked(body: Body, lens: LayeredLens, thickness_mm: float) -> tuple[Prism, ...]:
    """Return a prism for each layer of a lens, from the build plate upwards."""
    heights = 0.5 * thickness_mm - lens.edges_mm[::-1]
    layers = zip(pairwise(heights.tolist()), lens.middles_mm[::-1].tolist(), strict=True)
    return tuple(
        Prism(f"layer-{i}", section(body, y).check().outlines, low, high)
        for i, ((low, high), y) in enumerate(layers, start=1)
    )


@dataclass(frozen=True)
class Hollow:
    """The space between a smooth face and the front of the blank."""

    lens: LensInSpace
    body: Body

    @property
    def front_mm(self) -> float:
        """Position z of the straight front of the blank."""
        return self.lens.nearest_mm - FRONT_GAP_MM

    @property
    def _halves(self) -> tuple[float, float]:
        return self.lens.half_width_mm, self.lens.half_height_mm

    def blank(self) -> Body:
        """Upright body with a straight front."""
        half, z = self.lens.half_width_mm, self.front_mm
        return with_front(self.body, Segment((-half, z), (half, z)))

    @cached_property
    def volume_mm3(self) -> float:
        """Volume cut from the blank, by Gauss–Legendre quadrature of exact sectional areas."""
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_NODES)
        half = 0.5 * self.lens.half_height_mm  # the face is symmetric, so half of the height suffices
        areas = [area_mm2(section(self.body, half * (1.0 + node)).outlines) for node in nodes.tolist()]
        return 4.0 * half * area_mm2(self.blank().outlines) - 2.0 * half * float(weights @ np.array(areas))

    def surface(self, tolerance_mm: float) -> tuple[FloatArray, IntArray]:
        """Return a closed surface as triangles in X, Y and Z of the part, within ``tolerance_mm`` of the face along z.

        Raises
        ------
        SpecError
            If this would require more than `MAX_SPANS` grid intervals along a side.
        """
        count = MIN_SPANS
        while True:
            x, y = (_with_overhang(np.linspace(-half, half, count + 1)) for half in self._halves)
            z = self._depth(*np.meshgrid(x, y, indexing="ij"))
            if self._error_mm(x, y, z) <= tolerance_mm:
                return self._closed(x, y, z)
            count *= 2
            if count > MAX_SPANS:
                limit = f"would require more than {MAX_SPANS} grid intervals across the lens"
                raise SpecError("--tolerance-mm", value=tolerance_mm, limit=limit, remedy="use a larger tolerance")

    def fitted(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a cubic B-spline within `FIT_TOLERANCE_MM` of the face: control points (N, N, 3), x knots, y knots.

        Raises
        ------
        DesignError
            If the face ends just outside the aperture, or would require more than `MAX_SPANS` spans along a side.
        """
        count = MIN_SPANS
        while count <= MAX_SPANS:
            x, y = (np.linspace(-half - OVERHANG_MM, half + OVERHANG_MM, count + 1) for half in self._halves)
            z = self._continued(*np.meshgrid(x, y, indexing="ij"))
            along_x = make_interp_spline(x, z, k=3)
            along_y = make_interp_spline(y, along_x.c.T, k=3)
            control, x_knots, y_knots = along_y.c.T, along_x.t, along_y.t
            between = [0.5 * (grid[1:] + grid[:-1]) for grid in (x, y)]
            depth = BSpline(y_knots, BSpline(x_knots, control, 3)(between[0]).T, 3)(between[1]).T
            if np.max(np.abs(depth - self._continued(*np.meshgrid(*between, indexing="ij")))) <= FIT_TOLERANCE_MM:
                return self._control_points(control, x_knots, y_knots), x_knots, y_knots
            count *= 2
        limit = (
            f"cannot be approximated within {FIT_TOLERANCE_MM:g} mm by a B-spline of {MAX_SPANS} by {MAX_SPANS} spans"
        )
        raise DesignError("lens", limit=limit, remedy="export a mesh")

    def _control_points(self, control: FloatArray, x_knots: FloatArray, y_knots: FloatArray) -> FloatArray:
        """Return control points in X, Y and Z of the part; X and Z are means of knots, so that both are linear."""
        x, y = (np.array([knots[i + 1 : i + 4].mean() for i in range(len(knots) - 4)]) for knots in (x_knots, y_knots))
        across, up = np.meshgrid(x, y, indexing="ij")
        return np.stack([across, control, self.lens.half_height_mm - up], axis=-1)

    def _depth(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return z of the face, continued at constant depth beyond its edges."""
        half, up = self._halves
        return self.lens.z_at(np.clip(x, -half, half), np.clip(y, -up, up))

    def _continued(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return z of the face from its formula, also for points beyond its edges."""
        z = self.lens.z_at(x, y)
        if np.isnan(z).any():
            limit = (
                f"has a face that ends within {OVERHANG_MM:g} mm of the edge of the aperture, too close for a STEP file"
            )
            raise DesignError("lens", limit=limit, remedy="reduce lens.half_width_mm, or export a mesh")
        return z

    def _error_mm(self, x: FloatArray, y: FloatArray, z: FloatArray) -> float:
        """Return the maximum deviation of the triangles from the face, at the midpoints of their sides."""
        middle_x, middle_y = 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])
        sides = (
            (middle_x, y, 0.5 * (z[1:] + z[:-1])),
            (x, middle_y, 0.5 * (z[:, 1:] + z[:, :-1])),
            (middle_x, middle_y, 0.5 * (z[1:, 1:] + z[:-1, :-1])),
        )
        return max(float(np.abs(self._depth(*np.meshgrid(a, b, indexing="ij")) - flat).max()) for a, b, flat in sides)

    def _closed(self, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return closed triangles: the face, a plane in front of the blank, and the sides between them."""
        across, up = np.meshgrid(x, self.lens.half_height_mm - y, indexing="ij")
        plane = np.full_like(z, self.front_mm - FRONT_GAP_MM)
        vertices = np.vstack([np.column_stack([across.ravel(), depth.ravel(), up.ravel()]) for depth in (z, plane)])
        number = np.arange(z.size).reshape(z.shape)
        a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
        face = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        ring = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
        following = np.roll(ring, -1)
        rim = [
            np.column_stack([following, ring, ring + z.size]),
            np.column_stack([following, ring + z.size, following + z.size]),
        ]
        return vertices, np.vstack([face, face[:, ::-1] + z.size, *rim]).astype(np.int64)


def _with_overhang(grid: FloatArray) -> FloatArray:
    """Return the grid points with one more beyond each end."""
    return np.concatenate([[grid[0] - OVERHANG_MM], grid, [grid[-1] + OVERHANG_MM]])


@dataclass(frozen=True)
class StackedPart(Part):
    """A part that consists of layers, each of them a prism and a separate solid."""


@dataclass(frozen=True, kw_only=True)
class FacedPart(Part):
    """A part with a single prism, the blank, minus the space in front of a smooth face."""

    hollow: Hollow

    @property
    def volume_mm3(self) -> float:
        """See `Part.volume_mm3`."""
        return super().volume_mm3 - self.hollow.volume_mm3


def faced_part(name: str, body: Body, thickness_mm: float, cuts: tuple[Cut, ...]) -> Part:
    """Return the part of a body whose lens varies with height; its cuts must not reach the lens."""
    if body.front is None:
        raise AssertionError("a part with a prismatic lens has no face that varies with height")
    lens = body.front.lens
    if isinstance(lens, LayeredLens):
        return StackedPart(name, stacked(body, lens, thickness_mm), cuts)
    hollow = Hollow(lens, body)
    return FacedPart(name, (sensor_prism(hollow.blank(), thickness_mm),), cuts, hollow=hollow)
