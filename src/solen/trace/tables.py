"""A scene as arrays: the interface between the description of a scene and the compiled tracing.

There is one row per curve piece: its kind, its parameters (named in `solen.trace.kernel.rows`), its behaviour, the
regions on its two sides and its receiver. Most curves are one piece; a spline has one piece for each of its cubics. To
add a type of curve, add a class in `solen.curve`, a row here and a function in `solen.trace.kernel.hits`.
"""

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import IntArray
from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.errors import DesignError
from solen.plane import Point, cross, dot, minus, right_of, unit
from solen.scene import Interface, Scene
from solen.scene.model import BEHAVIOURS
from solen.scene.surface import AngleTable, Gaussian, HarveyShack, Lambertian, Scatter, ScatterTable, Surface
from solen.trace.grid import grid_of
from solen.trace.kernel import rows

WIDTH = len(rows.Oval._fields)
LAYER_WIDTH = 5
CORNER_RAD = 1e-6
"""Largest angle at which a joint of two cubics counts as smooth."""
BOX_MARGIN_MM, BOX_MARGIN = 1e-6, 1e-6
"""Margin of a box around its curve, absolute and relative, which exceeds rounding errors in either precision."""
MIN_SINE = 1e-9
"""Sine of the angle between two lines below which they are treated as parallel."""
EFFICIENCY_ROUNDING = 1e-9
Row = tuple[float, ...]


class Tables(NamedTuple):
    """All data of a scene for the kernel, as arrays: P curve pieces, R regions, W wavelengths, M monitors."""

    kind: IntArray
    """(P,) kind of curve"""
    shape: NDArray[np.floating[Any]]
    """(P, WIDTH) parameters of the curve piece"""
    middle: NDArray[np.floating[Any]]
    """(P, 2) midpoint"""
    box: NDArray[np.floating[Any]]
    """(P, 4) lowest and highest x, lowest and highest z, with a margin"""
    owner: IntArray
    """(P,) index of the interface"""
    previous: IntArray
    """(P,) index of the piece of the same curve that it continues smoothly, −1 at the start of the curve or at a
    corner
    """
    behaviour: IntArray
    """(P,) index into BEHAVIOURS, increased by TREATED if the surface is not smooth, clean and bare"""
    treatment: IntArray
    """(P,) row of ``treatments``, −1 for none"""
    left: IntArray
    """(P,) region on the left"""
    right: IntArray
    """(P,) region on the right"""
    receiver: IntArray
    """(P,) index of the receiver, −1 for none"""
    height: NDArray[np.floating[Any]]
    """(P, 2) lowest and highest y of a receiver, mm"""
    refractive_index: NDArray[np.floating[Any]]
    """(W, R) refractive index by wavelength"""
    absorption: NDArray[np.floating[Any]]
    """(W, R) absorption coefficient per mm"""
    scattering: NDArray[np.floating[Any]]
    """(W, R) scattering coefficient per mm"""
    anisotropy: NDArray[np.floating[Any]]
    """(W, R) mean cosine of the scattering angle"""
    wavelength: NDArray[np.floating[Any]]
    """(W,) nm; NaN if no source has a spectrum"""
    treatments: NDArray[np.floating[Any]]
    """(T, 21) treated surfaces"""
    layers: NDArray[np.floating[Any]]
    """(L, 5) rows of films (index, extinction, thickness in nm), of tables (angle of incidence in rad, fractions
    reflected in s and p, fractions transmitted in s and p), of gratings (order, fraction) and of scatter profiles
    (offset, density, cumulative envelopes in the plane and in space)
    """
    monitor: NDArray[np.floating[Any]]
    """(M, 5) start x, z, unit direction x, z, length"""
    bins: IntArray
    """(M,) number of map bins"""
    first_bin: IntArray
    """(M,) start of each map in the array of all maps"""
    grid_low: NDArray[np.floating[Any]]
    """(2,) lowest x and z of the grid"""
    grid_cell: NDArray[np.floating[Any]]
    """(2,) size of a grid cell"""
    grid_count: IntArray
    """(2,) number of grid cells along x and z"""
    grid_first: IntArray
    """(cells + 1,) start of the pieces of each cell in ``grid_item``"""
    grid_item: IntArray
    """indices of pieces by cell; empty if every piece is tested"""


