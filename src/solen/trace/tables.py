"""A scene as arrays: the interface between the description of a scene and the compiled tracing.

There is one row per curve piece: its kind, its parameters (named in `solen.trace.kernel.rows`), its behaviour, the
regions on its sides and its receiver. Most curves are one piece; a spline has one piece for each of its cubics. To add
a curve, add a class in `solen.curve`, a row here and a function in `solen.trace.kernel.hits`.
"""

import math
from collections.abc import Callable
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
LISTED = 5
CORNER_RAD = 1e-6
"""Largest angle at which a joint of two cubics counts as smooth."""
BOX_MARGIN_MM, BOX_MARGIN = 1e-6, 1e-6
"""Margin of a box around its curve, absolute and relative, which exceeds rounding errors in either precision."""
STRAIGHT = 1e-9
SHARE_ROUNDING = 1e-9
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
    before: IntArray
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
    grid_many: IntArray
    """(2,) number of grid cells along x and z"""
    grid_first: IntArray
    """(cells + 1,) start of the pieces of each cell in ``grid_item``"""
    grid_item: IntArray
    """indices of pieces by cell; empty if every piece is tested"""


def compile_scene(scene: Scene, dtype: type[np.floating[Any]] = np.float64) -> Tables:
    """Return the arrays of a scene in double or single precision; `DesignError` if a curve has no compiled form."""
    names = {region.name: number for number, region in enumerate(scene.regions)}
    receivers: dict[str | None, int] = {name: number for number, name in enumerate(scene.receivers)}
    receivers[None] = -1
    found = [(i, piece) for i, interface in enumerate(scene.interfaces) for piece in _pieces(interface.curve)]
    number, pieces = [i for i, _ in found], [piece for _, piece in found]
    owners = [scene.interfaces[i] for i in number]
    colours = scene.wavelengths_nm or (None,)
    bins = np.array([monitor.bins for monitor in scene.monitors], dtype=np.int64)
    curves = [piece.curve for piece in pieces]
    cells = grid_of(curves)
    treatment, treatments, layers = _treatments(scene)
    return Tables(
        kind=_whole(piece.kind for piece in pieces),
        shape=np.array([piece.row for piece in pieces], dtype).reshape(-1, WIDTH),
        middle=np.array([piece.middle for piece in pieces], dtype).reshape(-1, 2),
        box=np.array([piece.box for piece in pieces], dtype).reshape(-1, 4),
        owner=_whole(number),
        before=_before(scene.interfaces, number, curves),
        behaviour=_whole(
            BEHAVIOURS.index(owner.behaviour) + rows.TREATED * (treatment[i] >= 0)
            for i, owner in zip(number, owners, strict=True)
        ),
        treatment=_whole(treatment[i] for i in number),
        left=_whole(names[owner.left] for owner in owners),
        right=_whole(names[owner.right] for owner in owners),
        receiver=_whole(receivers[owner.receiver] for owner in owners),
        height=np.array([owner.height_mm or (-math.inf, math.inf) for owner in owners], dtype).reshape(-1, 2),
        refractive_index=np.array([[region.index_at(nm) for region in scene.regions] for nm in colours], dtype),
        absorption=np.array([[region.absorption_per_mm for region in scene.regions] for _ in colours], dtype),
        scattering=np.array([[region.scattering_per_mm for region in scene.regions] for _ in colours], dtype),
        anisotropy=np.array([[region.anisotropy for region in scene.regions] for _ in colours], dtype),
        wavelength=np.array([math.nan if nm is None else nm for nm in colours], dtype),
        treatments=np.array(treatments, dtype).reshape(-1, len(rows.Treatment._fields)),
        layers=np.array([row + (0.0,) * (LISTED - len(row)) for row in layers], dtype).reshape(-1, LISTED),
        monitor=np.array([_segment(monitor.segment) for monitor in scene.monitors], dtype).reshape(-1, 5),
        bins=bins,
        first_bin=np.cumsum(bins) - bins,
        grid_low=cells.low.astype(dtype),
        grid_cell=cells.cell.astype(dtype),
        grid_many=cells.many,
        grid_first=cells.first,
        grid_item=cells.item,
    )


def _whole(numbers: Any) -> IntArray:
    return np.array(list(numbers), dtype=np.int64)


