"""A run of a coupon, ready for the printer, with the layers and exposures of its job."""

import hashlib
from pathlib import Path

import numpy as np

from solen.errors import SpecError
from solen.fabricate.coupons.job import JOB_KIND, coupon_options, read_job
from solen.fabricate.coupons.solid import coupon_parts
from solen.fabricate.label import Label
from solen.fabricate.layers.options import Slicing
from solen.fabricate.layers.printable import Printable, described_resin, rotated_mesh
from solen.fabricate.layers.solid import Solid, exposures_of, fine_mesh, solid_of
from solen.geometry.coupons import Coupon, Stage
from solen.ranks import note
from solen.recording import Provenance


def printable_coupon(path: Path, slicing: Slicing, run: str | None = None) -> tuple[Printable, Slicing]:
    """Return a printable run of a coupon, and the options with the layers and exposures of its job.

    Parts with exposures of their own (cure discs, a single layer on a film) become separate images without burn-in.

    Raises
    ------
    DataError
        If the file is not a job.
    SpecError
        If the job has several runs and none is specified, or an option contradicts the job.
    """
    coupon, data = read_job(path)
    stage, options = _run(coupon, run), coupon_options(data, path)
    of_job = {
        "layer_um": options.layer_um,
        "exposure_s": options.exposure_s,
        "burn_in_layers": options.burn_in_layers,
        "burn_in_s": options.burn_in_s,
        "irradiance_mW_per_cm2": options.irradiance_mW_per_cm2,
        "z_offset_um": 1e3 * stage.z_offset_mm,
        "orientation": "flat",
        "rotate_deg": (0.0, 0.0, 0.0),
    }
    for key in slicing.model_fields_set & set(of_job):
        if getattr(slicing, key) != of_job[key]:
            limit = f"must be {of_job[key]}, as in the job"
            remedy = "omit the option, or write the coupon again with solen print coupons"
            raise SpecError(f"--{key.replace('_', '-')}", value=getattr(slicing, key), limit=limit, remedy=remedy)
    slicing = slicing.model_copy(update=of_job)
    part = coupon_parts(coupon)[stage.name]
    features = [feature for feature in coupon.features if feature.stage == stage.name]
    times = {feature.name: feature.exposure_s for feature in features if feature.exposure_s is not None}
    greys = {feature.name: feature.grey for feature in features if feature.grey is not None}
    names = [prism.name for prism in part.prisms]
    solid: Solid
    if len(times) == len(features):
        solid = exposures_of(part, [times[name] for name in names], [greys[name] for name in names] if greys else [])
    else:
        solid = solid_of(part, np.eye(3))
    label = Label(part.name, data["sha256"], f"coupon: {coupon.title}")
    material, resin = described_resin(slicing.resin)
    notes = tuple(note(text) for text in (stage.note, *coupon.cautions) if text)
    source = Provenance(path.name, hashlib.sha256(path.read_bytes()).hexdigest(), JOB_KIND)
    mesh = rotated_mesh(fine_mesh(part), np.eye(3))
    return Printable(solid, mesh, label, source, material, resin, notes), slicing


def _run(coupon: Coupon, name: str | None) -> Stage:
    """Return the run with a given name or, without a name, the only run."""
    names = [stage.name for stage in coupon.stages]
    if name is None and len(names) == 1:
        return coupon.stages[0]
    if name not in names:
        if len(names) == 1:
            raise SpecError("--run", value=name, limit="does not apply: the job has a single run", remedy="omit --run")
        limit = f"must be one of {', '.join(names)} for {coupon.name}"
        raise SpecError("--run", value=name, limit=limit, remedy="specify one of them")
    return coupon.stages[names.index(name)]