def compile_scene(scene: Scene, dtype: type[np.floating[Any]] = np.float64) -> Tables:
    """Return the arrays of a scene in double or single precision; `DesignError` if a curve has no compiled form."""
    regions = {region.name: number for number, region in enumerate(scene.regions)}
    receivers: dict[str | None, int] = {name: number for number, name in enumerate(scene.receivers)}
    receivers[None] = -1
    numbered = [(i, piece) for i, interface in enumerate(scene.interfaces) for piece in _pieces(interface.curve)]
    owner, pieces = [i for i, _ in numbered], [piece for _, piece in numbered]
    interfaces = [scene.interfaces[i] for i in owner]
    colours = scene.wavelengths_nm or (None,)
    bins = np.array([monitor.bins for monitor in scene.monitors], dtype=np.int64)
    curves = [piece.curve for piece in pieces]
    cells = grid_of(curves)
    treatment, treatments, layers = _treatments(scene)
    return Tables(
        kind=_integers(piece.kind for piece in pieces),
        shape=np.array([piece.row for piece in pieces], dtype).reshape(-1, WIDTH),
        middle=np.array([piece.middle for piece in pieces], dtype).reshape(-1, 2),
        box=np.array([piece.box for piece in pieces], dtype).reshape(-1, 4),
        owner=_integers(owner),
        previous=_previous(scene.interfaces, owner, curves),
        behaviour=_integers(
            BEHAVIOURS.index(interface.behaviour) + rows.TREATED * (treatment[i] >= 0)
            for i, interface in zip(owner, interfaces, strict=True)
        ),
        treatment=_integers(treatment[i] for i in owner),
        left=_integers(regions[interface.left] for interface in interfaces),
        right=_integers(regions[interface.right] for interface in interfaces),
        receiver=_integers(receivers[interface.receiver] for interface in interfaces),
        height=np.array([i.height_mm or (-math.inf, math.inf) for i in interfaces], dtype).reshape(-1, 2),
        refractive_index=np.array([[region.index_at(nm) for region in scene.regions] for nm in colours], dtype),
        absorption=np.array([[region.absorption_per_mm for region in scene.regions] for _ in colours], dtype),
        scattering=np.array([[region.scattering_per_mm for region in scene.regions] for _ in colours], dtype),
        anisotropy=np.array([[region.anisotropy for region in scene.regions] for _ in colours], dtype),
        wavelength=np.array([math.nan if nm is None else nm for nm in colours], dtype),
        treatments=np.array(treatments, dtype).reshape(-1, len(rows.Treatment._fields)),
        layers=np.array([row + (0.0,) * (LAYER_WIDTH - len(row)) for row in layers], dtype).reshape(-1, LAYER_WIDTH),
        monitor=np.array([_segment(monitor.segment) for monitor in scene.monitors], dtype).reshape(-1, 5),
        bins=bins,
        first_bin=np.cumsum(bins) - bins,
        grid_low=cells.low.astype(dtype),
        grid_cell=cells.cell.astype(dtype),
        grid_count=cells.shape,
        grid_first=cells.first,
        grid_item=cells.item,
    )


def _integers(numbers: Iterable[int]) -> IntArray:
    return np.array(list(numbers), dtype=np.int64)


def _treatments(scene: Scene) -> tuple[list[int], list[rows.Treatment], list[Row]]:
    """Return the index of the treatment of each interface (or −1), the treatments, and the rows of ``layers``."""
    indices: list[int] = []
    treatments: list[rows.Treatment] = []
    layers: list[Row] = []
    for interface in scene.interfaces:
        surface = interface.surface
        indices.append(-1 if surface is None else len(treatments))
        if surface is not None:
            tables = (_table(surface.table), _table(surface.table_right))
            lists = (_films(surface), *tables, _orders(surface), _profile(surface.scatter))
            treatments.append(_treatment(surface, len(layers), *map(len, lists)))
            layers += [row for rows_of in lists for row in rows_of]
    return indices, treatments, layers