def _treatments(scene: Scene) -> tuple[list[int], list[rows.Treatment], list[Row]]:
    """Return the treatment row of each interface (or −1), those rows, and further rows: films, tables, orders."""
    which: list[int] = []
    treatments: list[rows.Treatment] = []
    more: list[Row] = []
    for interface in scene.interfaces:
        surface = interface.surface
        which.append(-1 if surface is None else len(treatments))
        if surface is not None:
            tables = (_table(surface.table), _table(surface.table_right))
            lists = (_films(surface), *tables, _orders(surface), _profile(surface.scatter))
            treatments.append(_treatment(surface, len(more), *map(len, lists)))
            more += [row for rows_of in lists for row in rows_of]
    return which, treatments, more


def _films(surface: Surface) -> list[Row]:
    films = surface.coating.layers if surface.coating else ()
    return [(film.index, film.extinction, film.thickness_nm) for film in films]


def _table(table: AngleTable | None) -> list[Row]:
    return [] if table is None else [(math.radians(row[0]), *row[1:]) for row in table.rows]


def _orders(surface: Surface) -> list[Row]:
    """Return the rows of grating orders; raise `DesignError` if their sum exceeds 1, which would break the ledger."""
    if surface.grating is None:
        return []
    total = math.fsum(share for _, share in surface.grating.orders)
    if total > 1.0 + SHARE_ROUNDING:
        limit = "the power of its orders must not exceed that of the incident light"
        raise DesignError("grating orders", value=f"a sum of {total:.6g}", limit=limit, remedy="reduce the fractions")
    return [(float(order), share) for order, share in surface.grating.orders]


def _profile(scatter: Scatter | None) -> list[Row]:
    """Return rows of a tabulated profile, with cumulative sums of its envelope by cell, in the plane and in space."""
    if not isinstance(scatter, ScatterTable):
        return []
    off, density = np.array(scatter.offset), np.array(scatter.density)
    highest = np.maximum(density[1:], density[:-1])
    flat, disc = (np.cumsum([0.0, *(highest * np.diff(off**power))]) for power in (1, 2))
    return list(
        zip(off.tolist(), density.tolist(), (flat / flat[-1]).tolist(), (disc / disc[-1]).tolist(), strict=True)
    )


def _treatment(
    surface: Surface, first: int, films: int, left: int, right: int, orders: int, offs: int
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
        share=0.0 if scatter is None else scatter.share,
        tilt=texture.slope if texture else 0.0,
        across=float(texture is not None and texture.direction == "across"),
        first_layer=float(first),
        layers=float(films),
        first_row=float(first + films),
        rows=float(left + orders),
        rows_right=float(right),
        lines=-lines if grating is not None and grating.mirrored else lines,
        first_off=float(first + films + left + right + orders),
        offs=float(offs),
    )


def _before(interfaces: tuple[Interface, ...], owner: list[int], curves: list[Curve]) -> IntArray:
    """Return the piece that each piece continues smoothly; in a closed curve the first piece follows the last."""
    before = [here - 1 if here and owner[here - 1] == i else -1 for here, i in enumerate(owner)]
    last = {i: here for here, i in enumerate(owner)}
    for here, i in enumerate(owner):
        curve = interfaces[i].curve
        if before[here] < 0 and isinstance(curve, Spline | Bezier) and curve.closed:
            before[here] = last[i]
        if before[here] >= 0 and not _smooth(curves[before[here]], curves[here]):
            before[here] = -1
    return _whole(before)


def _smooth(first: Curve, second: Curve) -> bool:
    """Whether two pieces join smoothly, so that a ray starting at the joint on one of them may meet the other."""
    if not (isinstance(first, Bezier) and isinstance(second, Bezier)):
        return False
    arriving, leaving = unit(minus(first.b, first.control_b)), unit(minus(second.control_a, second.a))
    return dot(arriving, leaving) > 0.0 and abs(cross(arriving, leaving)) < CORNER_RAD


class _Piece(NamedTuple):
    """A row of the curve table."""

    kind: int
    row: Row
    middle: Point
    box: Row
    curve: Curve


@lru_cache(maxsize=4096)
def _pieces(curve: Curve) -> tuple[_Piece, ...]:
    """Return the pieces of a curve, cached because most curves do not change from one scene of a sweep to the next."""
    if isinstance(curve, Spline | Bezier):
        rows_of = _cubics(curve)
    elif type(curve) in ROWS:
        kind, row = ROWS[type(curve)]
        rows_of = [(kind, row(curve), curve)]
    else:
        known = ", ".join(cls.__name__ for cls in COMPILED)
        raise DesignError(f"curve {type(curve).__name__}", limit=f"must be one of {known} for the compiled engine")
    return tuple(
        _Piece(kind, tuple(row) + (0.0,) * (WIDTH - len(row)), part.middle_point, _box(part, row), part)
        for kind, row, part in rows_of
    )


