"""Studies over a few angles, traced once for all tests of the report."""

from collections.abc import Callable

import pytest

from solen.report.design.html import figures
from solen.sensor import DesignStudy, study
from solen.spec import loads, template, with_values

DESIGNS: dict[str, dict[str, object]] = {
    "paper": {},
    "mismatched": {"material.index": 1.49, "lens.design_index": 1.44},
    "no lens": {"lens.shape": "none"},
    "one-sided": {"motion.from_deg": 1.0, "motion.step_deg": 1.0},
    "dark": {"material.absorption_per_mm": 1000.0},
    "dim": {"material.absorption_per_mm": 0.02, "body.arm_angle_deg": 7.4},
    "acrylate": {"material.resin": "pmma", "motion.step_deg": 1.5},
    "one angle": {"motion.step_deg": 10.0},
    "half way": {"motion.step_deg": 4.0},
    "odd name": {"name": '<b>&" Ω </title><script>x</script>', "lens.shape": "none"},
    "from below": {"motion.pivot": [0.0, 20.0]},
    "narrow": {"emitter.cone_deg": 1.0},
    "almost": {"lens.design_index": 1.44001},
    "no comparison": {"motion.pivot": [30.0, 0.0]},
    "chip": {"emitter.width_mm": 0.3, "emitter.offset_mm": 0.02},
    "as published": {"material.resin": "ma-pu-as-published"},
    "uncertain": {"material.resin": "uncertain.toml"},
    "in space": {"trace.dimension": "extruded", "emitter.pattern": "uniform", "emitter.cone_deg": 90.0},
}

UNCERTAIN = """
schema = 1
name = "uncertain"
source = "a test"

[index]
kind = "number"
mode = "lossless"
n = 1.46
u_n = 0.02
warnings = ["taken from T alone"]

[loss]
absorption_per_mm = 0.01
u_absorption_per_mm = 0.002
wavelength_nm = 940
"""
"""Resin with a large uncertainty of the index, and a loss at another wavelength."""

PRACTICAL = ("paper", "mismatched", "no lens", "one-sided", "dark", "chip", "in space", "uncertain")
"""Designs that are also studied as built, with the effects of tolerances."""
ALL_EFFECTS = ("paper", "uncertain")
"""Designs for which the effects of all parameters are computed."""

Studies = Callable[[str], DesignStudy]
Drawn = Callable[[str], dict[str, str]]


@pytest.fixture(scope="session")
def studied(tmp_path_factory: pytest.TempPathFactory) -> Studies:
    cache: dict[str, DesignStudy] = {}
    folder = tmp_path_factory.mktemp("designs")
    (folder / "uncertain.toml").write_text(UNCERTAIN, encoding="utf-8")

    def get(name: str) -> DesignStudy:
        if name not in cache:
            design = with_values(loads(template("paper-860")), {"motion.step_deg": 3.0, **DESIGNS[name]})
            design = design.in_folder(folder)
            with pytest.MonkeyPatch.context() as patch:
                if name not in ALL_EFFECTS:
                    patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm", "material.index"))
                if name != "paper":
                    patch.setattr("solen.sensor.effects.HOLDS", {})
                cache[name] = study(design, practical=name in PRACTICAL)
        return cache[name]

    return get


@pytest.fixture(scope="session")
def drawn(studied: Studies) -> Drawn:
    """Figures of a study, drawn once for all tests."""
    cache: dict[str, dict[str, str]] = {}

    def get(name: str) -> dict[str, str]:
        if name not in cache:
            cache[name] = figures(studied(name))
        return dict(cache[name])

    return get
