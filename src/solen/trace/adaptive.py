"""Integration over the launch angle of a point source, to a stated tolerance with few rays.

In the plane a point source is a one-parameter family: what a receiver gets is a function of the launch angle alone,
smooth wherever neighbouring rays meet the same interfaces, with jumps in between. So the cone is cut into *pieces* of
one and the same tree of hits, and each piece is integrated by Gauss–Kronrod quadrature.

Equal trees at both ends of a stretch prove nothing: a sliver of other rays may lie between. What could separate two
neighbouring rays must start somewhere, at an end of a curve or on a curve that is wholly between them; so a stretch is
whole only if no end of any curve lies inside the beam its two rays span, at any of their straight legs, nor next to a
curved face between their ends. Past a caustic two rays need not span the beam between them: this is no proof, and the
uncertainty is an estimate. A stretch that is not whole is halved, until it is or is narrower than `NARROWEST_DEG`; what
is left of the width of all such gaps, times all that a ray carries, goes into the uncertainty. Nodes of the quadrature
that turn out to have another tree send the piece back.

The idea of bisecting the jumps is that of any adaptive integrator; the quadrature is the (7, 15) pair of Kronrod (1965)
as tabulated in QUADPACK (Piessens et al., 1983).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solen.errors import DesignError
from solen.scene import Fan, Launch, Scene
from solen.trace.engine import trace_launch
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, Ledger, Limits, Mode, check_mode
from solen.trace.tables import SEGMENT, Tables, compile_scene

FIRST_STRETCHES = 64
NARROWEST_DEG = 1e-9
"""Where cutting ends: over a few mm, what `solen.curve.END_TOLERANCE_MM` leaves undecided at a corner."""
MOST_LEGS = 200_000
FEWEST_ROUNDS = 200
"""Where so many times the rays of the first look are not to be had, the rest is not begun."""
PIECES_AT_ONCE, QUADS_AT_ONCE = 256, 32_768
Floats = NDArray[np.float64]

# Nodes in [−1, 1] and weights of the Kronrod rule, and of the Gauss rule on every second node.
_HALF_NODES = (
    0.991455371120812639206854697526329,
    0.949107912342758524526189684047851,
    0.864864423359769072789712788640926,
    0.741531185599394439863864773280788,
    0.586087235467691130294144838258730,
    0.405845151377397166906606412076961,
    0.207784955007898467600689403773245,
)
_HALF_KRONROD = (
    0.022935322010529224963732008058970,
    0.063092092629978553290700663189204,
    0.104790010322250183839876322541518,
    0.140653259715525918745189590510238,
    0.169004726639267902826583426598550,
    0.190350578064785409913256402421014,
    0.204432940075298892414161999234649,
)
_HALF_GAUSS = (
    0.129484966168869693270611432679082,
    0.279705391489276667901467771423780,
    0.381830050505118944950369775488975,
)
NODES = np.array([-n for n in _HALF_NODES] + [0.0] + list(reversed(_HALF_NODES)))
KRONROD = np.array([*_HALF_KRONROD, 0.209482141084727828012999174891714, *reversed(_HALF_KRONROD)])
GAUSS = np.zeros(15)
GAUSS[1::2] = [*_HALF_GAUSS, 0.417959183673469387755102040816327, *reversed(_HALF_GAUSS)]


@dataclass(frozen=True)
class Integral:
    """Powers as fractions of the emitted power; ``u`` estimates the error of each.

    ``undefined`` counts the rays of the quadrature that met an interface from a medium they were not in.
    ``reached`` says whether ``u`` is within the tolerance asked for; if not, ``why`` says what stood in the way, and
    the powers lack what was not integrated: they can be off by all of ``u``, which can be 1.
    """

    mode: Mode
    detectors: dict[str, float]
    ledger: Ledger
    u: float
    rays: int
    undefined: int
    pieces: int
    reached: bool
    why: str = ""


@dataclass(frozen=True)
class _Sample:
    """Rays at sorted angles (N,): what each carries where (N, D + 2), its tree of hits (N,), and its legs' corners."""

    angle_deg: Floats
    value: Floats
    tree: NDArray[np.uint64]
    first_leg: NDArray[np.int64]
    legs: Floats
    """(sum of legs, 5): start and end of each straight leg, ray by ray, and 1 where it ends on a curved face"""
    undefined: int
    """rays that met an interface from a medium they were not in"""

    def __len__(self) -> int:
        return len(self.angle_deg)


