"""Integration over the launch angle of a point source, and over the places and colours of an extended one.

A point source is integrated over its angles as `solen.trace.cone` says. A source with a size is a family of point
sources side by side. What one of them gives is a continuous function of its place with sharp bends, where a jump enters
or leaves the cone; it is integrated by Gauss–Kronrod quadrature again, halving the panel of the largest error until all
errors together are small. Both rules may agree by chance at a bend; so every panel is halved once at least, and a
panel's error is held to be at least a share of what halving the panel before it has changed. Colours are summed by
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
from solen.scene.sources import Emission, Emitter
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
from solen.trace.space import LightInSpace, why_not_in_space
from solen.trace.tables import Tables, compile_scene
from solen.trace.tail import Tail

INNER_SHARE, OUTER_SHARE = 0.2, 0.6
"""Shares of the tolerance for the integral at one place of a source, and for the one over its places."""
MOST_PLACES = 3000
"""Places of a source, or of each panel that it begins with, at which the integration over them ends."""
CHANGE_SHARE = 0.5
"""Least error of half a panel, as a share of what halving it has changed."""
LEAST_SHARE = 0.01
EXACT_SHARE, NEGLIGIBLE = 0.7, 0.02
"""Shares of the tolerance: for the exact part beside a sampled tail; of light that is not worth sampling."""
FEWEST_LEGS, LEGS_TOLERANCE, GREATEST_LEGS = 1_000_000, 1e-4, 20_000_000
"""Straight stretches of light at least, for a tolerance, and at most: their number grows as its root falls."""
LAST_LEVELS = ((0.5, 3), (0.5, 1))
FINE_LEVELS = ((1e-2, 24), *LAST_LEVELS)
"""Least weights and most hits: over one coordinate many branches can be followed; over several, what a trapped ray
gives is chaos, and samples serve better."""
ROUGH = 3e-5
"""Tolerance from which on samples do for a source with a size."""
TAIL_LEGS, TAIL_SHARE, LAST_EFFORT, MANY_HITS = 120_000_000, 120, 5, 10
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-12, 0.1
POINT_TOLERANCE, EXTENDED_TOLERANCE = 1e-6, 1e-4
"""Default tolerance of powers: for a point of the plane in one wavelength, and for any other source."""


def integrate(
    scene: Scene,
    mode: Mode = "power",
    tolerance: float = 1e-6,
    limits: Limits | None = None,
    *,
    most_legs: int | None = None,
) -> Trace:
    """Power at every receiver of a scene, over the angles, places and colours of its sources.

    Parameters
    ----------
    scene
        Its sources are made of points: fans, chips, emitters, ambient light; the numbers of rays that they name play no
        part. Nothing in it scatters. In an extruded scene emitters are integrated in space. Monitors are not read.
        Light through a lens whose walls are not upright is integrated by nets, see `solen.trace.nets`.
    mode
        ``"count"`` or ``"power"``, as in `solen.trace.trace`; splitting and absorption included.
    tolerance
        What the uncertainty of every power shall not exceed, as a fraction of the emitted power; 1e-12 to 0.1. For a
        source with a size 1e-4 takes some hundred points of it.
    limits
        Where following a branch exactly ends; by default the least weight is a hundredth of the tolerance. What is left
        then is sampled, for ``max_hits`` interfaces at most (`solen.trace.tail`). Where the tolerance is not reached
        so, less is followed exactly and more is sampled.
    most_legs
        After so many straight stretches of light from one point, and of samples, the integration ends, whatever its
        uncertainty; in space after five times as many where it is near the tolerance. By default their number grows as
        the tolerance falls. Nets end so, too, and after 2²¹ rays.

    Returns
    -------
    Trace
        With method ``"adaptive"``: values, one estimate of their error, and whether it is within the tolerance. Light
        that is trapped for more than ``max_hits`` counts as truncated and is part of the uncertainty. By nets the
        method is ``"sobol"``, and uncertainties are standard errors.

    Raises
    ------
    DesignError
        A beam or a list of rays, a cone without width, a scene that scatters, ambient light in space, or a tolerance
        out of range.
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
    """`integrate` for many scenes, the positions of a motion or the variants of a design, on several threads."""
    check_mode(mode)
    if not LEAST_TOLERANCE <= tolerance <= MOST_TOLERANCE:
        limit = f"must be from {LEAST_TOLERANCE:g} to {MOST_TOLERANCE:g}"
        raise DesignError("tolerance", value=tolerance, limit=limit)
    if mode == "roulette":
        raise DesignError("mode", value=mode, limit="adaptive integration needs count or power")
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
    """The points of a scene's only source, one by one: what each of them gives every receiver.

    Parameters
    ----------
    scene
        As for `integrate`, with one source.
    tolerance
        Tolerance of each power, as a fraction of what the point emits.

    Raises
    ------
    DesignError
        As `integrate`, and where there are more sources than one.
    """

    def __init__(self, scene: Scene, tolerance: float = 1e-6) -> None:
        if len(scene.sources) != 1:
            raise DesignError("sources", value=len(scene.sources), limit="must be a single one")
        limits = Limits(min_weight=LEAST_SHARE * tolerance)
        self._light = Lights.of(scene, "power", limits).in_plane
        self._tolerance = tolerance
        self._receivers = len(scene.receivers)

    def powers(self, places: Sequence[float]) -> np.ndarray:
        """Shares (n, receivers) from places (n,), 0 at the right end of the source and 1 at its left one.

        `DesignError` where one is not reached within the tolerance.
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
    """A source in a compiled scene: its points side by side, each in all its colours.

    ``family`` is what all its rays share, ``colours`` are wavelengths by their place in the tables, with their shares.
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
        """Light of one source of a scene; `DesignError` where it is not made of points, or its cone has no width."""
        emission = source.emission()
        if emission is None:
            raise AssertionError("a source that is not made of points was refused before")
        if not emission.whole > 0.0:
            raise DesignError("cone_deg", value=0.0, limit="must be above 0 to integrate over it")
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
        """The point at a place from 0 to 1, in one colour."""
        x, z, axis_deg = self.emission.at(place)
        here = self.family._replace(x=x, z=z, axis=math.radians(axis_deg), colour=colour)
        families = tuple(here._replace(**stretch._asdict()) for stretch in self.emission.stretches)
        return Cone(self.tables, self.ends, self.columns, families, self.emission.whole)

    def integral(self, tolerance: float, rules: Rules, most_legs: int) -> Integral:
        """Integrate over angles, places and colours."""
        light = replace(self, family=self.family._replace(rules=rules))
        if not self.emission.panels:
            return light.point(0.5, tolerance, most_legs)
        middle = light.point(0.5, INNER_SHARE * tolerance, most_legs)
        if middle.error + middle.gaps > tolerance:  # nor will other places do
            return middle._replace(share=0.0 * middle.share, gaps=1.0)
        return over_places(
            lambda place: light.point(place, INNER_SHARE * tolerance, most_legs), self.emission.panels, tolerance
        )

    def levels(self, tolerance: float) -> Sequence[tuple[float, int]]:
        """Least weights and most hits of what is followed exactly where following all of it does not do."""
        return LAST_LEVELS if self.emission.panels and tolerance >= ROUGH else FINE_LEVELS

    def tail(self, rules: Rules) -> Tail:
        """What is left beyond the rules: rays of the plane are rays in space that do not rise."""
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
        """All colours of the point at a place."""
        integrals = [self.cone(place, colour).integral(tolerance, most_legs) for colour, _ in self.colours]
        return integrals[0] if len(integrals) == 1 else weighted_sum(integrals, [weight for _, weight in self.colours])