def _films(surface: Surface) -> list[Row]:
    films = surface.coating.layers if surface.coating else ()
    return [(film.index, film.extinction, film.thickness_nm) for film in films]


def _table(table: AngleTable | None) -> list[Row]:
    return [] if table is None else [(math.radians(row[0]), *row[1:]) for row in table.rows]


def _orders(surface: Surface) -> list[Row]:
    """Return the rows of grating orders; raise `DesignError` if the orders have more power than incident light."""
    if surface.grating is None:
        return []
    total = math.fsum(efficiency for _, efficiency in surface.grating.orders)
    if total > 1.0 + EFFICIENCY_ROUNDING:
        limit = f"their efficiencies add up to {total:.6g}, but the sum must be at most 1"
        raise DesignError("grating orders", limit=limit, remedy="reduce the efficiencies")
    return [(float(order), efficiency) for order, efficiency in surface.grating.orders]


def _profile(scatter: Scatter | None) -> list[Row]:
    """Return the rows of a tabulated profile, with cumulative sums of its envelope in the plane and in space."""
    if not isinstance(scatter, ScatterTable):
        return []
    offset, density = np.array(scatter.offset), np.array(scatter.density)
    envelope = np.maximum(density[1:], density[:-1])
    plane, space = (np.cumsum([0.0, *(envelope * np.diff(offset**power))]) for power in (1, 2))
    columns = (offset, density, plane / plane[-1], space / space[-1])
    return list(zip(*(column.tolist() for column in columns), strict=True))


def _treatment(
    surface: Surface, first: int, films: int, left: int, right: int, orders: int, offset_count: int
) -> rows.Treatment:
    low, high = sorted(surface.band_nm) if surface.band_nm else (-math.inf, math.inf)
    scatter, texture, grating = surface.scatter, surface.texture, surface.grating
    kind, width, wing = rows.SMOOTH, 0.0, 0.0
    if isinstance(scatter, Lambertian):
        kind = rows.LAMBERTIAN
    elif isinstance(scatter, Gaussian):
        kind, width = rows.GAUSSIAN, scatter.sigma
    elif isinstance(scatter, HarveyShack):
        kind, width, wing = rows.HARVEY_SHACK, scatter.shoulder, scatter.slope
    elif scatter is not None:
        kind = rows.BY_TABLE
    lines = 0.0 if grating is None else 1e-6 * grating.lines_per_mm
    return rows.Treatment(
        reflectance=surface.reflectance,
        transmitted=surface.transmitted,
        focal=surface.focal_mm or 0.0,
        partial=float(surface.partial),
        band_low=low,
        band_high=high,
        band_within=float(surface.band_nm is None or surface.band_nm[0] <= surface.band_nm[1]),
        scatter=float(kind),
        width=width,
        wing=wing,
        scatter_fraction=0.0 if scatter is None else scatter.share,
        tilt=texture.slope if texture else 0.0,
        across=float(texture is not None and texture.direction == "across"),
        first_layer=float(first),
        layers=float(films),
        first_row=float(first + films),
        rows=float(left + orders),
        rows_right=float(right),
        lines=-lines if grating is not None and grating.mirrored else lines,
        first_offset=float(first + films + left + right + orders),
        offset_count=float(offset_count),
    )


def _previous(interfaces: tuple[Interface, ...], owner: list[int], curves: list[Curve]) -> IntArray:
    """Return the piece that each piece continues smoothly; in a closed curve the first piece follows the last."""
    previous = [piece - 1 if piece and owner[piece - 1] == i else -1 for piece, i in enumerate(owner)]
    last = {i: piece for piece, i in enumerate(owner)}
    for piece, i in enumerate(owner):
        curve = interfaces[i].curve
        if previous[piece] < 0 and isinstance(curve, Spline | Bezier) and curve.closed:
            previous[piece] = last[i]
        if previous[piece] >= 0 and not _join_smoothly(curves[previous[piece]], curves[piece]):
            previous[piece] = -1
    return _integers(previous)


