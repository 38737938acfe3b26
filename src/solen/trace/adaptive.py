"""Integration over the launch angle of a point source, to a stated tolerance with few rays.

In the plane a point source is a one-parameter family: what a receiver gets is a function of the launch angle alone,
smooth wherever neighbouring rays meet the same interfaces, with jumps in between. So the cone is cut into *pieces* of
one and the same tree of hits, and each piece is integrated by Gauss–Kronrod quadrature.

Equal trees at both ends of a stretch prove nothing: a sliver of other rays may lie between. What could separate two
neighbouring rays must start somewhere, at an end of a curve or on a curve that is wholly between them; so a stretch is
whole only if no end of any curve lies inside the beam its two rays span, at any of their straight legs, nor next to a
curved face between their ends. Past a caustic two rays need not span the beam between them: this is no proof, and the
uncertainty is an estimate. A stretch that is not whole is halved, until it is or is too narrow to matter; the width of
all such gaps, times all that a ray carries, goes into the uncertainty. Nodes of the quadrature that turn out to have
another tree send the piece back.

The idea of bisecting the jumps is that of any adaptive integrator; the quadrature is the (7, 15) pair of Kronrod (1965)
as tabulated in QUADPACK, and so is the estimate of its error (Piessens et al., 1983). All of it is compiled: see
`solen.trace.kernel.tree` and `solen.trace.kernel.adapt`.
"""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.curve import check_count
from solen.errors import DesignError
from solen.scene import Fan, Scene
from solen.trace.kernel import adapt
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import SPLITTING
from solen.trace.kernel.tree import LEG_COLUMNS, STACK, Family
from solen.trace.kernel.tree import WIDTH as STACK_WIDTH
from solen.trace.result import Detected, Ledger, Limits, Mode, Trace, check_mode
from solen.trace.tables import Tables, compile_scene

FIRST_STRETCHES = 64
NARROWEST_DEG = 1e-11
"""Where cutting ends at the latest: over a few mm, what `solen.curve.END_TOLERANCE_MM` leaves undecided at a corner."""
LEAST_SHARE = 0.01
GAP_SHARE = 0.01
"""How wide, as a share of the tolerance times the cone, a gap may be that is not cut on at first."""
MOST_LEGS = 200_000
LEAST_TOLERANCE = 1e-12
SLIVER = 1e-10
"""Share of the cone below which a piece comes from how far curves reach beyond their ends, and is not followed."""
NEW_GAPS = 1e-11
"""Share of the cone that may be left between pieces found again, beyond what was left between them before."""

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


RULE = adapt.Rule(NODES, KRONROD, GAUSS)
DOUBLE = Precision.of(np.float64)
MOST_SAMPLES, MOST_KEPT_LEGS, MOST_WAITING = 1 << 15, 1 << 22, 256


def integrate(
    scene: Scene,
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int = MOST_LEGS,
) -> Trace:
    """Power at every receiver of a scene with one `Fan`, over its cone.

    Parameters
    ----------
    scene
        Its only source is a `Fan`; the number of rays it names plays no part. Monitors are not read.
    mode
        ``"count"`` or ``"power"``, as in `solen.trace.trace`; splitting and absorption included.
    tolerance
        What the uncertainty of every power shall not exceed, as a fraction of the emitted power; 1e-12 to 0.1.
    limits
        Where following a ray ends; by default the least weight is a hundredth of the tolerance.
    most_legs
        After so many straight stretches of light the integration ends, with whatever it has reached.

    Returns
    -------
    Trace
        With method ``"adaptive"``: values, one estimate of their error, and whether it is within the tolerance.

    Raises
    ------
    DesignError
        Another source than one `Fan` of one wavelength, a cone without width, or a tolerance out of range.
    """
    return integrate_many((scene,), mode, tolerance, limits, most_legs=most_legs, threads=1)[0]


