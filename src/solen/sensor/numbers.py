"""Numbers of a design that affect its light: keys, values and tolerances."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from solen.errors import SpecError
from solen.geometry import arm_angle_deg
from solen.spec import Design, value_at
from solen.spec.network import Network

if TYPE_CHECKING:
    from solen.sensor.sensor import Sensor

OPTICAL_KEYS = (
    *(f"emitter.{name}" for name in ("wavelength_nm", "distance_mm", "offset_mm", "cone_deg", "width_mm", "height_mm")),
    *(f"material.{name}" for name in ("index", "absorption_per_mm")),
    *(f"lens.{name}" for name in ("focus_mm", "half_width_mm", "design_index")),
    *(f"body.{name}" for name in ("stem_length_mm", "stem_curve_per_mm", "arm_length_mm", "arm_width_mm")),
    *("body.arm_angle_deg", "body.thickness_mm", "receivers.gap_mm"),
)
"""Numbers of a design that affect its light at a given angle of the motion."""
LENS_IN_SPACE_KEYS = ("emitter.y_mm", "lens.y_focus_mm")
"""Further numbers that affect light through a lens that is not a cylinder."""

MATCHED_REASON = (
    "a medium with the same index touches a wall: there is no derivative at this index, since any increase or decrease "
    "of the index causes reflection"
)
LAYERS_REASON = "the number of layers is an integer, so the layer boundaries jump: compare two designs with --set"
MATERIAL_KEYS = ("material.index", "material.absorption_per_mm")
DEFAULT_TOLERANCES = {"material.index": 0.01, "material.absorption_per_mm": 0.005}
"""Tolerances of a resin without a specified uncertainty: a reflectance known to 0.001 gives the index to 0.008."""
PRINTED_MM, PRINTED_DEG = 0.05, 0.5
"""Tolerances of a network's printed lengths and directions."""
POSITION_MM = 0.5
"""Position tolerance of a hold or a finger on a soft body."""
MODULUS_FRACTION = 0.1
"""Relative tolerance of a soft body's modulus."""
LIGHT_KEYS = ("wavelength_nm", "cone_deg", "width_mm", "height_mm")
"""Numbers of the emitter that a part may supply."""


def number(sensor: "Sensor", key: str) -> float:
    """Return a number of the design; raise `SpecError` if the key is not that of a real number with a value."""
    value = value_at(sensor.design, key)
    table, _, name = key.partition(".")
    if table == "emitter" and name in LIGHT_KEYS:
        value = getattr(sensor.light, name)
    if value is None and key == "body.arm_angle_deg":
        value = arm_angle_deg(sensor.design)
    if key == "material.absorption_per_mm" or (key == "material.index" and value is None):
        value = getattr(sensor.material, name)  # the design's absorption, otherwise the resin's
    if not isinstance(value, float):
        limit = "must be the key of a real number with a value in the design"
        raise SpecError(key, value=value, limit=limit, remedy="name another key, or set a number")
    return value


def tolerance_of(sensor: "Sensor", key: str) -> tuple[float, bool]:
    """Return the tolerance of a number, by default one per cent, and whether it is a standard uncertainty."""
    specified = sensor.design.tolerance.of(key)
    u = {
        "material.index": sensor.material.u_index,
        "material.absorption_per_mm": sensor.material.u_absorption_per_mm,
    }.get(key)
    if specified is None and u:
        return u, True
    default = DEFAULT_TOLERANCES.get(key) or (POSITION_MM if "[" in key and key.endswith("_mm") else 0.0)
    if key.startswith("network."):
        default = PRINTED_DEG if key.endswith("_deg") else PRINTED_MM if "_mm" in key else 0.0
    if key == "mechanics.modulus_MPa":
        default = MODULUS_FRACTION * number(sensor, key)
    return specified or default or 0.01 * abs(number(sensor, key)) or 0.01, False


