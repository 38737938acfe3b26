"""Engine = reference where surfaces scatter, are coated, grey or textured, and media are turbid.

Both draw the same numbers for the same ray and hit, so that they are compared stretch by stretch, as smooth scenes are.
"""

import pytest

from solen.trace import Limits, Mode
from tests.agreement.random_scene_support import treated_scene
from tests.agreement.test_engine_is_reference import check_scene, told

MODES: tuple[Mode, ...] = ("count", "power", "roulette")
LIMITS = Limits(min_weight=1e-2, max_hits=60)


@pytest.mark.parametrize("mode", MODES)
def test_same_hits_in_treated_scenes(mode: Mode) -> None:
    share, line = told(mode, [check_scene(treated_scene(seed, 24), mode, LIMITS) for seed in range(4)])
    assert share < 0.2, line


@pytest.mark.evidence
@pytest.mark.parametrize("mode", MODES)
def test_same_hits_in_three_hundred_treated_scenes(mode: Mode) -> None:
    share, line = told(mode, [check_scene(treated_scene(seed, 24), mode, LIMITS) for seed in range(300)])
    print(f"\n  engine = reference, treated surfaces and turbid media, {line}")
    assert share < 0.2
