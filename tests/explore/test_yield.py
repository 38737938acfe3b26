"""The yield of the published design compared with a brute-force count of prints traced with the compiled batch."""

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
PRINTS, BATCH, SCRAMBLINGS = 20_000, 1_000, 20


def _counted_yield() -> float:
    """Return the fraction of prints, drawn with a pseudo-random generator, whose null and slope are within limits."""
    variations = variations_of(Sensor.of(DESIGN), OPTIONS.vary)
    rng = np.random.default_rng(2026)
    prints = np.column_stack([variation.quantile(rng.uniform(size=PRINTS)) for variation in variations])
    (slope,) = _merits([{}])["slope_per_deg"]
    met = 0
    for first in range(0, PRINTS, BATCH):
        merits = _merits([deviations_by_key(variations, row) for row in prints[first : first + BATCH].tolist()])
        met += int(((np.abs(merits["null_deg"]) < 0.3) & (np.abs(merits["slope_per_deg"] / slope - 1.0) < 0.1)).sum())
    return met / PRINTS


def _merits(deviations: list[dict[str, float]]) -> dict[str, FloatArray]:
    points = responses([partial(Variant, DESIGN, print_) for print_ in deviations], OPTIONS.accuracy, Store())
    return merits_of_points(measure_of(DESIGN), points)


@pytest.mark.evidence
def test_yield_of_published_design_agrees_with_count() -> None:
    """Count 20,000 prints, and estimate the yield with 20 scramblings of 512 prints: about 12 minutes of CPU time."""
    truth = _counted_yield()
    u_truth = (truth * (1.0 - truth) / PRINTS) ** 0.5
    yields = [tolerance(DESIGN, OPTIONS.model_copy(update={"seed": seed})).yields[-1] for seed in range(SCRAMBLINGS)]
    errors = np.array([estimate.share - truth for estimate in yields])
    u = np.array([estimate.u_share for estimate in yields])
    rms = float(np.sqrt((errors**2).mean()))
    ratio = float(np.sqrt(((errors / np.hypot(u, u_truth)) ** 2).mean()))
    print(f"\n{truth:.4f} ± {u_truth:.4f} from {PRINTS} prints; RMS error of {SCRAMBLINGS} x 512 prints {rms:.4f}, ")
    print(f"u {u.mean():.4f}, RMS ratio of error to u {ratio:.2f}")
    assert rms <= 0.01
    assert ratio < 1.3
    assert (np.abs(errors) < 2.0 * np.hypot(u, u_truth)).mean() >= 0.9