def integrate_many(
    scenes: Sequence[Scene],
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int = MOST_LEGS,
    threads: int | None = None,
) -> list[Trace]:
    """`integrate` for many scenes, the positions of a motion or the variants of a design, on several threads."""
    check_mode(mode)
    if not LEAST_TOLERANCE <= tolerance <= 0.1:
        raise DesignError("tolerance", value=tolerance, limit=f"must be from {LEAST_TOLERANCE:g} to 0.1")
    if mode == "roulette":
        raise DesignError("mode", value=mode, limit="adaptive integration knows count and power")
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    limits = limits or Limits(min_weight=LEAST_SHARE * tolerance)
    cones = [Cone.of(scene, mode, limits) for scene in scenes]
    if threads == 1 or len(cones) < 2:
        return [cone.integral(tolerance, most_legs).trace for cone in cones]
    with ThreadPoolExecutor(threads) as pool:
        return [found.trace for found in pool.map(lambda cone: cone.integral(tolerance, most_legs), cones)]


class Parts(NamedTuple):
    """How a cone was cut and integrated: the angles (radians from the axis) that it was cut at."""

    low: np.ndarray
    high: np.ndarray
    tree: np.ndarray
    part_low: np.ndarray
    part_high: np.ndarray
    part_of: np.ndarray

    @classmethod
    def of(cls, pieces: adapt.Pieces, many: int, parts: int, sliver: float) -> "Parts":
        """Copies of what was found, without pieces narrower than a sliver."""
        wide = pieces.high[:many] - pieces.low[:many] > sliver
        kept = wide[pieces.part_of[:parts]]
        number = np.cumsum(wide) - 1
        low, high, tree = (column[:many][wide] for column in (pieces.low, pieces.high, pieces.tree))
        part_low, part_high = (column[:parts][kept] for column in (pieces.part_low, pieces.part_high))
        return cls(low, high, tree, part_low, part_high, number[pieces.part_of[:parts][kept]])


@dataclass(frozen=True)
class Integral:
    """An integrated cone: the result, and how it was cut."""

    trace: Trace
    parts: Parts