def _join_smoothly(first: Curve, second: Curve) -> bool:
    """Whether two pieces join smoothly, so that a ray starting at the joint on one of them may meet the other."""
    if not (isinstance(first, Bezier) and isinstance(second, Bezier)):
        return False
    before, after = unit(minus(first.b, first.control_b)), unit(minus(second.control_a, second.a))
    return dot(before, after) > 0.0 and abs(cross(before, after)) < CORNER_RAD


class _Piece(NamedTuple):
    """A piece of a curve and its entries in the tables."""

    kind: int
    row: Row
    middle: Point
    box: Row
    curve: Curve


@lru_cache(maxsize=4096)
def _pieces(curve: Curve) -> tuple[_Piece, ...]:
    """Return the pieces of a curve, cached because most curves do not change from one scene of a sweep to the next."""
    if isinstance(curve, Spline | Bezier):
        parts = _cubics(curve)
    elif type(curve) in ROWS:
        kind, row_of = ROWS[type(curve)]
        parts = [(kind, row_of(curve), curve)]
    else:
        known = ", ".join(cls.__name__ for cls in COMPILED)
        raise DesignError(
            "curve", value=type(curve).__name__, limit=f"the compiled engine supports {known}", remedy="use one of them"
        )
    return tuple(
        _Piece(kind, tuple(row) + (0.0,) * (WIDTH - len(row)), part.middle_point, _box(part, row), part)
        for kind, row, part in parts
    )


def _box(curve: Curve, row: Row) -> Row:
    """Return the bounding box of a curve, with a margin for its extension beyond the ends and for rounding."""
    x, z = zip(*_hull(curve, row), strict=True)
    low_x, high_x, low_z, high_z = min(x), max(x), min(z), max(z)
    margin = BOX_MARGIN_MM + BOX_MARGIN * max(abs(low_x), abs(high_x), abs(low_z), abs(high_z))
    return (low_x - margin, high_x + margin, low_z - margin, high_z + margin)


def _hull(curve: Curve, row: Row) -> tuple[Point, ...]:
    """Return points whose convex hull contains a curve."""
    if isinstance(row, rows.Oval):
        return ((row.ax, row.az), (row.bx, row.bz), (row.cx, row.cz), (row.dx, row.dz))
    if isinstance(curve, Segment):
        return (curve.a, curve.b)
    if isinstance(curve, Bezier):
        return (curve.a, curve.control_a, curve.control_b, curve.b)
    if isinstance(curve, Arc) and curve.half_deg > 80.0:
        (x, z), r = curve.center, curve.radius_mm
        return ((x - r, z - r), (x + r, z + r))
    return _tangent_hull(curve)


def _tangent_hull(curve: Curve) -> tuple[Point, Point, Point, Point]:
    """Return the ends of a convex curve, and the intersections of its end tangents with its midpoint tangent."""
    points = [(float(x), float(z)) for x, z in curve.points(np.array([0.0, 0.5, 1.0]))]
    tangents = [right_of(curve.normal_at(point)) for point in points]
    corners = [_intersection(points[i], tangents[i], points[i + 1], tangents[i + 1]) for i in range(2)]
    return (points[0], corners[0], corners[1], points[2])


def _segment(curve: Segment) -> rows.Segment:
    return rows.Segment(*curve.a, *unit(minus(curve.b, curve.a)), curve.length_mm)


def _arc(curve: Arc) -> rows.Arc:
    side = 1.0 if curve.sweep_deg > 0 else -1.0
    end = curve.radius_mm * math.sin(math.radians(curve.half_deg))
    return rows.Arc(*curve.center, curve.radius_mm, *curve.middle, end, side, float(curve.half_deg <= 90.0))


def _parabola(curve: Parabola) -> rows.Conic:
    """Return the row of a parabola; the lateral direction is reversed, so that w is the depth."""
    lateral = (-curve.axis[0], -curve.axis[1])
    low, high = sorted((-curve.from_mm, -curve.to_mm))
    side = 1.0 if curve.to_mm < curve.from_mm else -1.0
    return rows.Conic(*curve.vertex, *lateral, 2.0 * curve.curve_per_mm, 0.0, low, high, side)


