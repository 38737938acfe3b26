"""Integration over the launch angles of point sources, and over the positions and wavelengths of extended sources.

A point source is integrated over its angles as described in `solen.trace.cone`. An extended source is a row of point
sources. The power from each is a continuous function of its position, with kinks where a jump enters or leaves the
cone; it is also integrated by Gauss–Kronrod quadrature, halving the panel with the largest error until the sum of all
errors is small. At a kink both rules may agree by chance; every panel is therefore halved at least once, and a panel's
error is taken to be at least a fraction of the change from halving the panel before it. Wavelengths are added with
their weights.
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
from solen.trace.kernel.prism import MORE_COLUMNS
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import SPLITTING
from solen.trace.kernel.tree import Family
from solen.trace.nets import by_nets
from solen.trace.result import Detected, Ledger, Limits, Mode, Trace, check_mode
from solen.trace.space import LightInSpace
from solen.trace.tables import Tables, compile_scene
from solen.trace.tail import Tail

INNER_SHARE, OUTER_SHARE = 0.2, 0.6
"""Fractions of the tolerance for the integral at one position of a source, and for that over all positions."""
MOST_PLACES = 3000
"""Largest number of positions at which the integral is evaluated, for each initial panel."""
CHANGE_SHARE = 0.5
"""Smallest error of half a panel, as a fraction of the change from halving it."""
LEAST_SHARE = 0.01
EXACT_SHARE, NEGLIGIBLE = 0.7, 0.02
"""Fractions of the tolerance: for the exact part if a tail is sampled; of light that is too weak to be sampled."""
FEWEST_LEGS, LEGS_TOLERANCE, GREATEST_LEGS = 1_000_000, 1e-4, 20_000_000
"""Smallest number of ray segments, at which tolerance, and the largest number: it rises with the root of
1/tolerance.
"""
LAST_LEVELS = ((0.5, 3), (0.5, 1))
FINE_LEVELS = ((1e-2, 24), *LAST_LEVELS)
"""Minimum weight, maximum numbers of hits: over one coordinate many branches can be followed; over several, the power
from a trapped ray is chaotic, and sampling is more efficient.
"""
ROUGH = 3e-5
"""Tolerance from which sampling suffices for a source with a size."""
TAIL_LEGS, TAIL_SHARE, LAST_EFFORT, MANY_HITS = 120_000_000, 120, 5, 10
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-12, 0.1
POINT_TOLERANCE, EXTENDED_TOLERANCE = 1e-6, 1e-4
"""Default tolerance of powers: for a point source in the plane at one wavelength, and for any other source."""


def integrate(
    scene: Scene,
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int | None = None,
) -> Trace:
    """Integrate the power at each receiver over the angles, positions and wavelengths of the sources.

    Parameters
    ----------
    scene
        Its sources must consist of points: fans, chips, emitters, ambient light; their numbers of rays have no effect.
        Nothing may scatter. In an extruded scene, emitters are integrated in space. Monitors are not evaluated. Light
        through a lens whose walls are not upright is integrated with nets, see `solen.trace.nets`.
    mode
        ``"count"`` or ``"power"``, as in `solen.trace.trace`; splitting and absorption included.
    tolerance
        Largest uncertainty of each power, as a fraction of the emitted power; 1e-12 to 0.1. For an extended source,
        1e-4 requires some hundred of its points.
    limits
        Where following a branch exactly ends; by default the least weight is a hundredth of the tolerance. The
        remainder is sampled, for ``max_hits`` interfaces at most (`solen.trace.tail`). If the tolerance is not reached
        in this way, less is followed exactly and more is sampled.
    most_legs
        Number of ray segments from one point, and of samples, after which the integration ends, whatever its
        uncertainty; in space five times as many if it is close to the tolerance. By default it rises as the tolerance
        falls. Nets have the same limit, and end after 2²¹ rays.

    Returns
    -------
    Trace
        With method ``"adaptive"``: powers, one estimate of their error, and whether it is within the tolerance. Light
        that is trapped for more than ``max_hits`` counts as truncated and is part of the uncertainty. With nets the
        method is ``"sobol"``, and uncertainties are standard errors.

    Raises
    ------
    DesignError
        For a beam or a list of rays, a cone of zero width, a scene that scatters, ambient light in space, or a
        tolerance out of range.
    """
    return integrate_many((scene,), mode, tolerance, limits, most_legs=most_legs)[0]


def integrate_many(
    scenes: Sequence[Scene],
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int | None = None,
    threads: int | None = None,
) -> list[Trace]:
    """Apply `integrate` to many scenes, such as positions of a motion or variants of a design, in threads."""
    check_mode(mode)
    if not LEAST_TOLERANCE <= tolerance <= MOST_TOLERANCE:
        limit = f"must be from {LEAST_TOLERANCE:g} to {MOST_TOLERANCE:g}"
        raise DesignError("tolerance", value=tolerance, limit=limit)
    if mode == "roulette":
        raise DesignError("mode", value=mode, limit="adaptive integration requires mode count or power")
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    exact = limits or Limits(min_weight=LEAST_SHARE * tolerance)
    lights = [None if scene.front is not None else Lights.of(scene, mode, exact) for scene in scenes]
    side_by_side = len(scenes) > 1

    def settled(scene: Scene, light: Lights | None) -> Trace:
        if light is not None:
            return light.trace(tolerance, most_legs)
        own = 1 if side_by_side else threads
        return by_nets(scene, tolerance, mode, limits, most_legs=most_legs, threads=own)

    with ThreadPoolExecutor(threads) as pool:
        return list((pool.map if side_by_side and threads > 1 else map)(settled, scenes, lights))


class Points:
    """The powers at each receiver from the individual points of a scene's only source.

    Parameters
    ----------
    scene
        As for `integrate`, with one source.
    tolerance
        Tolerance of each power, as a fraction of the power emitted by the point.

    Raises
    ------
    DesignError
        As for `integrate`, and if there is more than one source.
    """

    def __init__(self, scene: Scene, tolerance: float = 1e-6) -> None:
        if len(scene.sources) != 1:
            raise DesignError("sources", value=len(scene.sources), limit="the scene must have a single source")
        limits = Limits(min_weight=LEAST_SHARE * tolerance)
        self._light = Lights.of(scene, "power", limits).in_plane
        self._tolerance = tolerance
        self._receivers = len(scene.receivers)

    def powers(self, places: Sequence[float]) -> np.ndarray:
        """Return power fractions (n, receivers) for positions (n,) from 0 at the right end to 1 at the left one.

        Raises
        ------
        DesignError
            If the tolerance is not reached at one of the positions.
        """
        rows = []
        for place in places:
            found = self._light.point(float(place), self._tolerance, most_legs_for(self._tolerance))
            if found.u > self._tolerance:
                limit = f"the light of a point must be integrated to {self._tolerance:g}, and its paths split too often"
                raise DesignError("emitter", value=f"place {place:.4g}", limit=limit, remedy="trace a fan")
            rows.append(found.share[: self._receivers])
        return np.array(rows).reshape(-1, self._receivers)


@dataclass(frozen=True, eq=False)
class Light:
    """A source in a compiled scene: a row of points, each with all wavelengths.

    ``family`` contains the properties common to all its rays; ``colours`` are indices of wavelengths in the tables,
    with their fractions of the power.
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
        """Prepare one source of a scene; `DesignError` if its cone has no width."""
        emission = source.emission()
        if emission is None:
            raise AssertionError("a source that is not made of points was rejected before")
        if not emission.whole > 0.0:
            raise DesignError("cone_deg", value=0.0, limit="must be above 0 for integration")
        ends = np.array([p for i in scene.interfaces for p in (i.curve.start, i.curve.end)]).reshape(-1, 2)
        far_mm = 100.0 * float(np.ptp(ends, axis=0).max(initial=1.0)) if len(ends) else 1.0
        shares = (source.s_share, 1.0 - source.s_share)
        family = Family(
            0.0, 0.0, 0.0, *shares, colour=0, rules=rules, far=far_mm, low=0.0, high=0.0, base=1.0, slope=0.0, power=0.0
        )
        whole = math.fsum(weight for _, weight in source.spectrum)
        colours = [(scene.wavelengths_nm.index(nm), weight / whole) for nm, weight in source.spectrum] or [(0, 1.0)]
        return cls(source, tables, ends, len(scene.receivers) + 2, emission, family, tuple(colours))

    def cone(self, place: float = 0.5, colour: int = 0) -> Cone:
        """Return the point at a position from 0 to 1, at one wavelength."""
        x, z, axis_deg = self.emission.at(place)
        here = self.family._replace(x=x, z=z, axis=math.radians(axis_deg), colour=colour)
        families = tuple(here._replace(**interval._asdict()) for interval in self.emission.intervals)
        return Cone(self.tables, self.ends, self.columns, families, self.emission.whole)

    def integral(self, tolerance: float, rules: Rules, most_legs: int) -> Integral:
        """Integrate over angles, positions and wavelengths."""
        light = replace(self, family=self.family._replace(rules=rules))
        if not self.emission.panels:
            return light.point(0.5, tolerance, most_legs)
        middle = light.point(0.5, INNER_SHARE * tolerance, most_legs)
        if middle.error + middle.gaps > tolerance:  # other positions will not be within it either
            return middle._replace(share=0.0 * middle.share, gaps=1.0)
        return over_places(
            lambda place: light.point(place, INNER_SHARE * tolerance, most_legs), self.emission.panels, tolerance
        )

    def levels(self, tolerance: float) -> Sequence[tuple[float, int]]:
        """Minimum weights and maximum numbers of hits for exact following, if following everything is not feasible."""
        return LAST_LEVELS if self.emission.panels and tolerance >= ROUGH else FINE_LEVELS

    def tail(self, rules: Rules) -> Tail:
        """Return the light beyond the limits for sampling: rays in the plane are rays in space without inclination."""
        f, nothing = self.family, np.empty(0)
        family = FamilyInSpace(
            f.x, f.z, 0.0, 0.0, f.axis, 0.0, 0.0, 0.0, 0.0, 0.0, f.s, f.p, f.colour, rules, f.far, 1.0, 1.0, 1.0,
            f.low, f.high, 0.0, nothing, nothing,
        )  # fmt: skip
        columns = self.columns - 2 + MORE_COLUMNS
        return Tail(
            walls_of(self.tables),
            self.source,
            False,
            columns,
            lambda line: family._replace(colour=self.colours[line][0]),
        )

    def point(self, place: float, tolerance: float, most_legs: int) -> Integral:
        """Integrate the point at a position, at all wavelengths."""
        integrals = [self.cone(place, colour).integral(tolerance, most_legs) for colour, _ in self.colours]
        return integrals[0] if len(integrals) == 1 else weighted_sum(integrals, [weight for _, weight in self.colours])


