"""The job of a coupon: how it is to be exposed, what its nominal sizes and places are, and what was read into it.

A job is a JSON file beside the solids. It holds the whole layout, so that `solen print fidelity` matches what was measured to
what was asked for, whatever parameters the coupon was made with.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from solen import __version__
from solen.errors import DataError
from solen.files import read_text
from solen.geometry.coupons import Choices, Coupon, as_data, coupon_of

JOB_KIND = "coupon-job"
SCHEMA = 1
WHOLE = 1e-6
"""How far a number of layers may be from a whole one."""
AXES = "x to the right and y up as seen from above, in mm from the middle; z from the build plate"
ORIENTATION = "flat on the build plate as drawn, not turned and not mirrored; heights along the build direction"


def job_sha256(coupon: Coupon, choices: Choices) -> str:
    """Checksum of what a job asks for: the layout and the parameters."""
    text = json.dumps([as_data(coupon), asdict(choices)], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def as_job(coupon: Coupon, choices: Choices, files: dict[str, dict[str, str]]) -> dict[str, Any]:
    """The job as plain data; ``files`` are the names of the solids by stage and format."""
    dose = choices.irradiance_mW_per_cm2
    return {
        "kind": JOB_KIND,
        "schema": SCHEMA,
        "solen": __version__,
        "coupon": coupon.name,
        "title": coupon.title,
        "sha256": job_sha256(coupon, choices),
        "axes": AXES,
        "orientation": ORIENTATION,
        "print": {
            "layer_um": choices.layer_um,
            "exposure_s": choices.exposure_s,
            "burn_in_layers": choices.burn_in_layers,
            "burn_in_s": choices.burn_in_s,
            "irradiance_mW_per_cm2": dose,
            "energy_mJ_per_cm2": dose * choices.exposure_s,
            "burn_in_energy_mJ_per_cm2": dose * choices.burn_in_s,
        },
        "stages": [_stage(coupon, choices, stage.name, files.get(stage.name, {})) for stage in coupon.stages],
        "choices": asdict(choices),
        "layout": as_data(coupon),
        "warnings": cautions(coupon, choices),
    }


def _stage(coupon: Coupon, choices: Choices, name: str, files: dict[str, str]) -> dict[str, Any]:
    stage = next(one for one in coupon.stages if one.name == name)
    features = [one for one in coupon.features if one.stage == name]
    top = max(one.to_mm for one in features)
    own = [
        {"feature": one.name, "exposure_s": one.exposure_s, "energy_mJ_per_cm2": _energy(one.exposure_s, choices)}
        for one in features
        if one.exposure_s is not None
    ]
    return {
        "name": name,
        "note": stage.note,
        "z_offset_mm": stage.z_offset_mm,
        "height_mm": top,
        "layers": None if own else max(1, round(1e3 * top / choices.layer_um)),
        "exposures": own,
        "files": files,
    }


def _energy(exposure_s: float, choices: Choices) -> float:
    return exposure_s * choices.irradiance_mW_per_cm2


def cautions(coupon: Coupon, choices: Choices) -> list[str]:
    """What this printer, as far as its layer and pixel are known, cannot make of the coupon."""
    return [*coupon.cautions, *_of_layers(coupon, choices), *_of_pixels(coupon, choices)]


def _of_layers(coupon: Coupon, choices: Choices) -> list[str]:
    """Heights and steps that are no whole number of layers."""
    if coupon.name == "cure-discs":
        return []
    layer_mm = 1e-3 * choices.layer_um
    heights = {round(height, 9) for one in coupon.features for height in (one.from_mm, one.to_mm)}
    broken = sorted(height for height in heights if not _whole(height / layer_mm))
    found = []
    if broken:
        shown = ", ".join(f"{height:g}" for height in broken[:6]) + (" …" if len(broken) > 6 else "")
        found.append(
            f"{len(broken)} of {len(heights)} heights ({shown} mm) are no whole number of layers of "
            f"{choices.layer_um:g} µm: they come out rounded"
        )
    thin = sorted({step.step_mm for step in coupon.steps if step.step_mm < layer_mm * (1.0 - WHOLE)})
    if thin:
        shown = ", ".join(f"{1e3 * step:g}" for step in thin)
        found.append(f"steps of {shown} µm are less than a layer of {choices.layer_um:g} µm")
    return found


def _of_pixels(coupon: Coupon, choices: Choices) -> list[str]:
    """Sizes and gaps below a pixel."""
    if choices.pitch_um is None:
        return []
    pitch_mm = 1e-3 * choices.pitch_um
    small = [one.name for one in coupon.features if min(one.width_mm, one.depth_mm) < pitch_mm]
    narrow = [gap.name for gap in coupon.gaps if gap.gap_mm < pitch_mm]
    found = []
    if small:
        found.append(f"{', '.join(small)}: smaller than a pixel of {choices.pitch_um:g} µm")
    if narrow:
        found.append(f"{', '.join(narrow)}: gaps below a pixel of {choices.pitch_um:g} µm can be told by grey alone")
    return found


def _whole(layers: float) -> bool:
    return abs(layers - round(layers)) <= WHOLE * max(1.0, layers)


def read_job(path: Path) -> tuple[Coupon, dict[str, Any]]:
    """Coupon of a job file, and the whole job.

    Raises
    ------
    DataError
        Where the file cannot be read, is no job, or its layout is damaged.
    """
    text = read_text(path, DataError)
    try:
        data = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as bad:
        raise DataError(
            str(path), limit=f"not valid JSON: {bad}", remedy="write it anew: solen print coupons"
        ) from None
    if not isinstance(data, dict) or data.get("kind") != JOB_KIND:
        raise DataError(
            str(path), limit="is no job of a coupon", remedy="solen print coupons writes one beside each coupon"
        )
    if data.get("schema") != SCHEMA:
        limit = f"this solen reads schema {SCHEMA}"
        raise DataError(
            f"{path}: schema", value=data.get("schema"), limit=limit, remedy="write it anew: solen print coupons"
        )
    return coupon_of(data.get("layout"), str(path)), data


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")