def why_not(scene: Scene) -> str:
    """Why a scene cannot be integrated; empty where it can."""
    if scene.is_random:
        return "a scene that scatters"
    if scene.front is not None:
        return "a lens that differs by height"
    if scene.extrusion is not None:
        return why_not_in_space(scene)
    others = [type(source).__name__ for source in scene.sources if source.emission() is None]
    return f"a source {others[0]}" if others else ""


def is_extended(scene: Scene) -> bool:
    """Whether its light comes from more than one point, or in several colours."""
    emissions = [source.emission() for source in scene.sources]
    return len(emissions) > 1 or any(
        emission is None or emission.panels > 0 or len(source.spectrum) > 1
        for emission, source in zip(emissions, scene.sources, strict=True)
    )


def usual_tolerance(scene: Scene) -> float:
    """Default tolerance of a scene's powers."""
    in_space = scene.extrusion is not None
    return EXTENDED_TOLERANCE if in_space or is_extended(scene) else POINT_TOLERANCE


def most_legs_for(tolerance: float) -> int:
    """Straight stretches of light after which an integration ends."""
    return int(min(FEWEST_LEGS * math.sqrt(max(LEGS_TOLERANCE / tolerance, 1.0)), GREATEST_LEGS))


def cause(found: Integral) -> str:
    """Why an uncertainty is not smaller."""
    if found.unfinished > found.error + found.gaps:
        return f"{found.unfinished:.1e} of the light is trapped beyond the most hits; raise max_hits"
    return "light is trapped or divided too often; ask for a larger tolerance, or for more legs"


