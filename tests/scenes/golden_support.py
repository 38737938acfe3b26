"""Golden scenes: loading, tracing, and their stored readings."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

from solen.scene import Scene, load
from solen.trace import Mode, Trace, trace

FOLDER = Path(__file__).parent
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))
MODES: tuple[Mode, ...] = ("count", "power")
HEADER = ("mode", "reading", "value", "tolerance")


@dataclass(frozen=True)
class Row:
    """A stored reading in one mode, and its tolerance."""

    mode: str
    reading: str
    value: float
    tolerance: float


def scene_of(name: str) -> Scene:
    """Return the golden scene with a name."""
    return load(FOLDER / f"{name}.json")


def rows_of(name: str) -> list[Row]:
    """Return the stored readings of a scene."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return [
            Row(row["mode"], row["reading"], float(row["value"]), float(row["tolerance"]))
            for row in csv.DictReader(file)
        ]


def readings(result: Trace) -> dict[str, float]:
    """Return the readings of a trace, keyed by name."""
    fates = ("detected", "escaped", "absorbed", "truncated")
    values = {f"ledger {fate}": getattr(result.ledger, fate) for fate in fates}
    for name, reading in result.detectors.items():
        values |= {f"receiver {name}": reading.power}
    for name, crossed in result.monitors.items():
        values |= {f"monitor {name}": crossed.power}
        values |= {f"monitor {name} bin {i}": float(power) for i, power in enumerate(crossed.power_by_bin)}
    return values


def traced_readings(scene: Scene) -> dict[str, dict[str, float]]:
    """Return the readings of a scene in both modes; raise `AssertionError` if a ray is undefined."""
    results = {mode: trace(scene, mode) for mode in MODES}
    for mode, result in results.items():
        if result.undefined:
            raise AssertionError(f"{scene.name}, {mode}: undefined rays at {result.undefined_at_mm}")
    return {mode: readings(result) for mode, result in results.items()}


def as_csv(scene: Scene, tolerance: float) -> str:
    """Return the readings of a scene as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for mode, values in traced_readings(scene).items():
        for reading, value in values.items():
            writer.writerow((mode, reading, f"{value:.12g}", f"{tolerance:g}"))
    return text.getvalue()
