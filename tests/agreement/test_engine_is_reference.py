"""The compiled engine agrees with the reference on random scenes, segment by segment; see `compare_support`."""

import dataclasses
from collections.abc import Callable

import pytest

from solen.trace import Limits, Mode
from tests.agreement.compare_support import Comparison, check_scene, compare_tracers, complete, summary
from tests.agreement.random_scene_support import random_scene

LIMITS: dict[Mode, Limits] = {"count": Limits(max_hits=60), "power": Limits(min_weight=1e-3, max_hits=60)}
RAYS: dict[Mode, int] = {"count": 8, "power": 3}
MAX_EXCLUDED: dict[Mode, float] = {"count": 0.08, "power": 0.25}
"""On 100 scenes 0.03 and 0.14 were excluded: the paths of trapped light are chaotic, and in power mode every ray
leaves some light in a body.
"""

Record = Callable[[str, object], None]


def check_scenes(mode: Mode, seeds: range, rays: int) -> list[Comparison]:
    return [check_scene(random_scene(seed, rays), mode, LIMITS[mode]) for seed in seeds]


@pytest.mark.parametrize(
    "seeds",
    [range(20), *(pytest.param(range(first, first + 20), marks=pytest.mark.evidence) for first in (20, 40, 60, 80))],
    ids=str,
)
@pytest.mark.parametrize("mode", ["count", "power"])
def test_random_scenes(mode: Mode, seeds: range, record_property: Record, capsys: pytest.CaptureFixture[str]) -> None:
    comparisons = check_scenes(mode, seeds, RAYS[mode])
    excluded, line = summary(mode, comparisons)
    record_property("excluded", line)
    with capsys.disabled():
        print(f"\n  engine = reference, {line}")
    assert excluded < MAX_EXCLUDED[mode]
    assert complete(comparisons) >= 5  # so that readings are compared, too


@pytest.mark.parametrize("mode", ["count", "power"])
def test_rays_that_almost_meet_corners(mode: Mode) -> None:
    """Rays that miss a corner by as little as 1e-13 mm may start in a sliver between two curves and be undefined."""
    undefined = aimed = 0
    for seed in range(12):
        scene = random_scene(seed, 12, nearest_corner_mm=1e-13)
        scene = dataclasses.replace(scene, sources=scene.sources[-1:])
        reference, engine, _ = compare_tracers(scene, mode, LIMITS[mode])
        for result in (reference, engine):
            assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        undefined, aimed = undefined + engine.undefined, aimed + scene.rays
    assert undefined < 0.1 * aimed


@pytest.mark.parametrize("mode", ["count", "power"])
def test_more_rays_than_a_block(mode: Mode) -> None:
    """The engine traces rays in blocks; here there are more rays than fit into one, and branches have to wait."""
    excluded, _ = summary(mode, [check_scene(random_scene(200, 100), mode, Limits(min_weight=1e-2, max_hits=30))])
    assert excluded < MAX_EXCLUDED[mode]


@pytest.mark.evidence
@pytest.mark.parametrize("mode", ["count", "power"])
def test_a_thousand_random_scenes(mode: Mode) -> None:
    excluded, line = summary(mode, check_scenes(mode, range(1000, 2000), RAYS[mode]))
    print(f"\n  engine = reference, {line}")
    assert excluded < 1.5 * MAX_EXCLUDED[mode]  # 0.26 in power mode, mainly from a few scenes that trap light