class Panel(NamedTuple):
    """A stretch of places from 0 to 1, and its part of the integral over all of them."""

    error: float
    """of the quadrature over places alone"""
    low: float
    high: float
    found: Integral


def over_places(at: Callable[[float], Integral], panels: int, tolerance: float) -> Integral:
    """Integral over places from 0 to 1 of what is found ``at`` each, the panel of the largest error halved first."""
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
    """Gauss–Kronrod quadrature over one stretch of places."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    panel = [at(middle + half * node) for node in rule.nodes.tolist()]
    values = np.array([place.share for place in panel])
    error = half * float(np.max(np.abs((rule.kronrod - rule.gauss) @ values)))
    return Panel(error, low, high, weighted_sum(panel, (half * rule.kronrod).tolist()))


@dataclass(frozen=True, eq=False)
class Lights:
    """A scene with all its sources, compiled."""

    scene: Scene
    mode: Mode
    rules: Rules
    each: tuple[Light | LightInSpace, ...]

    @classmethod
    def of(cls, scene: Scene, mode: Mode, limits: Limits) -> "Lights":
        """Lights of a scene; `DesignError` as in `integrate`."""
        if why := why_not(scene):
            limit = "needs one outline for all heights, a scene without chance, and sources that are made of points"
            raise DesignError("adaptive integration", value=why, limit=limit, remedy="trace it, with sampling sobol")
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
        """Whether what is left can be sampled: not behind an ideal lens."""
        return all(interface.behaviour != "lens" for interface in self.scene.interfaces)

    @property
    def in_plane(self) -> Light:
        """The first light, of a scene of the plane."""
        light = self.each[0]
        if isinstance(light, LightInSpace):
            raise DesignError("source", value="in space", limit="this is known in the plane", remedy="leave it flat")
        return light

    def trace(self, tolerance: float, most_legs: int | None = None) -> Trace:
        """Integrate over all sources."""
        legs = most_legs_for(tolerance) if most_legs is None else most_legs
        return self.trace_of([self._followed(light, tolerance, legs) for light in self.each], tolerance)

    def _followed(self, light: Light | LightInSpace, tolerance: float, most_legs: int) -> Integral:
        """Integral of one light and its tail: the first within the tolerance, or else the best."""
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
            raise AssertionError("the first level is always taken")
        return best

    def trace_of(self, integrals: Sequence[Integral], tolerance: float) -> Trace:
        """Result of what was found for each source."""
        weights = [source.power / self.scene.emitted for source in self.scene.sources]
        whole = integrals[0] if len(integrals) == 1 else weighted_sum(integrals, weights)
        *detected, escaped, absorbed = (float(value) for value in whole.share)
        truncated = max(
            1.0 - math.fsum(detected) - escaped - absorbed, 0.0
        )  # the gaps, and what was cut off on the way
        rays, legs, undefined, pieces = (int(count) for count in whole.counts)
        by_source = np.array([weight * part.share for part, weight in zip(integrals, weights, strict=True)])
        why = f"{rays} rays reach {whole.u:.1e} and not {tolerance:g}: {cause(whole)}"
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