def why_not(scene: Scene) -> str:
    """Return why a scene cannot be integrated; an empty text if it can."""
    if scene.is_random:
        return "a scene that scatters"
    if scene.front is not None:
        return "a lens whose section depends on the height"
    in_space = scene.extrusion is not None
    if in_space and any(interface.behaviour == "lens" for interface in scene.interfaces):
        return "an ideal lens in space"
    others = [
        type(source).__name__
        for source in scene.sources
        if source.emission() is None or (in_space and isinstance(source, Ambient))
    ]
    return f"a source {others[0]}" if others else ""


def is_extended(scene: Scene) -> bool:
    """Whether the light comes from more than one point, or at several wavelengths."""
    emissions = [source.emission() for source in scene.sources]
    return len(emissions) > 1 or any(
        emission is None or emission.panels > 0 or len(source.spectrum) > 1
        for emission, source in zip(emissions, scene.sources, strict=True)
    )


def default_tolerance(scene: Scene) -> float:
    """Return the default tolerance for a scene's powers."""
    in_space = scene.extrusion is not None
    return EXTENDED_TOLERANCE if in_space or is_extended(scene) else POINT_TOLERANCE


def most_legs_for(tolerance: float) -> int:
    """Return the number of ray segments after which an integration ends."""
    return int(min(FEWEST_LEGS * math.sqrt(max(LEGS_TOLERANCE / tolerance, 1.0)), GREATEST_LEGS))


