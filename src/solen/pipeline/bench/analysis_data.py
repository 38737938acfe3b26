"""What an analysis found as plain data: numbers, lists and None, never NaN."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from solen.analysis import Analysed, Curve, Group, Run
from solen.analysis.numbers import NEAR_ZERO_DEG

if TYPE_CHECKING:
    from solen.pipeline.bench.analyse import Request, Study


def result(found: "Study", asked: "Request") -> dict[str, Any]:
    """The whole result."""
    made = {
        "sensors": {sensor.label: _sensor(sensor) for sensor in found.sensors},
        "mean_of_sensors": _group(found.lens),
        "mean_of_controls": _group(found.control),
        "lens_beside_none": _beside(found.lens, found.control),
        "alignment": list(found.alignments),
        "settings": _settings(found, asked),
        "simulated": found.simulated,
        "sources": [one.as_dict() for one in found.sources],
        "warnings": [*found.warnings, *_of_all(found)],
    }
    plain: dict[str, Any] = as_plain(made)
    return plain


def as_plain(value: Any) -> Any:
    """Lists, floats and None instead of arrays, numpy's numbers and what is not finite."""
    if isinstance(value, Mapping):
        return {key: as_plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray):
        return as_plain(value.tolist())
    if isinstance(value, list | tuple):
        return [as_plain(one) for one in value]
    if isinstance(value, np.bool_ | np.integer):
        return value.item()
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return value


def remark(asked: "Request") -> str:
    """What a figure must say about how it was made; empty for nothing."""
    return "" if asked.smooth_ms is None else f"moving mean over {asked.smooth_ms:g} ms"


def _settings(study: "Study", asked: "Request") -> dict[str, Any]:
    found = asdict(study.settings)
    found |= {"smooth_ms": asked.smooth_ms, "zero_deg": asked.columns.zero_deg, "angle_flipped": asked.columns.flip}
    return found | {"near_zero_deg": NEAR_ZERO_DEG}


def _sensor(sensor: Analysed) -> dict[str, Any]:
    return {
        "lens": sensor.lens,
        "cycles": [one for run in sensor.runs for one in _cycles(run)],
        "cycles_used": sensor.passes.cycles,
        "receivers": {
            name: {**_curves(sensor, place), **sensor.numbers[name]} for place, name in enumerate(sensor.receivers)
        },
        "left_minus_right": sensor.pair,
        "motion": [_motion(run) for run in sensor.runs],
    }


def _cycles(run: Run) -> list[dict[str, Any]]:
    return [
        {"start_s": cycle.start_s, "end_s": cycle.end_s, "used": place in run.used, "file": run.signals.source}
        for place, cycle in enumerate(run.motion.cycles)
    ]


def _curves(sensor: Analysed, place: int) -> dict[str, Any]:
    whole = sensor.curve(place)
    return {
        "angle_deg": sensor.passes.angle_deg,
        "mean_V": whole.mean_V,
        "sd_V": whole.sd_V,
        "ways": whole.count,
        "rising": _way(sensor.curve(place, 0)),
        "falling": _way(sensor.curve(place, 1)),
    }


def _way(found: Curve) -> dict[str, Any]:
    return {"mean_V": found.mean_V, "sd_V": found.sd_V}


def _motion(run: Run) -> dict[str, Any]:
    motion = run.motion
    return {
        "file": run.signals.source,
        "rest_deg": motion.rest_deg,
        "lowest_deg": motion.low_deg,
        "highest_deg": motion.high_deg,
        "speed_deg_per_s": motion.speed_deg_per_s,
        "noise_deg": motion.noise_deg,
        "step_deg": motion.step_deg,
        "holds": len(motion.holds),
    }


def _group(group: Group | None) -> dict[str, Any] | None:
    if group is None:
        return None
    return {
        "n": len(group.labels),
        "labels": list(group.labels),
        "angle_deg": group.angle_deg,
        "receivers": {
            name: {
                "mean_V": group.mean_V[name],
                "sd_V": group.sd_V[name],
                "swing_V": group.swing_V[name],
                "sd_swing_V": group.sd_swing_V[name],
            }
            for name in group.mean_V
        },
    }


def _beside(lens: Group | None, control: Group | None) -> dict[str, Any] | None:
    """How much of the swing with a lens there is without one, by receiver."""
    if lens is None or control is None:
        return None
    found = {}
    for name in lens.swing_V:
        if name in control.swing_V:
            ours, theirs = lens.swing_V[name], control.swing_V[name]
            share = 100.0 * abs(theirs / ours) if ours else np.nan
            found[name] = {"swing_V": ours, "swing_without_lens_V": theirs, "without_lens_percent": share}
    return found


def _of_all(found: "Study") -> list[str]:
    """What the number of sensors does not allow to say."""
    told = []
    for group, what in ((found.lens, "with a lens"), (found.control, "without a lens")):
        if group is not None and len(group.labels) == 1 and len(found.sensors) > 1:
            told.append(f"one sensor {what}: how far prints differ cannot be told from it")
    if found.lens is not None and len(found.sensors) == 1:
        told.append("one sensor: its cycles show how it repeats, not how far prints differ")
    return told
