"""Default variations between prints: from the process, the emitter's part, the resin and the tolerances.

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

USUAL = "usual"
"""Text that stands for all variations that are not stated."""
GROWTH, SHRINKAGE = "process growth_um", "process shrinkage_percent"
GROWN = {"body.arm_width_mm": 2e-3, "lens.half_width_mm": 1e-3, "emitter.distance_mm": -1e-3}
"""Change of each number per µm of wall growth; the lens moves towards the emitter."""
SHRUNK = ("body.stem_length_mm", "body.arm_length_mm", "body.arm_width_mm", "lens.half_width_mm", "lens.focus_mm")
EXACT = 1e-6
"""Standard deviation of a number that a process states without uncertainty."""
OF_THE_PART = {"emitter.wavelength_nm": "peak_nm", "emitter.width_mm": "width_mm", "emitter.height_mm": "height_mm"}


def variations_of(
    sensor: Sensor, texts: Sequence[str], process: Path | None = None, *, compensated: bool = False
) -> list[Variation]:
    """Return the variations of texts, of a process and, without a text or with ``usual``, of all numbers not stated.

    Raises
    ------
    SpecError
        If a text is malformed, or a number varies twice.
    DataError
        If the process file cannot be read.
    """
    stated = [variation(text, sensor) for text in texts if text.strip() != USUAL]
    printed = [] if process is None else of_process(sensor, read_process(process), compensated=compensated)
    found = [*stated, *printed]
    keys = [one.key for one in found]
    twice = next((key for key in keys if keys.count(key) > 1), None)
    if twice:
        raise SpecError(f"--vary {twice}", limit="is specified twice", remedy="omit one")
    if len(stated) < len(texts) or not texts:
        of_the_print = {*GROWN, *SHRUNK} - {"emitter.distance_mm"} if printed else set()
        known = {key for one in stated for key in one.weights} | of_the_print
        found += usual_variations(sensor, known)
    return found


def of_process(sensor: Sensor, process: Process, *, compensated: bool) -> list[Variation]:
    """Return the growth of walls and the shrinkage stated by a process, as independent variations.

    If a calibration fitted both, shrinkage varies with growth according to their covariance, and its remainder is
    independent.
    """
    if sensor.is_network:
        limit = "describes the growth of the walls of a Y, which does not apply to a network"
        raise SpecError("--process", value=process.name, limit=limit, remedy="vary network.guides[0].width_mm")
    process = with_resin(process, sensor.design)
    keys, covariance = process.covariance()
    by_key = np.array([_of_one(process, key, math.sqrt(covariance[place, place])) for place, key in enumerate(keys)])
    (growth2, both), (_, shrinkage2) = (by_key.T @ covariance @ by_key).tolist() if len(keys) else ([0.0] * 2,) * 2
    grown, shrunk = _moved(sensor, GROWN), _moved(sensor, dict.fromkeys(SHRUNK, -0.01), by_length=True)
    with_growth = both / growth2 if growth2 else 0.0
    together = {key: grown.get(key, 0.0) + with_growth * shrunk.get(key, 0.0) for key in {**grown, **shrunk}}
    rest = math.sqrt(max(shrinkage2 - with_growth * both, 0.0))
    mean, mean_rest = growth_um(process.process), process.process.shrinkage_percent
    mean_rest -= with_growth * mean
    source = f"process {process.name}{', compensated' if compensated else ''}"
    return [
        Variation(name, "normal", 0.0 if compensated else middle, max(sd, EXACT), source, weights)
        for name, middle, sd, weights in (
            (GROWTH, mean, math.sqrt(growth2), together if with_growth else grown),
            (SHRINKAGE, mean_rest, rest, shrunk),
        )
        if weights and (sd > 0.0 or (middle and not compensated))
    ]


def _of_one(process: Process, key: str, u: float) -> list[float]:
    """Return the change of growth and shrinkage per unit of one number of a process."""

    def walls(settings: Settings) -> FloatArray:
        return np.array([growth_um(settings), settings.shrinkage_percent])

    change: list[float] = (half_difference(process, key, u, walls) / u).tolist()
    return change


def _moved(sensor: Sensor, weights: dict[str, float], *, by_length: bool = False) -> dict[str, float]:
    """Return the weights of the numbers that exist in the design; relative weights are multiplied by the values."""
    there = {key: weight for key, weight in weights.items() if not _is_absent(sensor, key)}
    return {key: weight * number(sensor, key) for key, weight in there.items()} if by_length else there


def _is_absent(sensor: Sensor, key: str) -> bool:
    try:
        number(sensor, key)
    except SpecError:
        return True
    return bool(why_inert(sensor, key))


def usual_variations(sensor: Sensor, known: set[str]) -> Iterator[Variation]:
    """Return variations of the numbers that affect the light and are uncertain: by part, resin or tolerance."""
    for key in optical_keys(sensor):
        if key in known or (key not in MATERIAL_KEYS and why_inert(sensor, key)):
            continue
        yield _of_part(sensor, key) or _of_tolerance(sensor, key)


def _of_part(sensor: Sensor, key: str) -> Variation | None:
    """Return the limits in the datasheet of the design's emitter for a number that the part determines."""
    design, name = sensor.design, OF_THE_PART.get(key, "")
    if not name or design.emitter.part is None or key.partition(".")[2] in design.emitter.model_fields_set:
        return None
    part = library_part(design.emitter.part) if design.part_file is None else load_part(design.part_file)
    limits = getattr(part, name) if isinstance(part, EmitterPart) else None
    if limits is None or limits.min is None or limits.max is None:
        return None
    return Variation(key, "uniform", limits.min - limits.nominal, limits.max - limits.nominal, f"part {part.name}")


def _of_tolerance(sensor: Sensor, key: str) -> Variation:
    """Return a resin's standard uncertainty as a normal distribution, or a tolerance as limits."""
    size, is_standard = tolerance_of(sensor, key)
    stated = key.partition("[")[0].replace(".", "_") in sensor.design.tolerance.model_fields_set
    source = f"resin {sensor.design.material.resin}" if is_standard else "[tolerance]" if stated else "assumed"
    if is_standard and _is_possible(sensor, key, -3.0 * size):
        return Variation(key, "normal", 0.0, size, source)
    size *= math.sqrt(3.0) if is_standard else 1.0
    least = -size if _is_possible(sensor, key, -size) else -min(size, number(sensor, key))
    return Variation(key, "uniform", least if _is_possible(sensor, key, least) else 0.0, size, source)


def _is_possible(sensor: Sensor, key: str, step: float) -> bool:
    """Return whether a number may deviate by a step; an absorption, for example, is not negative."""
    try:
        with_deviations(sensor, {key: step})
    except (SpecError, DesignError):
        return False
    return True