def _conic(curve: Conic) -> rows.Conic:
    low, high = sorted((curve.from_mm, curve.to_mm))
    side = 1.0 if curve.to_mm > curve.from_mm else -1.0
    c, lateral = curve.curvature_per_mm, right_of(curve.axis)
    return rows.Conic(*curve.vertex, *lateral, c, (1.0 + curve.conic_constant) * c, low, high, side)


def _oval(curve: CartesianOval) -> rows.Oval:
    shape = _oval_shape(
        curve.n1, curve.n2, curve.object_mm, curve.image_mm, *sorted((curve.from_deg, curve.to_deg), reverse=True)
    )
    wx, wz = curve.axis

    def to_scene(point: Point) -> Point:
        """Transform a point from the oval frame, whose axes point to the right of the oval axis and along it."""
        return (curve.vertex[0] + point[0] * wz + point[1] * wx, curve.vertex[1] - point[0] * wx + point[1] * wz)

    left, b, c, right = (to_scene(point) for point in shape.hull)
    ray_right, ray_left = curve.end_rays
    side = 1.0 if curve.to_deg > curve.from_deg else -1.0
    foci = (*curve.object_focus, *curve.image_focus)
    return rows.Oval(
        *foci, curve.n1, curve.n2, curve.object_mm, curve.image_mm, *curve.vertex, *curve.axis, side,
        curve.constant_mm / curve.n2, *ray_right, *ray_left, *left, *b, *c, *right, *unit(minus(right, left)),
        *shape.fit,
    )  # fmt: skip


class _OvalShape(NamedTuple):
    """Properties that depend only on an oval's shape, in its own frame: corners of its hull and the fitted conic."""

    hull: tuple[Point, Point, Point, Point]
    fit: tuple[float, float, float]


@lru_cache(maxsize=256)
def _oval_shape(n1: float, n2: float, object_mm: float, image_mm: float, from_deg: float, to_deg: float) -> _OvalShape:
    """Return the hull and fit of an oval traversed from left to right, cached because a sweep only rotates it."""
    curve = CartesianOval((0.0, 0.0), (0.0, 1.0), n1, n2, object_mm, image_mm, from_deg, to_deg)
    r, w = curve.points(np.linspace(0.0, 1.0, 33)).T
    fit = np.linalg.lstsq(np.column_stack([np.ones_like(w), w, w * w]), r * r, rcond=None)[0]
    return _OvalShape(_tangent_hull(curve), (float(fit[0]), float(fit[1]), float(fit[2])))


def _intersection(a: Point, along_a: Point, b: Point, along_b: Point) -> Point:
    """Return the intersection of two lines; if they are almost parallel, the point midway between a and b."""
    sine = cross(along_a, along_b)
    if abs(sine) < MIN_SINE:
        return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
    t = cross(minus(b, a), along_b) / sine
    return (a[0] + t * along_a[0], a[1] + t * along_a[1])


def _cubics(curve: Bezier | Spline) -> list[tuple[int, Row, Curve]]:
    cubics: list[tuple[int, Row, Curve]] = []
    for number, piece in enumerate(curve.pieces):
        a, b, c, d = piece.control
        is_first, is_last = number == 0, number == len(curve.pieces) - 1
        before = 1.0 / (3.0 * math.dist(a, b)) if is_first and not curve.closed else 0.0
        after = 1.0 / (3.0 * math.dist(c, d)) if is_last and not curve.closed else 0.0
        row = rows.Cubic(*a, *b, *c, *d, before, after, piece.u_from, piece.u_to)
        cubics.append((rows.CUBIC, row, Bezier(a, b, c, d)))
    return cubics


ROWS: dict[type[Curve], tuple[int, Callable[[Any], Row]]] = {
    Segment: (rows.SEGMENT, _segment),
    Arc: (rows.ARC, _arc),
    Parabola: (rows.CONIC, _parabola),
    Conic: (rows.CONIC, _conic),
    CartesianOval: (rows.OVAL, _oval),
}
COMPILED: tuple[type[Curve], ...] = (*ROWS, Bezier, Spline)
