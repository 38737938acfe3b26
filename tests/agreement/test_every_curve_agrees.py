"""The engine is held to the reference on scenes of every curve, behaviour and source, in every mode.

`compare_support` has the rule by which rays are compared. The roulette's numbers belong to a seed, a ray and a hit, so
both tracers draw the same and are compared ray by ray as well.
"""

import math
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.scene import Beam, Chip, Fan, Rays
from solen.scene.model import BEHAVIOURS
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from tests.agreement.compare_support import TURN_RAD, Comparison, compared, turned
from tests.agreement.random_scene_support import motley_scene, treated_scene

LIMITS: dict[Mode, Limits] = {
    "count": Limits(max_hits=60),
    "power": Limits(min_weight=1e-3, max_hits=60),
    "roulette": Limits(max_hits=60),
}
RAYS: dict[Mode, int] = {"count": 3, "power": 1, "roulette": 3}
MAX_LEFT_OUT: dict[Mode, float] = {"count": 0.2, "power": 0.3, "roulette": 0.2}
"""Measured 0.08, 0.16 and 0.08 on 120 scenes."""
MODES: list[Mode] = ["count", "power", "roulette"]


def same_readings(truth: Trace, engine: Trace) -> None:
    """Everything that both tracers sum up; called where no stretch is left out."""
    assert (engine.hits, engine.truncated) == (truth.hits, truth.truncated)
    for name, reading in truth.detectors.items():
        mine = engine.detectors[name]
        assert mine.rays == reading.rays
        assert mine.power == pytest.approx(reading.power, rel=1e-9, abs=1e-12)
        assert mine.power_by_source == pytest.approx(reading.power_by_source, rel=1e-9, abs=1e-12)
        assert mine.optical_path_mm == pytest.approx(reading.optical_path_mm, rel=1e-9, nan_ok=True)
    for name, crossed in truth.monitors.items():
        assert engine.monitors[name].rays == crossed.rays
        assert engine.monitors[name].power == pytest.approx(crossed.power, rel=1e-9, abs=1e-12)
        np.testing.assert_allclose(engine.monitors[name].power_by_bin, crossed.power_by_bin, rtol=1e-9, atol=1e-12)
    for mine_at, its_at in (
        (engine.truncated_at_mm, truth.truncated_at_mm),
        (engine.undefined_at_mm, truth.undefined_at_mm),
    ):
        assert len(mine_at) == len(its_at)
        if truth.truncated < 16:  # of more, either keeps those that it came to first
            np.testing.assert_allclose(sorted(mine_at), sorted(its_at), atol=1e-9)


def check(seed: int, mode: Mode, rays: int) -> Comparison:
    """All that is asked of one scene."""
    scene, limits = motley_scene(seed, rays), LIMITS[mode]
    truth, more, less = (
        trace_reference(turned(scene, angle) if angle else scene, mode, limits, seed=seed, legs=True)
        for angle in (0.0, TURN_RAD, -TURN_RAD)
    )
    engine = trace(scene, mode, limits, seed=seed, legs=True)
    comparison = compared(truth, (more, less), engine)
    assert comparison.deviation_power < 1e-9, scene.name
    assert comparison.deviation_optical_mm < 1e-8, scene.name
    for result in (truth, engine):
        assert result.undefined == 0, f"{scene.name}: {result.undefined_at_mm}"
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12), scene.name
    if comparison.left_out == 0:
        same_readings(truth, engine)
    return comparison


def told(mode: Mode, done: list[Comparison]) -> tuple[float, str]:
    """Share left out, and a line about it."""
    total, left_out = sum(c.stretches for c in done), sum(c.left_out for c in done)
    whole = sum(c.left_out == 0 for c in done)
    line = (
        f"{mode}: {len(done)} scenes, {total} stretches, {left_out} left out ({left_out / total:.2%}), "
        f"{whole} scenes whole; largest deviations {max(c.deviation_mm for c in done):.1e} mm, "
        f"{max(c.deviation_power for c in done):.1e} of the power, "
        f"{max(c.deviation_optical_mm for c in done):.1e} mm of optical path"
    )
    return left_out / total, line


@pytest.mark.parametrize("mode", MODES)
def test_same_hits_powers_and_optical_paths_on_scenes_of_every_curve(mode: Mode) -> None:
    done = [check(seed, mode, RAYS[mode]) for seed in range(20)]
    share, line = told(mode, done)
    assert share < MAX_LEFT_OUT[mode], line
    assert sum(c.left_out == 0 for c in done) >= 5  # enough whole scenes to compare readings


@pytest.mark.evidence
@pytest.mark.parametrize("mode", MODES)
def test_same_hits_on_a_thousand_scenes_of_every_curve(mode: Mode) -> None:
    share, line = told(mode, [check(seed, mode, RAYS[mode]) for seed in range(1000, 2000)])
    print(f"\n  engine = reference, every curve, {line}")
    assert share < MAX_LEFT_OUT[mode]


def test_the_scenes_have_every_curve_behaviour_source_and_kind_of_light() -> None:
    """What the tests above rely on."""
    scenes = [motley_scene(seed, 2) for seed in range(20)]
    kinds: set[type[Curve]] = {type(face.curve) for scene in scenes for face in scene.interfaces}
    assert kinds == {Segment, Arc, Parabola, Conic, CartesianOval, Bezier, Spline}
    ideal = {face.behaviour for seed in range(20) for face in treated_scene(seed, 2).interfaces}
    assert {face.behaviour for scene in scenes for face in scene.interfaces} | ideal == set(BEHAVIOURS)
    assert {"lens", "splitter"} <= ideal
    assert {type(source) for scene in scenes for source in scene.sources} == {Fan, Beam, Rays, Chip}
    assert {len(source.spectrum) for scene in scenes for source in scene.sources} == {0, 1, 2, 3}
    conics = [face.curve for scene in scenes for face in scene.interfaces if isinstance(face.curve, Conic)]
    shapes = [conic.conic_constant for conic in conics]
    assert min(shapes) < -1.0 < max(shapes)
    assert {-1.0, 0.0} <= set(shapes)
    splines = [face.curve for scene in scenes for face in scene.interfaces if isinstance(face.curve, Spline)]
    assert {spline.closed for spline in splines} == {False, True}
    assert any(_corners(spline) for spline in splines if spline.closed)
    assert any(not _corners(spline) for spline in splines if spline.closed)


def _corners(spline: Spline) -> int:
    """Joints at which it turns by more than a degree."""
    ends = [(a, b, c) for (*_, a, b), (_, c, *_) in pairwise((*spline.controls, spline.controls[0]))]
    return sum(abs(math.remainder(_turn(b, c) - _turn(a, b), math.tau)) > math.radians(1.0) for a, b, c in ends)


def _turn(a: tuple[float, float], b: tuple[float, float]) -> float:
    return math.atan2(b[1] - a[1], b[0] - a[0])