def integrate(
    scene: Scene,
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int = MOST_LEGS,
) -> Integral:
    """Power at every receiver of a scene with one `Fan`, over its cone.

    Parameters
    ----------
    scene
        Its only source is a `Fan`; the number of rays it names plays no part. Monitors are not read.
    mode
        ``"count"`` or ``"power"``, as in `solen.trace.trace`; splitting and absorption included.
    tolerance
        What the uncertainty of every power shall not exceed, as a fraction of the emitted power; 1e-9 to 0.1.
    limits
        Where following a ray ends; by default the least weight is a hundredth of the tolerance, at most 1e-6.
    most_legs
        After so many straight stretches of light the integration ends, with whatever it has reached.

    Returns
    -------
    Integral
        Values, one estimate of their error, and whether it is within the tolerance.

    Raises
    ------
    DesignError
        Another source than one `Fan`, a cone without width, or a tolerance out of range.
    """
    check_mode(mode)
    if not 1e-9 <= tolerance <= 0.1:
        raise DesignError("tolerance", value=tolerance, limit="must be from 1e-9 to 0.1")
    if len(scene.sources) != 1 or not isinstance(scene.sources[0], Fan):
        raise DesignError("adaptive integration", value=f"{len(scene.sources)} sources", limit="needs one fan alone")
    if not scene.sources[0].cone_deg > 0.0:
        raise DesignError("fan cone_deg", value=scene.sources[0].cone_deg, limit="must be above 0 to integrate over it")
    limits = limits or Limits(min_weight=min(0.01 * tolerance, 1e-6))
    return _Integrator(scene, scene.sources[0], mode, tolerance, limits, most_legs).run()


