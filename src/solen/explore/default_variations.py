"""Default variations between prints: those of the process, the emitter's part, the resin and the tolerances.

Public name: `variations_of`.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.explore.variations import Variation, variation
from solen.fabricate.process.growth import growth_um
from solen.fabricate.process.predict import half_difference
from solen.fabricate.process.process_file import Process, read_process
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.source import with_resin
from solen.parts import EmitterPart, library_part, load_part
from solen.sensor import Sensor
from solen.sensor.effects import with_deviations
from solen.sensor.numbers import MATERIAL_KEYS, number, optical_keys, tolerance_of, why_inert
from solen.spec.strict import repeated

USUAL = "usual"
"""Value of ``--vary`` that adds the default variations to the specified ones."""
GROWTH, SHRINKAGE = "process growth_um", "process shrinkage_percent"
MM_PER_GROWTH_UM = {"body.arm_width_mm": 2e-3, "lens.half_width_mm": 1e-3, "emitter.distance_mm": -1e-3}
"""Change of each parameter per µm of wall growth; the lens moves towards the emitter."""
SHRINKING = ("body.stem_length_mm", "body.arm_length_mm", "body.arm_width_mm", "lens.half_width_mm", "lens.focus_mm")
MIN_SD = 1e-6
"""Standard deviation of a property that a process file specifies without uncertainty, in µm or per cent."""
DATASHEET_LIMITS = {
    "emitter.wavelength_nm": "peak_nm",
    "emitter.width_mm": "width_mm",
    "emitter.height_mm": "height_mm",
}
"""Attribute of the emitter's part that contains the datasheet limits of a parameter, keyed by parameter."""


def variations_of(
    sensor: Sensor, texts: Sequence[str], process: Path | None = None, *, compensated: bool = False
) -> list[Variation]:
    """Return the specified variations and those of a process; without texts or with ``usual``, also the default ones.

    Raises
    ------
    SpecError
        If a text is malformed, or a parameter varies twice.
    DataError
        If the process file cannot be read.
    """
    specified = [variation(text, sensor) for text in texts if text.strip() != USUAL]
    printed = [] if process is None else process_variations(sensor, read_process(process), compensated=compensated)
    variations = [*specified, *printed]
    keys = [variation.key for variation in variations]
    twice = repeated(keys)
    if twice:
        raise SpecError(f"--vary {twice}", limit="is specified twice", remedy="omit one of its variations")
    if len(specified) < len(texts) or not texts:
        by_process = {*MM_PER_GROWTH_UM, *SHRINKING} - {"emitter.distance_mm"} if printed else set()
        known = {key for variation in specified for key in variation.weights} | by_process
        variations += default_variations(sensor, known)
    return variations


def process_variations(sensor: Sensor, process: Process, *, compensated: bool) -> list[Variation]:
    """Return the wall growth and the shrinkage of a process as independent variations.

    If a calibration fitted both, the part of the shrinkage that is correlated with growth varies with it, and the
    remainder is independent.
    """
    if sensor.is_network:
        limit = "describes the growth of the walls of a Y, and does not apply to a network"
        raise SpecError("--process", value=process.name, limit=limit, remedy="vary network.guides[0].width_mm")
    process = with_resin(process, sensor.design)
    keys, covariance = process.covariance()
    by_key = np.array([_derivatives(process, key, math.sqrt(covariance[k, k])) for k, key in enumerate(keys)])
    (growth2, both), (_, shrinkage2) = (by_key.T @ covariance @ by_key).tolist() if len(keys) else ([0.0] * 2,) * 2
    growth_weights = _weights(sensor, MM_PER_GROWTH_UM)
    shrinkage_weights = _weights(sensor, dict.fromkeys(SHRINKING, -0.01), by_length=True)
    slope = both / growth2 if growth2 else 0.0
    combined = {
        key: growth_weights.get(key, 0.0) + slope * shrinkage_weights.get(key, 0.0)
        for key in {**growth_weights, **shrinkage_weights}
    }
    remainder_sd = math.sqrt(max(shrinkage2 - slope * both, 0.0))
    growth = growth_um(process.process)
    remainder = process.process.shrinkage_percent - slope * growth
    source = f"process {process.name}{', compensated' if compensated else ''}"
    return [
        Variation(name, "normal", 0.0 if compensated else mean, max(sd, MIN_SD), source, weights)
        for name, mean, sd, weights in (
            (GROWTH, growth, math.sqrt(growth2), combined if slope else growth_weights),
            (SHRINKAGE, remainder, remainder_sd, shrinkage_weights),
        )
        if weights and (sd > 0.0 or (mean and not compensated))
    ]


