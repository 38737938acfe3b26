"""Integration over the launch angles of point sources, and over the positions and wavelengths of extended sources.

Point sources are integrated over their launch angles as described in `solen.trace.cone`. An extended source is a row of
point sources. The power that reaches a receiver is a continuous function of the position of the point source, with a
kink wherever a jump in launch angle enters or leaves the cone. This function is also integrated by Gauss–Kronrod
quadrature, with the panel of the largest error halved until the sum of all errors is small. At a kink the two rules may
agree by chance; every panel is therefore halved at least once, and the error of each half is at least a fraction of the
change that the halving caused. The results for all wavelengths are added with their spectral weights.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solen.curve import check_count
from solen.errors import DesignError
from solen.scene import Scene, Source
from solen.scene.sources import Ambient, Emission, Emitter
from solen.trace.cone import COARSE, COARSE_TOLERANCE, RULE, Cone, Integral, weighted_sum
from solen.trace.kernel import adapt
from solen.trace.kernel.family import FamilyInSpace
from solen.trace.kernel.nearest import walls_of
from solen.trace.kernel.prism import EXTRA_COLUMNS
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import SPLITTING
from solen.trace.kernel.tree import Family
from solen.trace.nets import integrate_by_nets
from solen.trace.result import Detected, Ledger, Limits, Mode, Trace, check_mode
from solen.trace.space import LightInSpace
from solen.trace.tables import Tables, compile_scene
from solen.trace.tail import Tail

POINT_FRACTION, POSITION_FRACTION = 0.2, 0.6
"""Fractions of the tolerance: for the integral at one position of a source, and for the integral over all positions."""
MAX_POSITIONS = 3000
"""Maximum number of positions at which the integral is evaluated, per initial panel."""
CHANGE_FRACTION = 0.5
"""Minimum error of each half of a panel, as a fraction of the change caused by halving the panel."""
WEIGHT_FRACTION = 0.01
"""Minimum weight of a branch, as a fraction of the tolerance."""
EXACT_FRACTION, NEGLIGIBLE_FRACTION = 0.7, 0.02
"""Fractions of the tolerance: allotted to the exactly followed light if a tail is sampled, and the power below which a
tail is not sampled.
"""
MIN_SEGMENTS, SEGMENTS_TOLERANCE, MAX_SEGMENTS = 1_000_000, 1e-4, 20_000_000
"""Number of ray segments at which an integration ends: the minimum applies at this tolerance and above. For smaller
tolerances, the number is proportional to the square root of 1/tolerance, up to the maximum.
"""
LAST_LEVELS = ((0.5, 3), (0.5, 1))
FINE_LEVELS = ((1e-2, 24), *LAST_LEVELS)
"""Pairs of minimum weight and maximum number of interfaces. In an integral over one coordinate, many branches can be
followed; over several, the power of a trapped ray is chaotic, and sampling is more efficient.
"""
SAMPLING_TOLERANCE = 3e-5
"""Tolerance at or above which an extended source uses `LAST_LEVELS`, not `FINE_LEVELS`: its tail is sampled earlier."""
MAX_TAIL_SEGMENTS, TAIL_FACTOR, LAST_FACTOR, MANY_HITS = 120_000_000, 120, 5, 10
"""Maximum number of ray segments of a tail, absolute and relative to the limit of the integration. At levels with fewer
than ``MANY_HITS`` interfaces, the limit of the integration is multiplied by ``LAST_FACTOR``.
"""
MIN_TOLERANCE, MAX_TOLERANCE = 1e-12, 0.1
POINT_TOLERANCE, EXTENDED_TOLERANCE = 1e-6, 1e-4
"""Default power tolerances: for a point source in the plane at one wavelength, and for any other source."""


def integrate(
    scene: Scene,
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    max_segments: int | None = None,
) -> Trace:
    """Integrate the power at each receiver over the angles, positions and wavelengths of the sources.

    Parameters
    ----------
    scene
        The scene to integrate. Its sources must consist of points (fans, chips, emitters or ambient light); their ray
        counts have no effect. Nothing in the scene may scatter. In an extruded scene, emitters are integrated in space.
        Monitors are not evaluated. Light through a lens that varies with height is integrated with nets; see
        `solen.trace.nets`.
    mode
        ``"count"`` or ``"power"``, as in `solen.trace.trace`.
    tolerance
        Maximum uncertainty of each power, as a fraction of the emitted power, from 1e-12 to 0.1. For an extended
        source, a tolerance of 1e-4 requires a few hundred points.
    limits
        When to stop following a branch exactly; by default the minimum weight is a hundredth of the tolerance. The
        remaining light is sampled, over at most ``max_hits`` interfaces (`solen.trace.tail`). If this does not reach
        the tolerance, less light is followed exactly and more is sampled.
    max_segments
        Number of ray segments per source point, and of samples, after which the integration ends, whatever its
        uncertainty; in space this limit is five times as high if the uncertainty is close to the tolerance. By default,
        the limit is higher for lower tolerances. It also applies to nets, which have at most 2²¹ rays.

    Returns
    -------
    Trace
        With method ``"adaptive"``: the powers, a common error estimate, and whether this estimate is within the
        tolerance. Light that is trapped for more than ``max_hits`` interfaces is truncated and contributes to the
        uncertainty. With nets, the method is ``"sobol"``, and the uncertainties are standard errors.

    Raises
    ------
    DesignError
        For a beam or a list of rays, a cone of zero width, a scene that scatters, ambient light in space, or a
        tolerance that is out of range.
    """
    return integrate_many((scene,), mode, tolerance, limits, max_segments=max_segments)[0]


def integrate_many(
    scenes: Sequence[Scene],
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    max_segments: int | None = None,
    threads: int | None = None,
) -> list[Trace]:
    """Apply `integrate` in parallel threads to many scenes, such as positions of a motion or variants of a design."""
    check_mode(mode)
    if not MIN_TOLERANCE <= tolerance <= MAX_TOLERANCE:
        limit = f"must be from {MIN_TOLERANCE:g} to {MAX_TOLERANCE:g}"
        raise DesignError("tolerance", value=tolerance, limit=limit)
    if mode == "roulette":
        raise DesignError("mode", value=mode, limit="must be count or power for adaptive integration")
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    exact = limits or Limits(min_weight=WEIGHT_FRACTION * tolerance)
    lights = [None if scene.front is not None else Lights.of(scene, mode, exact) for scene in scenes]
    net_threads = threads if len(scenes) == 1 else 1

    def integral(scene: Scene, light: Lights | None) -> Trace:
        if light is not None:
            return light.trace(tolerance, max_segments)
        return integrate_by_nets(scene, tolerance, mode, limits, max_segments=max_segments, threads=net_threads)

    with ThreadPoolExecutor(threads) as pool:
        return list((pool.map if len(scenes) > 1 and threads > 1 else map)(integral, scenes, lights))


class Points:
    """Powers at each receiver from single points of the only source in a scene.

    Parameters
    ----------
    scene
        As for `integrate`, with exactly one source.
    tolerance
        Tolerance of each power, as a fraction of the power emitted by the point.

    Raises
    ------
    DesignError
        As for `integrate`, and if there is more than one source.
    """

    def __init__(self, scene: Scene, tolerance: float = 1e-6) -> None:
        if len(scene.sources) != 1:
            raise DesignError("number of sources", value=len(scene.sources), limit="must be 1")
        limits = Limits(min_weight=WEIGHT_FRACTION * tolerance)
        self._light = Lights.of(scene, "power", limits).in_plane
        self._tolerance = tolerance
        self._receivers = len(scene.receivers)

    def powers(self, positions: Sequence[float]) -> np.ndarray:
        """Return power fractions (n, receivers) for positions (n,) on the source, from 0 (right end) to 1 (left end).

        Raises
        ------
        DesignError
            If the tolerance is not reached at one of the positions.
        """
        rows = []
        for position in positions:
            integral = self._light.point(float(position), self._tolerance, segment_limit(self._tolerance))
            if integral.u > self._tolerance:
                limit = f"light is trapped or split too often to be integrated to {self._tolerance:g}"
                remedy = 'set trace.dimension = "extruded", with an emitter pattern that is not a fan'
                raise DesignError("emitter position", value=position, limit=limit, remedy=remedy)
            rows.append(integral.powers[: self._receivers])
        return np.array(rows).reshape(-1, self._receivers)


@dataclass(frozen=True, eq=False)
class Light:
    """A source in a compiled scene: a row of points, each of which emits at all wavelengths.

    ``family`` contains the properties common to all rays of the source; ``colours`` are indices of wavelengths in the
    tables, each with its fraction of the power.
    """

    source: Source
    tables: Tables
    ends: np.ndarray
    columns: int
    emission: Emission
    family: Family
    colours: tuple[tuple[int, float], ...]

    @classmethod
    def of(cls, scene: Scene, source: Source, tables: Tables, rules: Rules) -> "Light":
        """Prepare one source of a scene; raise `DesignError` if its cone has no width."""
        emission = source.emission()
        if emission is None:
            raise AssertionError("a source that is not made of points should already have been rejected")
        if not emission.integral > 0.0:
            raise DesignError("cone_deg", value=0.0, limit="must be above 0 for integration")
        ends = np.array([p for i in scene.interfaces for p in (i.curve.start, i.curve.end)]).reshape(-1, 2)
        far_mm = 100.0 * float(np.ptp(ends, axis=0).max(initial=1.0)) if len(ends) else 1.0
        polarisation = (source.s_share, 1.0 - source.s_share)
        family = Family(
            0.0,
            0.0,
            0.0,
            *polarisation,
            colour=0,
            rules=rules,
            escape_mm=far_mm,
            low=0.0,
            high=0.0,
            base=1.0,
            slope=0.0,
            power=0.0,
        )
        total = math.fsum(weight for _, weight in source.spectrum)
        colours = [(scene.wavelengths_nm.index(nm), weight / total) for nm, weight in source.spectrum] or [(0, 1.0)]
        return cls(source, tables, ends, len(scene.receivers) + 2, emission, family, tuple(colours))

    def cone(self, position: float = 0.5, colour: int = 0) -> Cone:
        """Return the cone of the point at a position from 0 to 1, at one wavelength."""
        x, z, axis_deg = self.emission.at(position)
        family = self.family._replace(x=x, z=z, axis=math.radians(axis_deg), colour=colour)
        families = tuple(family._replace(**interval._asdict()) for interval in self.emission.intervals)
        return Cone(self.tables, self.ends, self.columns, families, self.emission.integral)

    def integral(self, tolerance: float, rules: Rules, max_segments: int) -> Integral:
        """Integrate over angles, positions and wavelengths."""
        light = replace(self, family=self.family._replace(rules=rules))
        if not self.emission.panels:
            return light.point(0.5, tolerance, max_segments)
        middle = light.point(0.5, POINT_FRACTION * tolerance, max_segments)
        if middle.error + middle.gaps > tolerance:  # other positions will not reach the tolerance either
            return middle._replace(powers=0.0 * middle.powers, gaps=1.0)

        def at(position: float) -> Integral:
            return light.point(position, POINT_FRACTION * tolerance, max_segments)

        return over_positions(at, self.emission.panels, tolerance)

    def levels(self, tolerance: float) -> Sequence[tuple[float, int]]:
        """Return minimum weights and maximum numbers of interfaces, for light that cannot all be followed exactly."""
        return LAST_LEVELS if self.emission.panels and tolerance >= SAMPLING_TOLERANCE else FINE_LEVELS

    def tail(self, rules: Rules) -> Tail:
        """Return the tail, i.e. the light beyond the limits of the integration; its rays are in the plane y = 0."""
        f, no_table = self.family, np.empty(0)
        family = FamilyInSpace(
            f.x, f.z, 0.0, 0.0, f.axis, 0.0, 0.0, 0.0, 0.0, 0.0, f.s, f.p, f.colour, rules, f.escape_mm, 1.0, 1.0, 1.0,
            f.low, f.high, 0.0, no_table, no_table,
        )  # fmt: skip
        columns = self.columns - 2 + EXTRA_COLUMNS
        return Tail(
            walls_of(self.tables),
            self.source,
            False,
            columns,
            lambda line: family._replace(colour=self.colours[line][0]),
        )

    def point(self, position: float, tolerance: float, max_segments: int) -> Integral:
        """Integrate over all wavelengths for the point at one position."""
        integrals = [self.cone(position, colour).integral(tolerance, max_segments) for colour, _ in self.colours]
        return integrals[0] if len(integrals) == 1 else weighted_sum(integrals, [weight for _, weight in self.colours])


def integration_obstacle(scene: Scene) -> str:
    """Return what prevents the integration of a scene, or an empty string if nothing does."""
    if scene.is_random:
        return "a scene that scatters"
    if scene.front is not None:
        return "a lens that varies with height"
    in_space = scene.extrusion is not None
    if in_space and any(interface.behaviour == "lens" for interface in scene.interfaces):
        return "an ideal lens in space"
    unsupported = [
        type(source).__name__
        for source in scene.sources
        if source.emission() is None or (in_space and isinstance(source, Ambient))
    ]
    return f"a source of type {unsupported[0]}" if unsupported else ""


def is_extended(scene: Scene) -> bool:
    """Return whether the light comes from more than one point or contains several wavelengths."""
    emissions = [source.emission() for source in scene.sources]
    return len(emissions) > 1 or any(
        emission is None or emission.panels > 0 or len(source.spectrum) > 1
        for emission, source in zip(emissions, scene.sources, strict=True)
    )


def default_tolerance(scene: Scene) -> float:
    """Return the default power tolerance for a scene."""
    in_space = scene.extrusion is not None
    return EXTENDED_TOLERANCE if in_space or is_extended(scene) else POINT_TOLERANCE


def segment_limit(tolerance: float) -> int:
    """Return the number of ray segments after which an integration to this tolerance ends."""
    return int(min(MIN_SEGMENTS * math.sqrt(max(SEGMENTS_TOLERANCE / tolerance, 1.0)), MAX_SEGMENTS))


def cause(integral: Integral) -> str:
    """Return the reason why an integral does not reach its tolerance, and the remedy."""
    if integral.unfinished > integral.error + integral.gaps:
        return f"{integral.unfinished:.1e} of the light meets more than max_hits interfaces; increase max_hits"
    return "light is trapped or split too often; increase the tolerance or max_segments"


class Panel(NamedTuple):
    """An interval of positions between 0 and 1, with its contribution to the integral."""

    error: float
    """quadrature error over the positions alone"""
    low: float
    high: float
    integral: Integral


def over_positions(at: Callable[[float], Integral], panels: int, tolerance: float) -> Integral:
    """Integrate ``at`` over positions from 0 to 1, always halving the panel with the largest error."""
    cuts, rule = np.linspace(0.0, 1.0, panels + 1).tolist(), COARSE if tolerance >= COARSE_TOLERANCE else RULE
    done = [_panel(at, rule, low, high)._replace(error=math.inf) for low, high in pairwise(cuts)]
    points, limit = panels * len(rule.nodes), MAX_POSITIONS * panels
    while points < limit and math.fsum(panel.error for panel in done) > POSITION_FRACTION * tolerance:
        if math.fsum(panel.integral.error + panel.integral.gaps for panel in done) > tolerance:
            break  # halving panels would not help
        panel = done.pop(max(range(len(done)), key=lambda i: done[i].error))
        middle = 0.5 * (panel.low + panel.high)
        halves = (_panel(at, rule, panel.low, middle), _panel(at, rule, middle, panel.high))
        change = panel.integral.powers - halves[0].integral.powers - halves[1].integral.powers
        min_error = CHANGE_FRACTION * float(np.max(np.abs(change)))
        done.extend(half._replace(error=max(half.error, min_error)) for half in halves)
        points += 2 * len(rule.nodes)
    integral = weighted_sum([panel.integral for panel in done], [1.0] * len(done))
    return integral._replace(error=integral.error + math.fsum(panel.error for panel in done))


def _panel(at: Callable[[float], Integral], rule: adapt.Rule, low: float, high: float) -> Panel:
    """Apply Gauss–Kronrod quadrature to one interval of positions."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    integrals = [at(middle + half * node) for node in rule.nodes.tolist()]
    values = np.array([integral.powers for integral in integrals])
    error = half * float(np.max(np.abs((rule.kronrod - rule.gauss) @ values)))
    return Panel(error, low, high, weighted_sum(integrals, (half * rule.kronrod).tolist()))