def cause(found: Integral) -> str:
    """Return the reason why an uncertainty is not smaller."""
    if found.unfinished > found.error + found.gaps:
        return f"{found.unfinished:.1e} of the light is trapped beyond the largest number of hits; raise max_hits"
    return "light is trapped or split too often; choose a larger tolerance or a higher limit of ray segments"


class Panel(NamedTuple):
    """An interval of positions from 0 to 1, and its part of the integral."""

    error: float
    """of the quadrature over places alone"""
    low: float
    high: float
    found: Integral


def over_places(at: Callable[[float], Integral], panels: int, tolerance: float) -> Integral:
    """Integrate the results of ``at`` over positions from 0 to 1, halving the panel with the largest error first."""
    cuts, rule = np.linspace(0.0, 1.0, panels + 1).tolist(), COARSE if tolerance >= COARSE_TOLERANCE else RULE
    done = [_panel(at, rule, low, high)._replace(error=math.inf) for low, high in pairwise(cuts)]
    points, most = panels * len(rule.nodes), MOST_PLACES * panels
    while points < most and math.fsum(panel.error for panel in done) > OUTER_SHARE * tolerance:
        if math.fsum(panel.found.error + panel.found.gaps for panel in done) > tolerance:
            break  # halving panels would not help
        worst = max(range(len(done)), key=lambda i: done[i].error)
        panel = done.pop(worst)
        middle = 0.5 * (panel.low + panel.high)
        halves = (_panel(at, rule, panel.low, middle), _panel(at, rule, middle, panel.high))
        change = float(np.max(np.abs(panel.found.share - halves[0].found.share - halves[1].found.share)))
        done.extend(half._replace(error=max(half.error, CHANGE_SHARE * change)) for half in halves)
        points += 2 * len(rule.nodes)
    integral = weighted_sum([panel.found for panel in done], [1.0] * len(done))
    return integral._replace(error=integral.error + math.fsum(panel.error for panel in done))