def _derivatives(process: Process, key: str, u: float) -> list[float]:
    """Return the derivatives of growth and shrinkage with respect to one property of a process."""

    def growth_and_shrinkage(settings: Settings) -> FloatArray:
        return np.array([growth_um(settings), settings.shrinkage_percent])

    derivatives: list[float] = (half_difference(process, key, u, growth_and_shrinkage) / u).tolist()
    return derivatives


def _weights(sensor: Sensor, weights: dict[str, float], *, by_length: bool = False) -> dict[str, float]:
    """Return the weights of the parameters that the design has, multiplied by their values if ``by_length``."""
    present = {key: weight for key, weight in weights.items() if not _is_absent(sensor, key)}
    return {key: weight * number(sensor, key) for key, weight in present.items()} if by_length else present


def _is_absent(sensor: Sensor, key: str) -> bool:
    try:
        number(sensor, key)
    except SpecError:
        return True
    return bool(why_inert(sensor, key))


def default_variations(sensor: Sensor, known: set[str]) -> Iterator[Variation]:
    """Yield variations of all other parameters that affect the light, from the part, the resin or the tolerances."""
    for key in optical_keys(sensor):
        if key in known or (key not in MATERIAL_KEYS and why_inert(sensor, key)):
            continue
        yield _from_part(sensor, key) or _from_tolerance(sensor, key)


def _from_part(sensor: Sensor, key: str) -> Variation | None:
    """Return a variation within the limits of the emitter's datasheet; None if the part does not determine the key."""
    design, name = sensor.design, DATASHEET_LIMITS.get(key, "")
    if not name or design.emitter.part is None or key.partition(".")[2] in design.emitter.model_fields_set:
        return None
    part = library_part(design.emitter.part) if design.part_file is None else load_part(design.part_file)
    limits = getattr(part, name) if isinstance(part, EmitterPart) else None
    if limits is None or limits.min is None or limits.max is None:
        return None
    return Variation(key, "uniform", limits.min - limits.nominal, limits.max - limits.nominal, f"part {part.name}")


def _from_tolerance(sensor: Sensor, key: str) -> Variation:
    """Return a normal distribution for the standard uncertainty of a resin, and a uniform one for a tolerance."""
    size, is_standard = tolerance_of(sensor, key)
    specified = key.partition("[")[0].replace(".", "_") in sensor.design.tolerance.model_fields_set
    source = f"resin {sensor.design.material.resin}" if is_standard else "[tolerance]" if specified else "assumed"
    if is_standard and _is_possible(sensor, key, -3.0 * size):
        return Variation(key, "normal", 0.0, size, source)
    size *= math.sqrt(3.0) if is_standard else 1.0
    lower = -size if _is_possible(sensor, key, -size) else -min(size, number(sensor, key))
    return Variation(key, "uniform", lower if _is_possible(sensor, key, lower) else 0.0, size, source)


def _is_possible(sensor: Sensor, key: str, step: float) -> bool:
    """Return whether a parameter may deviate by a step; an absorption, for example, cannot be negative."""
    try:
        with_deviations(sensor, {key: step})
    except (SpecError, DesignError):
        return False
    return True