@dataclass(frozen=True)
class Cone:
    """A scene with one fan, compiled."""

    scene: Scene
    fan: Fan
    mode: Mode
    tables: Tables
    family: Family
    ends: np.ndarray

    @classmethod
    def of(cls, scene: Scene, mode: Mode, limits: Limits) -> "Cone":
        """Cone of a scene; `DesignError` as in `integrate`."""
        if len(scene.sources) != 1 or not isinstance(scene.sources[0], Fan):
            what = f"{len(scene.sources)} sources"
            raise DesignError("adaptive integration", value=what, limit="needs one fan alone")
        if scene.is_random:
            limit, remedy = "what is drawn by chance cannot be integrated", "trace it with sampling sobol"
            raise DesignError("adaptive integration", value="a scene that scatters", limit=limit, remedy=remedy)
        fan = scene.sources[0]
        if not fan.cone_deg > 0.0:
            raise DesignError("fan cone_deg", value=fan.cone_deg, limit="must be above 0 to integrate over it")
        if len(fan.spectrum) > 1:
            what = f"{len(fan.spectrum)} wavelengths"
            raise DesignError("adaptive integration", value=what, limit="needs one wavelength", remedy="do each apart")
        ends = np.array([p for i in scene.interfaces for p in (i.curve.start, i.curve.end)]).reshape(-1, 2)
        far_mm = 100.0 * float(np.ptp(ends, axis=0).max(initial=1.0)) if len(ends) else 1.0
        rules = Rules(SPLITTING[mode], limits.min_weight, limits.max_hits, seed=0, first=0, step=1, turbid=False)
        axis, shares = math.radians(fan.axis_deg), (fan.s_share, 1.0 - fan.s_share)
        family = Family(*fan.point, axis, *shares, colour=0, rules=rules, far=far_mm)
        return cls(scene, fan, mode, compile_scene(scene), family, ends)

    def integral(self, tolerance: float, most_legs: int) -> Integral:
        """Cut and integrate."""
        columns = len(self.scene.receivers) + 2
        samples, pieces = room(most_legs, columns)
        total, cone = np.zeros(columns), math.radians(self.fan.cone_deg)
        narrowest = math.radians(NARROWEST_DEG)
        error, gaps, parts, ended = adapt.integrate_cone(
            DOUBLE, self.tables, self.family, samples, pieces, self.ends, RULE, 0.5 * cone, tolerance,
            max(GAP_SHARE * tolerance * cone, narrowest), narrowest, FIRST_STRETCHES, most_legs,
            np.zeros((len(NODES) + 1, columns)), total,
        )  # fmt: skip
        cut = Parts.of(pieces, int(samples.counts[adapt.PIECES]), parts, SLIVER * cone)
        return Integral(self._trace(total / cone, error / cone, gaps / cone, samples.counts, tolerance, ended), cut)

    def again(self, before: Integral) -> np.ndarray | None:
        """Powers (D + 2,) of this scene over the pieces of another one that differs a little; None if they are lost."""
        parts = before.parts
        columns = len(self.scene.receivers) + 2
        samples, pieces = room(MOST_LEGS, columns)
        for name in Parts._fields:
            getattr(pieces, name)[: len(getattr(parts, name))] = getattr(parts, name)
        total = np.zeros(columns)
        cone = math.radians(self.fan.cone_deg)
        gaps, found = adapt.integrate_again(
            DOUBLE, self.tables, self.family, samples, pieces, len(parts.low), len(parts.part_low), RULE, 0.5 * cone,
            np.zeros((len(NODES) + 1, columns)), total,
        )  # fmt: skip
        widths_before = cone - float(np.sum(parts.high - parts.low))
        return total / cone if found and gaps <= widths_before + NEW_GAPS * cone else None

    def _trace(
        self, share: np.ndarray, error: float, gaps: float, count: np.ndarray, tolerance: float, ended: bool
    ) -> Trace:
        """Result of the integral's shares of the emitted power."""
        if not ended:
            share = np.zeros_like(share)
        *detected, escaped, absorbed = (float(value) for value in share)
        truncated = 1.0 - math.fsum(detected) - escaped - absorbed  # the gaps, and what was cut off on the way
        u = error + max(gaps, truncated, 0.0) if ended else 1.0
        rays = int(count[adapt.RAYS])
        return Trace(
            mode=self.mode,
            method="adaptive",
            rays=rays,
            detectors={
                name: Detected(power, u, rays, (power,))
                for name, power in zip(self.scene.receivers, detected, strict=True)
            },
            monitors={},
            ledger=Ledger(math.fsum(detected), escaped, absorbed, truncated),
            hits=int(count[adapt.ALL_LEGS]),
            undefined=int(count[adapt.UNDEFINED]),
            pieces=int(count[adapt.PIECES]),
            reached=u <= tolerance,
            why=""
            if u <= tolerance
            else f"{rays} rays reach {u:.1e}: their ways part too often; trace a fan, or raise the least weight",
        )


def room(most_legs: int, columns: int) -> tuple[adapt.Samples, adapt.Pieces]:
    """Room to integrate in; untouched memory costs nothing."""
    n = MOST_SAMPLES

    def whole() -> np.ndarray:
        return np.empty(n, np.int64)

    def real() -> np.ndarray:
        return np.empty(n)

    samples = adapt.Samples(
        angle=real(),
        tree=np.empty(n, np.uint64),
        first=whole(),
        many=whole(),
        after=whole(),
        whole=np.empty(n, np.bool_),
        legs=np.empty((min(most_legs, MOST_KEPT_LEGS), LEG_COLUMNS)),
        open=whole(),
        value=np.empty(columns),
        stack=np.empty((STACK, STACK_WIDTH)),
        counts=np.zeros(6, np.int64),
    )
    pieces = adapt.Pieces(
        low=real(),
        high=real(),
        tree=np.empty(n, np.uint64),
        first=whole(),
        part_low=real(),
        part_high=real(),
        part_of=whole(),
        waiting=np.empty((MOST_WAITING, 2)),
    )
    return samples, pieces
