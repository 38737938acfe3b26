"""Warnings about keys of a design that its trace does not use.

Such a key is not an error, since other computations use it: `solen run` compares results in the plane with results in
space, and counted rays with powers, whatever dimension and mode the design specifies.
"""

from collections.abc import Iterator

from solen.scene import FINISHES
from solen.sensor.sensor import Sensor
from solen.spec import Wall
from solen.trace import Mode


def keys_without_effect(sensor: Sensor, mode: Mode | None = None) -> tuple[str, ...]:
    """Return a sentence for each key of the design that has no effect in the design's dimension or in ``mode``."""
    sentences = [] if sensor.design.trace.dimension == "extruded" else list(_unused_in_plane(sensor))
    shape = sensor.design.lens.shape
    if sensor.design.lens.profile is not None and shape not in ("measured", "layered"):
        sentences.append(f'lens.profile has no effect with lens.shape = "{shape}"; set lens.shape = "measured"')
    if mode == "count":
        sentences += _unused_in_counting(sensor)
    return tuple(sentences)


def _unused_in_plane(sensor: Sensor) -> Iterator[str]:
    design, remedy = sensor.design, 'has no effect in the plane; set trace.dimension = "extruded"'
    if design.receivers.height_mm is not None:
        yield f"receivers.height_mm = {design.receivers.height_mm:g} {remedy}"
    if design.emitter.y_mm != 0.0:
        yield f"emitter.y_mm = {design.emitter.y_mm:g} {remedy}"
    if design.emitter.height_mm > 0.0:
        yield f"emitter.height_mm = {design.emitter.height_mm:g} {remedy}"
    for i, wall in enumerate(design.wall):
        if wall.texture_pitch_um is not None and wall.texture_direction == "across":
            yield f'wall[{i}].texture_direction = "across" {remedy}'


def _unused_in_counting(sensor: Sensor) -> Iterator[str]:
    """Yield sentences about keys without effect in counting, which has neither powers nor waves."""
    design, remedy = sensor.design, 'has no effect in mode "count"; set trace.mode = "power"'
    if design.material.absorption_per_mm > 0.0:
        yield f"material.absorption_per_mm = {design.material.absorption_per_mm:g} {remedy}"
    for i, wall in enumerate(design.wall):
        if wall.absorption_per_mm > 0.0:
            yield f"wall[{i}].absorption_per_mm = {wall.absorption_per_mm:g} {remedy}"
        if wall.reflectance < 1.0:
            yield f"wall[{i}].reflectance = {wall.reflectance:g} {remedy}"
        if FINISHES[wall.finish].surface.table is not None:
            yield f'wall[{i}].finish = "{wall.finish}" {remedy}: counting ignores its reflectance table'
        for key, films in _films(wall).items():
            if films and not any(_reflects_totally(sensor, wall, index, nm) for index, nm in films):
                yield f"wall[{i}].{key} {remedy}: counting includes only thick films that reflect totally"


def _films(wall: Wall) -> dict[str, list[tuple[float, float]]]:
    """Return the indices and thicknesses in nm of the films that each key adds to a wall."""
    gap = [] if wall.gap_um is None else [(1.0, 1e3 * wall.gap_um)]
    return {"coating": [(film.index, film.thickness_nm) for film in wall.coating], "gap_um": gap}


def _reflects_totally(sensor: Sensor, wall: Wall, index: float, thickness_nm: float) -> bool:
    """Return whether a film reflects totally at some wavelength and angle, and so affects a count."""
    wavelengths = [nm for nm, _ in sensor.light.spectrum] or [sensor.light.wavelength_nm]
    return thickness_nm > min(wavelengths) and index < max(sensor.material.index, wall.index or 1.0)