@dataclass(frozen=True, eq=False)
class Lights:
    """A compiled scene with all its sources."""

    scene: Scene
    mode: Mode
    rules: Rules
    each: tuple[Light | LightInSpace, ...]

    @classmethod
    def of(cls, scene: Scene, mode: Mode, limits: Limits) -> "Lights":
        """Compile a scene; raise `DesignError` as in `integrate`."""
        if obstacle := integration_obstacle(scene):
            limit = f"does not support {obstacle}"
            raise DesignError("adaptive integration", limit=limit, remedy="trace the scene with sampling sobol")
        rules = Rules(SPLITTING[mode], limits.min_weight, limits.max_hits, seed=0, first=0, step=1, turbid=False)
        tables = compile_scene(scene)
        in_space = scene.extrusion is not None
        return cls(
            scene,
            mode,
            rules,
            tuple(
                LightInSpace.of(scene, source, tables, rules)
                if in_space and isinstance(source, Emitter)
                else Light.of(scene, source, tables, rules)
                for source in scene.sources
            ),
        )

    @property
    def has_tails(self) -> bool:
        """Whether tails can be sampled; an ideal lens prevents this."""
        return all(interface.behaviour != "lens" for interface in self.scene.interfaces)

    @property
    def in_plane(self) -> Light:
        """The first source of a planar scene."""
        light = self.each[0]
        if isinstance(light, LightInSpace):
            raise DesignError("emitter in space", limit="cannot be integrated point by point", remedy="omit extrusion")
        return light

    def trace(self, tolerance: float, max_segments: int | None = None) -> Trace:
        """Integrate over all sources."""
        segments = segment_limit(tolerance) if max_segments is None else max_segments
        return self.trace_of([self._followed(light, tolerance, segments) for light in self.each], tolerance)

    def _followed(self, light: Light | LightInSpace, tolerance: float, max_segments: int) -> Integral:
        """Integrate one source and its tail, level by level until the tolerance is reached; return the best result."""
        best: Integral | None = None
        for weight, hits in ((0.0, self.rules.max_hits), *light.levels(tolerance)):
            if hits > self.rules.max_hits or 0.0 < weight <= self.rules.min_weight:
                continue
            rules = self.rules._replace(min_weight=max(weight, self.rules.min_weight), max_hits=hits)
            fraction, factor = (1.0, 1) if best is None else (EXACT_FRACTION, LAST_FACTOR if hits < MANY_HITS else 1)
            integral = light.integral(fraction * tolerance, rules, factor * max_segments)
            within = integral.error + integral.gaps <= tolerance or (hits < MANY_HITS and integral.gaps < 1.0)
            if integral.unfinished > NEGLIGIBLE_FRACTION * tolerance and within and self.has_tails:
                rest = max(math.sqrt(max(tolerance**2 - integral.error**2, 0.0)) - integral.gaps, 0.5 * tolerance)
                tail_segments = min(MAX_TAIL_SEGMENTS, TAIL_FACTOR * max_segments)
                integral = light.tail(rules).completed(integral, rest, self.rules.max_hits, tail_segments)
            best = integral if best is None or integral.u < best.u else best
            if best.u <= tolerance:
                break
        if best is None:
            raise AssertionError("the first level is always evaluated")
        return best

    def trace_of(self, integrals: Sequence[Integral], tolerance: float) -> Trace:
        """Combine the integrals of all sources into a trace."""
        weights = [source.power / self.scene.emitted for source in self.scene.sources]
        total = integrals[0] if len(integrals) == 1 else weighted_sum(integrals, weights)
        *detected, escaped, absorbed = (float(value) for value in total.powers)
        truncated = max(1.0 - math.fsum(detected) - escaped - absorbed, 0.0)  # the gaps and the truncated light
        rays, segments, undefined, pieces = (int(count) for count in total.counts)
        by_source = np.array([weight * integral.powers for integral, weight in zip(integrals, weights, strict=True)])
        why = f"{rays} rays reach an uncertainty of {total.u:.1e} instead of {tolerance:g}: {cause(total)}"
        return Trace(
            mode=self.mode,
            method="adaptive",
            rays=rays,
            detectors={
                name: Detected(power, total.u, rays, tuple(by_source[:, i].tolist()))
                for i, (name, power) in enumerate(zip(self.scene.receivers, detected, strict=True))
            },
            monitors={},
            ledger=Ledger(math.fsum(detected), escaped, absorbed, truncated),
            u_ledger=Ledger(max(len(detected), 1) * total.u, total.u, total.u, total.u),
            hits=segments,
            undefined=undefined,
            missed=total.missed,
            leaked=total.leaked,
            u_missed=total.u,
            u_leaked=total.u,
            pieces=pieces,
            reached=total.u <= tolerance,
            why="" if total.u <= tolerance else why,
        )