def _box(curve: Curve, row: Row) -> Row:
    """Bounding box of a curve, with a margin for its extension beyond the ends and for rounding."""
    x, z = zip(*_hull(curve, row), strict=True)
    low_x, high_x, low_z, high_z = min(x), max(x), min(z), max(z)
    margin = BOX_MARGIN_MM + BOX_MARGIN * max(abs(low_x), abs(high_x), abs(low_z), abs(high_z))
    return (low_x - margin, high_x + margin, low_z - margin, high_z + margin)


def _hull(curve: Curve, row: Row) -> tuple[Point, ...]:
    """Points whose convex hull contains a curve."""
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
    """Ends of a curve that bends in one direction, and intersections of the end tangents with the midpoint tangent."""
    points = [(float(x), float(z)) for x, z in curve.points(np.array([0.0, 0.5, 1.0]))]
    tangents = [right_of(curve.normal_at(point)) for point in points]
    corners = [_meeting(points[i], tangents[i], points[i + 1], tangents[i + 1]) for i in range(2)]
    return (points[0], corners[0], corners[1], points[2])


def _segment(curve: Segment) -> rows.Segment:
    return rows.Segment(*curve.a, *unit(minus(curve.b, curve.a)), curve.length_mm)


def _arc(curve: Arc) -> rows.Arc:
    side = 1.0 if curve.sweep_deg > 0 else -1.0
    end = curve.radius_mm * math.sin(math.radians(curve.half_deg))
    return rows.Arc(*curve.center, curve.radius_mm, *curve.middle, end, side, float(curve.half_deg <= 90.0))


def _parabola(curve: Parabola) -> rows.Conic:
    """Convert a parabola; its depth is to the right of its axis, and therefore to the left of the reversed axis."""
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
    local = _oval_of(
        curve.n1, curve.n2, curve.object_mm, curve.image_mm, *sorted((curve.from_deg, curve.to_deg), reverse=True)
    )
    wx, wz = curve.axis

    def place(point: Point) -> Point:
        """Convert a point from the oval frame, whose axes point to the right of the oval axis and along it."""
        return (curve.vertex[0] + point[0] * wz + point[1] * wx, curve.vertex[1] - point[0] * wx + point[1] * wz)

    left, b, c, right = (place(point) for point in local.hull)
    ray_right, ray_left = curve.end_rays
    side = 1.0 if curve.to_deg > curve.from_deg else -1.0
    foci = (*curve.object_focus, *curve.image_focus)
    return rows.Oval(
        *foci, curve.n1, curve.n2, curve.object_mm, curve.image_mm, *curve.vertex, *curve.axis, side,
        curve.constant_mm / curve.n2, *ray_right, *ray_left, *left, *b, *c, *right, *unit(minus(right, left)),
        *local.fit,
    )  # fmt: skip


class _OvalShape(NamedTuple):
    """Properties that depend only on an oval's shape, in its own frame: corners of its hull and the fitted conic."""

    hull: tuple[Point, Point, Point, Point]
    fit: tuple[float, float, float]


@lru_cache(maxsize=256)
def _oval_of(n1: float, n2: float, object_mm: float, image_mm: float, from_deg: float, to_deg: float) -> _OvalShape:
    """Hull and fit of a front traversed from its left end to its right; a sweep rotates the same front many times."""
    curve = CartesianOval((0.0, 0.0), (0.0, 1.0), n1, n2, object_mm, image_mm, from_deg, to_deg)
    r, w = curve.points(np.linspace(0.0, 1.0, 33)).T
    fit = np.linalg.lstsq(np.column_stack([np.ones_like(w), w, w * w]), r * r, rcond=None)[0]
    return _OvalShape(_tangent_hull(curve), (float(fit[0]), float(fit[1]), float(fit[2])))


def _meeting(a: Point, along_a: Point, b: Point, along_b: Point) -> Point:
    """Intersection of two lines; if they almost coincide, the point midway."""
    slant = cross(along_a, along_b)
    if abs(slant) < STRAIGHT:
        return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
    t = cross(minus(b, a), along_b) / slant
    return (a[0] + t * along_a[0], a[1] + t * along_a[1])


def _cubics(curve: Bezier | Spline) -> list[tuple[int, Row, Curve]]:
    cubics: list[tuple[int, Row, Curve]] = []
    for number, piece in enumerate(curve.pieces):
        a, b, c, d = piece.control
        begins, ends = number == 0, number == len(curve.pieces) - 1
        before = 1.0 / (3.0 * math.dist(a, b)) if begins and not curve.closed else 0.0
        after = 1.0 / (3.0 * math.dist(c, d)) if ends and not curve.closed else 0.0
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