class _Integrator:
    """One integration: the scene's tables, the rays spent, and the ends of all curves."""

    def __init__(self, scene: Scene, fan: Fan, mode: Mode, tolerance: float, limits: Limits, most_legs: int) -> None:
        self.scene = replace(scene, monitors=(), sources=(replace(fan, power=1.0),))
        self.fan = fan
        self.mode = mode
        self.tolerance = tolerance
        self.limits = limits
        self.tables: Tables = compile_scene(self.scene)
        self.ends = np.array([p for i in scene.interfaces for p in (i.curve.start, i.curve.end)]).reshape(-1, 2)
        self.far_mm = 100.0 * float(np.ptp(self.ends, axis=0).max(initial=1.0)) if len(self.ends) else 1.0
        self.bent = np.append(self.tables.kind != SEGMENT, False)  # the last stands for no interface, −1
        self.most_legs = most_legs
        self.rays = self.legs = 0
        self.undefined = 0  # of the quadrature; cutting aims at corners, so there they mean nothing

    def run(self) -> Integral:
        """Cut the cone into whole pieces, integrate each, and cut again where a piece proves not to be whole."""
        half = self.fan.cone_deg / 2
        sample = self._trace(np.linspace(-half, half, FIRST_STRETCHES + 1))
        if self.legs * FEWEST_ROUNDS > self.most_legs:
            nothing = np.empty(0, dtype=np.int64)
            return self._result(sample, nothing, nothing, np.zeros(sample.value.shape[1]), 0.0)
        while True:
            sample, whole = self._cut(sample)
            starts, stops = _pieces(whole)
            total, error, strays = self._quadrature(sample, starts, stops)
            if len(strays) == 0 or self.legs >= self.most_legs:
                break
            sample = _joined(sample, self._trace(strays))
        return self._result(sample, starts, stops, total, error)

    def _result(
        self, sample: _Sample, starts: NDArray[np.int64], stops: NDArray[np.int64], total: Floats, error: float
    ) -> Integral:
        cone = self.fan.cone_deg
        gaps = 1.0 - float(np.sum(sample.angle_deg[stops] - sample.angle_deg[starts])) / cone
        total = total / cone
        receivers = self.scene.receivers
        detected, escaped, absorbed = float(total[: len(receivers)].sum()), float(total[-2]), float(total[-1])
        truncated = 1.0 - detected - escaped - absorbed  # the gaps, and what was cut off on the way
        u = error / cone + max(gaps, truncated, 0.0)
        reached = u <= self.tolerance
        why = "" if reached else f"{self.rays} rays reach {u:.1e}: their ways part too often"
        return Integral(
            self.mode,
            {name: float(power) for name, power in zip(receivers, total, strict=False)},
            Ledger(detected, escaped, absorbed, truncated),
            u,
            self.rays,
            self.undefined,
            len(starts),
            reached,
            why,
        )

    def _cut(self, sample: _Sample) -> tuple[_Sample, NDArray[np.bool_]]:
        """Halve stretches until each is whole or narrow; returns the samples and which stretches are whole."""
        whole = self._whole_at(sample, np.arange(len(sample) - 1))
        while self.legs < self.most_legs:
            width = np.diff(sample.angle_deg)
            open_ones = np.flatnonzero(~whole & (width > NARROWEST_DEG))
            if len(open_ones) == 0:
                break
            middles = sample.angle_deg[open_ones] + 0.5 * width[open_ones]
            sample = _joined(sample, self._trace(middles))
            known = np.ones(len(sample) - 1, dtype=bool)
            new = np.searchsorted(sample.angle_deg, middles)
            known[new], known[new - 1] = False, False
            before = np.insert(whole, open_ones, values=False)
            whole = known & before
            fresh = np.flatnonzero(~known)
            whole[fresh] = self._whole_at(sample, fresh)
        return sample, whole

    def _whole_at(self, sample: _Sample, stretches: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the rays on both sides of each stretch have the same tree and nothing ends in the beam between."""
        whole: NDArray[np.bool_] = sample.tree[stretches] == sample.tree[stretches + 1]
        same = stretches[whole]
        if len(same) == 0 or len(self.ends) == 0:
            return whole
        counts = sample.first_leg[same + 1] - sample.first_leg[same]
        owner = np.repeat(np.arange(len(same)), counts)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        a = sample.legs[sample.first_leg[same][owner] + place]
        b = sample.legs[sample.first_leg[same + 1][owner] + place]
        quads = np.stack([a[:, :2], a[:, 2:4], b[:, 2:4], b[:, :2]], axis=1)
        touched = np.zeros(len(same), dtype=bool)
        np.logical_or.at(touched, owner, _holds_any(quads, self.ends))
        bent = a[:, 4] == 1.0
        np.logical_or.at(touched, owner[bent], _holds_any(_diamonds(a[bent, 2:4], b[bent, 2:4]), self.ends))
        whole[np.flatnonzero(whole)] = ~touched
        return whole

    def _quadrature(
        self, sample: _Sample, starts: NDArray[np.int64], stops: NDArray[np.int64]
    ) -> tuple[Floats, float, Floats]:
        """Integral over all pieces, its error, and the angles of nodes whose tree is not their piece's.

        A piece with such a node is left out: it must be cut again.
        """
        pieces = np.column_stack([sample.angle_deg[starts], sample.angle_deg[stops]])
        trees = sample.tree[starts]
        total, error, strays = np.zeros(sample.value.shape[1]), 0.0, [np.empty(0)]
        while len(pieces) and self.legs < self.most_legs:
            (low, high), tree = pieces[:PIECES_AT_ONCE].T, trees[:PIECES_AT_ONCE]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            angles = middle[:, None] + half[:, None] * NODES
            value, found = self._at(angles)
            stray = found != tree[:, None]
            strays.append(angles[stray])
            kronrod = half[:, None] * np.einsum("k,nkd->nd", KRONROD, value)
            estimate = np.abs(kronrod - half[:, None] * np.einsum("k,nkd->nd", GAUSS, value)).max(axis=1)
            whole = ~stray.any(axis=1)
            done = whole & ((estimate <= 0.5 * self.tolerance * (high - low)) | (high - low <= NARROWEST_DEG))
            total += kronrod[done].sum(axis=0)
            error += float(estimate[done].sum())
            on = whole & ~done
            halves = np.column_stack([np.append(low[on], middle[on]), np.append(middle[on], high[on])])
            pieces = np.vstack([pieces[PIECES_AT_ONCE:], halves])
            trees = np.concatenate([trees[PIECES_AT_ONCE:], tree[on], tree[on]])
        return total, error, np.unique(np.concatenate(strays))

    def _at(self, angle_deg: Floats) -> tuple[Floats, NDArray[np.uint64]]:
        """Values (…, D + 2) and trees (…) of rays at angles in any shape and order."""
        order = np.argsort(angle_deg, axis=None, kind="stable")
        sample = self._trace(angle_deg.ravel()[order])
        self.undefined += sample.undefined
        value, tree = np.empty_like(sample.value), np.empty_like(sample.tree)
        value[order], tree[order] = sample.value, sample.tree
        return value.reshape(*angle_deg.shape, -1), tree.reshape(angle_deg.shape)

    def _trace(self, angle_deg: Floats) -> _Sample:
        """Trace one ray of power 1 at every angle (sorted) from the fan's axis."""
        self.rays += len(angle_deg)
        angle = np.radians(self.fan.axis_deg + angle_deg)
        ones = np.ones(len(angle))
        launch = Launch(
            ones * self.fan.point[0],
            ones * self.fan.point[1],
            -np.sin(angle),
            np.cos(angle),
            ones * self.fan.s_share,
            ones * (1.0 - self.fan.s_share),
        )
        legs, undefined = trace_launch(self.scene, self.tables, launch, self.mode, self.limits)
        self.legs += len(legs)
        first = np.searchsorted(legs["ray"], np.arange(len(angle) + 1))
        return _Sample(
            angle_deg,
            self._values(legs, first[:-1]),
            _trees(legs, first[:-1]),
            first,
            _corners(legs, self.far_mm, self.bent),
            undefined,
        )

    def _values(self, legs: NDArray[np.void], first: NDArray[np.int64]) -> Floats:
        """Power by receiver, escaped and absorbed, of each ray."""
        arrives = (legs["power_s"] + legs["power_p"]) * legs["kept"]
        lost = (legs["power_s"] + legs["power_p"]) * (1.0 - legs["kept"])
        receivers = len(self.scene.receivers)
        columns = np.zeros((len(legs), receivers + 2))
        detected = legs["fate"] == DETECTED
        columns[np.flatnonzero(detected), self.tables.receiver[legs["interface"][detected]]] = arrives[detected]
        columns[:, receivers] = np.where(legs["fate"] == ESCAPED, arrives, 0.0)
        columns[:, receivers + 1] = lost + np.where(legs["fate"] == ABSORBED, arrives, 0.0)
        return np.asarray(np.add.reduceat(columns, first, axis=0))


def _trees(legs: NDArray[np.void], first: NDArray[np.int64]) -> NDArray[np.uint64]:
    """One number per ray for its tree of hits: which interfaces, in which order and branch, with which fates."""
    place = np.arange(len(legs)) - np.repeat(first, np.diff(np.append(first, len(legs))))
    number = np.zeros(len(legs), dtype=np.uint64)
    for column in (place, legs["branch"], legs["parent"], legs["hit"], legs["interface"], legs["fate"]):
        number = _mixed(number ^ column.astype(np.int64).view(np.uint64))
    return np.asarray(np.add.reduceat(number, first))


def _mixed(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Scramble the bits (splitmix64, Steele et al. 2014), so that different trees have different sums."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _corners(legs: NDArray[np.void], far_mm: float, bent: NDArray[np.bool_]) -> Floats:
    """Starts and ends of all legs, an escaping one ending far away, and whether they end on one of the bent faces."""
    length = np.where(np.isfinite(legs["length_mm"]), legs["length_mm"], far_mm)
    x, z = legs["x_mm"], legs["z_mm"]
    on_bent = (legs["interface"] >= 0) & bent[legs["interface"]]
    return np.column_stack([x, z, x + length * legs["dx"], z + length * legs["dz"], on_bent])


def _diamonds(a: Floats, b: Floats) -> Floats:
    """Quadrilaterals (Q, 4, 2) about the chords from a to b (Q, 2), wide enough for the curved face between them."""
    middle, across = 0.5 * (a + b), 0.5 * (b - a)[:, ::-1] * np.array([-1.0, 1.0])
    return np.stack([a, middle + across, b, middle - across], axis=1)


def _holds_any(quads: Floats, points: Floats) -> NDArray[np.bool_]:
    """Whether any of the points (P, 2) lies inside each quadrilateral (Q, 4, 2), crossed ones too (even-odd rule)."""
    if len(quads) > QUADS_AT_ONCE:
        parts = [quads[i : i + QUADS_AT_ONCE] for i in range(0, len(quads), QUADS_AT_ONCE)]
        return np.concatenate([_holds_any(part, points) for part in parts])
    inside = np.zeros((len(quads), len(points)), dtype=bool)
    px, pz = points[:, 0], points[:, 1]
    for corner in range(4):
        ax, az = quads[:, corner, 0, None], quads[:, corner, 1, None]
        bx, bz = quads[:, (corner + 1) % 4, 0, None], quads[:, (corner + 1) % 4, 1, None]
        across = (az > pz) != (bz > pz)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = ax + (pz - az) / (bz - az) * (bx - ax)
        inside ^= across & (px < crossing)
    return np.asarray(inside.any(axis=1))


def _pieces(whole: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample of every run of whole stretches."""
    padded = np.concatenate([[False], whole, [False]])
    change = np.flatnonzero(padded[1:] != padded[:-1])
    return change[::2], change[1::2]


def _joined(a: _Sample, b: _Sample) -> _Sample:
    """Samples of both, in order of the angle."""
    angle = np.concatenate([a.angle_deg, b.angle_deg])
    order = np.argsort(angle, kind="stable")
    counts = np.concatenate([np.diff(a.first_leg), np.diff(b.first_leg)])
    first = np.concatenate([a.first_leg[:-1], b.first_leg[:-1] + len(a.legs)])
    counts, first = counts[order], first[order]
    ends = np.cumsum(counts)
    rows = np.repeat(first - (ends - counts), counts) + np.arange(ends[-1])
    return _Sample(
        angle[order],
        np.concatenate([a.value, b.value])[order],
        np.concatenate([a.tree, b.tree])[order],
        np.concatenate([[0], ends]),
        np.concatenate([a.legs, b.legs])[rows],
        a.undefined + b.undefined,
    )
