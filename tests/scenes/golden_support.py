"""Golden scenes: how one is read and traced, and what is kept of it."""

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
    """One reading of one mode, and how far from it a trace may be."""

    mode: str
    reading: str
    value: float
    tolerance: float


def scene_of(name: str) -> Scene:
    """The golden scene of that name."""
    return load(FOLDER / f"{name}.json")


def rows_of(name: str) -> list[Row]:
    """The readings kept for it."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return [
            Row(row["mode"], row["reading"], float(row["value"]), float(row["tolerance"]))
            for row in csv.DictReader(file)
        ]


def readings(result: Trace) -> dict[str, float]:
    """All numbers of a trace by name."""
    found = {
        f"ledger {part}": getattr(result.ledger, part) for part in ("detected", "escaped", "absorbed", "truncated")
    }
    for name, reading in result.detectors.items():
        found |= {f"receiver {name}": reading.power}
    for name, crossed in result.monitors.items():
        found |= {f"monitor {name}": crossed.power}
        found |= {f"monitor {name} bin {i}": float(power) for i, power in enumerate(crossed.power_by_bin)}
    return found


def measured(scene: Scene) -> dict[str, dict[str, float]]:
    """Readings of both modes; an undefined ray is an error."""
    results = {mode: trace(scene, mode) for mode in MODES}
    for mode, result in results.items():
        if result.undefined:
            raise AssertionError(f"{scene.name}, {mode}: rays of undefined medium at {result.undefined_at_mm}")
    return {mode: readings(result) for mode, result in results.items()}


def as_csv(scene: Scene, tolerance: float) -> str:
    """The readings of a scene as they are kept."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for mode, found in measured(scene).items():
        for reading, value in found.items():
            writer.writerow((mode, reading, f"{value:.12g}", f"{tolerance:g}"))
    return text.getvalue()
