"""The job file of a coupon: exposures, and nominal sizes and positions.

A job is a JSON file next to the solids. It contains the complete layout, so that `solen print fidelity` can compare
measured sizes with nominal sizes, whatever the options with which the coupon was made.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from solen import __version__
from solen.errors import DataError, SpecError
from solen.files import read_text
from solen.geometry.coupons import Coupon, CouponOptions, Stage, coupon_of
from solen.ranks import Caution, note, warning
from solen.spec.objects import parse_json

JOB_KIND = "coupon-job"
SCHEMA = 1
ROUNDING = 1e-6
"""Tolerance within which a number of layers is treated as an integer."""
AXES = "x to the right and y up, seen from above, in mm from the centre; z from the build plate"
ORIENTATION = "flat on the build plate as drawn, not rotated or mirrored; heights are along the build direction"


def job_sha256(coupon: Coupon, options: CouponOptions) -> str:
    """Return the checksum of the layout and the options of a job."""
    text = json.dumps([asdict(coupon), options.model_dump()], sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def as_job(coupon: Coupon, options: CouponOptions, files: dict[str, dict[str, str]]) -> bytes:
    """Return the job as JSON; ``files`` are the names of the solids, keyed by stage and format."""
    irradiance = options.irradiance_mW_per_cm2
    job = {
        "kind": JOB_KIND,
        "schema": SCHEMA,
        "solen": __version__,
        "coupon": coupon.name,
        "title": coupon.title,
        "sha256": job_sha256(coupon, options),
        "axes": AXES,
        "orientation": ORIENTATION,
        "print": {
            "layer_um": options.layer_um,
            "exposure_s": options.exposure_s,
            "burn_in_layers": options.burn_in_layers,
            "burn_in_s": options.burn_in_s,
            "irradiance_mW_per_cm2": irradiance,
            "energy_mJ_per_cm2": irradiance * options.exposure_s,
            "burn_in_energy_mJ_per_cm2": irradiance * options.burn_in_s,
        },
        "stages": [_stage(coupon, options, stage, files.get(stage.name, {})) for stage in coupon.stages],
        "choices": options.model_dump(),
        "layout": asdict(coupon),
        "warnings": cautions(coupon, options),
    }
    return f"{json.dumps(job, indent=1, allow_nan=False)}\n".encode()


def _stage(coupon: Coupon, options: CouponOptions, stage: Stage, files: dict[str, str]) -> dict[str, Any]:
    features = [feature for feature in coupon.features if feature.stage == stage.name]
    top = max(feature.to_mm for feature in features)
    exposures = [
        {
            "feature": feature.name,
            "exposure_s": feature.exposure_s,
            **({} if feature.grey is None else {"grey": feature.grey}),
            "energy_mJ_per_cm2": feature.exposure_s * options.irradiance_mW_per_cm2,
        }
        for feature in features
        if feature.exposure_s is not None
    ]
    return {
        "name": stage.name,
        "note": stage.note,
        "z_offset_mm": stage.z_offset_mm,
        "height_mm": top,
        "layers": 1 if exposures else max(1, round(1e3 * top / options.layer_um)),
        "burn_in_layers": 0 if exposures else options.burn_in_layers,
        "exposures": exposures,
        "files": files,
    }


def cautions(coupon: Coupon, options: CouponOptions) -> list[Caution]:
    """Return warnings about features that the printer's layers and pixels cannot resolve."""
    return [*map(note, coupon.cautions), *_layer_warnings(coupon, options), *_pixel_warnings(coupon, options.pitch_um)]


def _layer_warnings(coupon: Coupon, options: CouponOptions) -> list[Caution]:
    """Warn if heights are not multiples of the layer thickness, or steps are lower than a layer."""
    if coupon.name in ("cure-discs", "grey-steps"):
        return []
    layer_mm = 1e-3 * options.layer_um
    heights = {round(height, 9) for feature in coupon.features for height in (feature.from_mm, feature.to_mm)}
    fractional = sorted(height for height in heights if not _is_integer(height / layer_mm))
    warnings = []
    if fractional:
        shown = _listed(fractional[:6]) + (" …" if len(fractional) > 6 else "")
        text = f"{len(fractional)} of {len(heights)} heights ({shown} mm) are not multiples of the layer thickness"
        warnings.append(warning(f"{text}, {options.layer_um:g} µm, and will be rounded"))
    thin = sorted({step.step_mm for step in coupon.steps if step.step_mm < layer_mm * (1.0 - ROUNDING)})
    if thin:
        steps = _listed(1e3 * step for step in thin)
        warnings.append(warning(f"steps of {steps} µm are lower than a layer of {options.layer_um:g} µm"))
    return warnings


def _pixel_warnings(coupon: Coupon, pitch_um: float | None) -> list[Caution]:
    """Warn if sizes or gaps are smaller than a pixel."""
    if pitch_um is None:
        return []
    pitch_mm = 1e-3 * pitch_um
    small = [feature.name for feature in coupon.features if min(feature.width_mm, feature.depth_mm) < pitch_mm]
    narrow = [gap.name for gap in coupon.gaps if gap.gap_mm < pitch_mm]
    warnings = []
    if small:
        warnings.append(warning(f"{', '.join(small)}: smaller than a pixel of {pitch_um:g} µm"))
    if narrow:
        text = f"{', '.join(narrow)}: narrower than a pixel of {pitch_um:g} µm, drawn only as grey pixels"
        warnings.append(warning(text))
    return warnings


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _is_integer(layers: float) -> bool:
    return abs(layers - round(layers)) <= ROUNDING * max(1.0, layers)


def read_job(path: Path) -> tuple[Coupon, dict[str, Any]]:
    """Return the coupon of a job file, and the complete job.

    Raises
    ------
    DataError
        If the file cannot be read, is not a job, or has a damaged layout.
    """
    data = parse_json(read_text(path, DataError), str(path))
    remedy = "write the job again with solen print coupons"
    if not isinstance(data, dict) or data.get("kind") != JOB_KIND:
        raise DataError(str(path), limit="is not a coupon job", remedy=remedy)
    if data.get("schema") != SCHEMA:
        limit = f"must be {SCHEMA}, which this version of solen reads"
        raise DataError(f"{path}: schema", value=data.get("schema"), limit=limit, remedy=remedy)
    return coupon_of(data.get("layout"), str(path)), data


def coupon_options(job: dict[str, Any], path: Path) -> CouponOptions:
    """Return the layout options of a job; raise `DataError` if they are damaged."""
    choices, remedy = job.get("choices"), "write the job again with solen print coupons"
    if not isinstance(choices, dict):
        raise DataError(f"{path}: choices", limit="is missing", remedy=remedy)
    try:
        return CouponOptions(**choices)
    except SpecError as error:
        raise DataError(f"{path}: choices", limit=str(error), remedy=remedy) from None