def _panel(at: Callable[[float], Integral], rule: adapt.Rule, low: float, high: float) -> Panel:
    """Apply Gauss–Kronrod quadrature to one interval of positions."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    panel = [at(middle + half * node) for node in rule.nodes.tolist()]
    values = np.array([place.share for place in panel])
    error = half * float(np.max(np.abs((rule.kronrod - rule.gauss) @ values)))
    return Panel(error, low, high, weighted_sum(panel, (half * rule.kronrod).tolist()))


@dataclass(frozen=True, eq=False)
class Lights:
    """A compiled scene with all its sources."""

    scene: Scene
    mode: Mode
    rules: Rules
    each: tuple[Light | LightInSpace, ...]

    @classmethod
    def of(cls, scene: Scene, mode: Mode, limits: Limits) -> "Lights":
        """Compile a scene; `DesignError` as in `integrate`."""
        if why := why_not(scene):
            limit = "needs one outline for all heights, a scene without random scattering, and sources made of points"
            raise DesignError("adaptive integration", value=why, limit=limit, remedy="trace it with sampling sobol")
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
        """Whether the remainder can be sampled, which an ideal lens prevents."""
        return all(interface.behaviour != "lens" for interface in self.scene.interfaces)

    @property
    def in_plane(self) -> Light:
        """The first source, in a scene of the plane."""
        light = self.each[0]
        if isinstance(light, LightInSpace):
            raise DesignError(
                "source", value="in space", limit="is available only in the plane", remedy="leave it flat"
            )
        return light

    def trace(self, tolerance: float, most_legs: int | None = None) -> Trace:
        """Integrate over all sources."""
        legs = most_legs_for(tolerance) if most_legs is None else most_legs
        return self.trace_of([self._followed(light, tolerance, legs) for light in self.each], tolerance)

    def _followed(self, light: Light | LightInSpace, tolerance: float, most_legs: int) -> Integral:
        """Integrate one source and its tail at successive levels up to the tolerance, or return the best result."""
        best: Integral | None = None
        for weight, hits in ((0.0, self.rules.max_hits), *light.levels(tolerance)):
            if hits > self.rules.max_hits or 0.0 < weight <= self.rules.min_weight:
                continue
            rules = self.rules._replace(min_weight=max(weight, self.rules.min_weight), max_hits=hits)
            share, effort = (1.0, 1) if best is None else (EXACT_SHARE, LAST_EFFORT if hits < MANY_HITS else 1)
            found = light.integral(share * tolerance, rules, effort * most_legs)
            within = found.error + found.gaps <= tolerance or (hits < MANY_HITS and found.gaps < 1.0)
            if found.unfinished > NEGLIGIBLE * tolerance and within and self.has_tails:
                left = max(math.sqrt(max(tolerance**2 - found.error**2, 0.0)) - found.gaps, 0.5 * tolerance)
                found = light.tail(rules).added(
                    found, left, self.rules.max_hits, min(TAIL_LEGS, TAIL_SHARE * most_legs)
                )
            best = found if best is None or found.u < best.u else best
            if best.u <= tolerance:
                break
        if best is None:
            raise AssertionError("the first level is always evaluated")
        return best

    def trace_of(self, integrals: Sequence[Integral], tolerance: float) -> Trace:
        """Combine the integrals of all sources into a trace."""
        weights = [source.power / self.scene.emitted for source in self.scene.sources]
        whole = integrals[0] if len(integrals) == 1 else weighted_sum(integrals, weights)
        *detected, escaped, absorbed = (float(value) for value in whole.share)
        truncated = max(
            1.0 - math.fsum(detected) - escaped - absorbed, 0.0
        )  # the gaps, and the light that was truncated
        rays, legs, undefined, pieces = (int(count) for count in whole.counts)
        by_source = np.array([weight * part.share for part, weight in zip(integrals, weights, strict=True)])
        why = f"{rays} rays reach {whole.u:.1e} instead of {tolerance:g}: {cause(whole)}"
        return Trace(
            mode=self.mode,
            method="adaptive",
            rays=rays,
            detectors={
                name: Detected(power, whole.u, rays, tuple(by_source[:, i].tolist()))
                for i, (name, power) in enumerate(zip(self.scene.receivers, detected, strict=True))
            },
            monitors={},
            ledger=Ledger(math.fsum(detected), escaped, absorbed, truncated),
            u_ledger=Ledger(max(len(detected), 1) * whole.u, whole.u, whole.u, whole.u),
            hits=legs,
            undefined=undefined,
            missed=whole.missed,
            leaked=whole.leaked,
            u_missed=whole.u,
            u_leaked=whole.u,
            pieces=pieces,
            reached=whole.u <= tolerance,
            why="" if whole.u <= tolerance else why,
        )
