"""The engine agrees with the reference where surfaces scatter, are coated, grey or textured, and media scatter.

Both draw the same random numbers for the same ray and hit, so they are compared segment by segment.
"""

import pytest

from solen.trace import Limits, Mode
from tests.agreement.compare_support import check_scene, summary
from tests.agreement.random_scene_support import treated_scene

MODES: tuple[Mode, ...] = ("count", "power", "roulette")
LIMITS = Limits(min_weight=1e-2, max_hits=60)


@pytest.mark.parametrize("mode", MODES)
def test_treated_scenes(mode: Mode) -> None:
    excluded, line = summary(mode, [check_scene(treated_scene(seed, 24), mode, LIMITS) for seed in range(4)])
    assert excluded < 0.2, line


@pytest.mark.evidence
@pytest.mark.parametrize("mode", MODES)
def test_three_hundred_treated_scenes(mode: Mode) -> None:
    excluded, line = summary(mode, [check_scene(treated_scene(seed, 24), mode, LIMITS) for seed in range(300)])
    print(f"\n  engine = reference, treated surfaces and turbid media, {line}")
    assert excluded < 0.2
