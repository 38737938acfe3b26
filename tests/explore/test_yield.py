"""The yield of the paper's design against a brute-force count of traced prints, by the compiled batch."""

from functools import partial

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.explore import Store, ToleranceOptions, tolerance
from solen.explore.default_variations import variations_of
from solen.explore.measures import measure_of, merits_of_points
from solen.explore.responses import responses
from solen.explore.store import Variant
from solen.explore.variations import deviations_by_key
from solen.sensor import Sensor
from solen.spec import Design

DESIGN = Design(
    name="paper",
    material={"index": 1.44},
    motion={"from_deg": -3.0, "to_deg": 3.0, "step_deg": 0.25},
    emitter={"width_mm": 0.2, "pattern": "lambertian", "cone_deg": 120.0},
)
OPTIONS = ToleranceOptions(
    vary=(
        "emitter.offset_mm=normal:0:0.02",
        "emitter.width_mm=uniform:-0.02:0.02",
        "material.index=uniform:-0.005:0.005",
        "body.arm_width_mm=uniform:-0.02:0.02",
        "lens.half_width_mm=uniform:-0.01:0.01",
    ),
    require=("abs(null_deg) < 0.3", "abs(slope_per_deg / base - 1) < 0.1"),
    prints=512,
    rays=8192,
)
COUNTED, AT_ONCE, SCRAMBLINGS = 20_000, 1_000, 20


def _counted() -> float:
    """Share of prints drawn by a pseudo-random generator whose null and slope are within the limits."""
    variations = variations_of(Sensor.of(DESIGN), OPTIONS.vary)
    rng = np.random.default_rng(2026)
    prints = np.column_stack([one.quantile(rng.uniform(size=COUNTED)) for one in variations])
    (slope,) = _merits([{}])["slope_per_deg"]
    met = 0
    for first in range(0, COUNTED, AT_ONCE):
        merits = _merits([deviations_by_key(variations, row) for row in prints[first : first + AT_ONCE].tolist()])
        met += int(((np.abs(merits["null_deg"]) < 0.3) & (np.abs(merits["slope_per_deg"] / slope - 1.0) < 0.1)).sum())
    return met / COUNTED


def _merits(off: list[dict[str, float]]) -> dict[str, FloatArray]:
    points = responses([partial(Variant, DESIGN, one) for one in off], OPTIONS.accuracy, Store())
    return merits_of_points(measure_of(DESIGN), points)


@pytest.mark.evidence
def test_the_yield_of_the_papers_design_is_that_of_counting_prints() -> None:
    """Some 12 minutes of CPU: 20,000 prints counted, 20 scramblings of 512 each."""
    truth = _counted()
    u_truth = (truth * (1.0 - truth) / COUNTED) ** 0.5
    found = [tolerance(DESIGN, OPTIONS.model_copy(update={"seed": seed})).yields[-1] for seed in range(SCRAMBLINGS)]
    off = np.array([one.share - truth for one in found])
    u = np.array([one.u_share for one in found])
    rms = float(np.sqrt((off**2).mean()))
    ratio = float(np.sqrt(((off / np.hypot(u, u_truth)) ** 2).mean()))
    print(f"\n{truth:.4f} ± {u_truth:.4f} by counting {COUNTED}; rms error of {SCRAMBLINGS} x 512 prints {rms:.4f}, u ")
    print(f"{u.mean():.4f}, rms error over u {ratio:.2f}")
    assert rms <= 0.01
    assert ratio < 1.3
    assert (np.abs(off) < 2.0 * np.hypot(u, u_truth)).mean() >= 0.9