def why_inert(sensor: "Sensor", key: str) -> str:
    """Return the reason why a number of the design has no effect of its own on the light; empty if it has one."""
    design = sensor.design
    resin = design.material.resin is not None
    is_2d, in_plane = design.trace.dimension == "2d", "has no effect in the plane"
    if sensor.is_measured and key.startswith("lens."):
        return "the lens is measured"
    if sensor.is_network:
        if why := _why_inert_in_network(design, key):
            return why
    elif sensor.is_drawn and key.startswith(("lens.", "body.", "emitter.distance_mm")) and key != "body.thickness_mm":
        return "the body is drawn"
    cases = {
        "lens.layer_mm": (True, LAYERS_REASON),
        "lens.y_focus_mm": (
            not isinstance(design.lens.y_focus_mm, float),
            "the design gives no value: set one"
            if design.lens.shape == "line-focus"
            else 'applies to lens.shape = "line-focus" only',
        ),
        "emitter.y_mm": (is_2d, in_plane),
        "emitter.wavelength_nm": (
            bool(design.emitter.spectrum) or (not resin and not sensor.scene().wavelengths_nm),
            "emitter.spectrum gives the wavelengths"
            if design.emitter.spectrum
            else "the design gives one index for all wavelengths",
        ),
        "emitter.width_mm": (sensor.light.width_mm == 0.0, "the emitter is a point"),
        "emitter.height_mm": (is_2d or sensor.light.height_mm == 0.0, in_plane if is_2d else "the emitter is a line"),
        "body.thickness_mm": (is_2d and not sensor.is_loaded, in_plane),  # a load is distributed over it
        "material.index": (
            resin or _is_matched(sensor),
            "follows from the resin and the wavelength" if resin else MATCHED_REASON,
        ),
        "material.absorption_per_mm": (resin and not design.material.sets_absorption, "follows from the resin"),
        "lens.focus_mm": (not sensor.has_lens, "the design has no lens"),
        "lens.design_index": (
            not sensor.has_lens or design.lens.design_index is None,
            "equals the material's index" if sensor.has_lens else "the design has no lens",
        ),
        "receivers.gap_mm": (design.receivers.gap_mm is None, "the design has no air gap"),
    }
    applies, why = cases.get(key, (False, ""))
    return why if applies else ""


def _why_inert_in_network(design: Design, key: str) -> str:
    """Return the reason why a number has no effect on a network; empty if it has one."""
    table, _, name = key.partition(".")
    if table == "body" and name != "thickness_mm":
        return "the body is a network"
    if design.body.file is not None and (table == "lens" or key == "emitter.distance_mm"):
        return "the network is drawn"
    parts = {"lens": design.network.lenses, "emitter": design.network.emitters}.get(table, ())
    if table == "lens" and not parts:
        return "the network has no lens"
    specified = bool(parts) and all(getattr(part, name, None) is not None for part in parts)
    return f"every {table} of the network specifies its own value" if specified else ""


def _is_matched(sensor: "Sensor") -> bool:
    """Return whether a medium with the body's index touches a wall with no film in between: the index does not jump."""
    bare = [wall for wall in sensor.design.wall if wall.gap_um is None and not wall.coating]
    return any(wall.index == sensor.material.index for wall in bare)


def optical_keys(sensor: "Sensor") -> tuple[str, ...]:
    """Return the keys of the numbers on which a sensor's light may depend; see `why_inert`."""
    if sensor.is_network:
        return (*OPTICAL_KEYS, *_network_keys(sensor.design.network))
    knots = (f"lens.knots_um[{knot}]" for knot in range(len(sensor.design.lens.knots_um or ())))
    in_space = LENS_IN_SPACE_KEYS if sensor.is_sampled else ()
    return (*OPTICAL_KEYS, *in_space, *knots, *(_load_keys(sensor) if sensor.is_loaded else ()))


def _network_keys(network: Network) -> Iterator[str]:
    """Yield the keys of guides' widths, lengths and directions, and of the numbers that lenses and emitters set."""
    for number, guide in enumerate(network.guides):
        key = f"network.guides[{number}]"
        yield f"{key}.width_mm" if isinstance(guide.width_mm, float) else f"{key}.width_mm[0]"
        yield from (f"{key}.{name}" for name in ("length_mm", "direction_deg") if getattr(guide, name) is not None)
    for table in ("lenses", "emitters"):
        for number, part in enumerate(getattr(network, table)):
            yield from (f"network.{table}[{number}].{name}" for name, value in part if isinstance(value, float))


def _load_keys(sensor: "Sensor") -> Iterator[str]:
    """Yield the keys of the positions of holds, fingers and pulls that the design sets, and of the modulus."""
    for table in ("hold", "press", "pull"):
        for number, row in enumerate(getattr(sensor.design, table)):
            specified = [key for key in ("from_mm", "to_mm", "at_mm", "radius_mm") if getattr(row, key, None)]
            yield from (f"{table}[{number}].{key}" for key in specified)
    if sensor.design.mechanics.modulus_MPa is not None:
        yield "mechanics.modulus_MPa"
