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
OF_A_LENS_IN_SPACE = ("emitter.y_mm", "lens.y_focus_mm")
"""Further numbers that affect light through a lens for space."""

MATCHED = (
    "a medium of the same index touches a wall: no derivative exists there, since light is reflected "
    "for either sign of the change"
)
LAYERS = "the number of layers is an integer, so the layer boundaries jump: compare two designs with --set"
OF_THE_MATERIAL = ("material.index", "material.absorption_per_mm")
USUAL = {"material.index": 0.01, "material.absorption_per_mm": 0.005}
"""Tolerances for a resin without a specified uncertainty: a reflectance known to 0.001 gives the index to 0.008."""
DRAWN_MM, DRAWN_DEG = 0.05, 0.5
"""Tolerances of a network's printed lengths and directions."""
PLACED_MM = 0.5
"""Position tolerance of a hold or a finger on a soft body."""
MODULUS_SHARE = 0.1
"""Relative tolerance of a soft body's modulus."""
OF_THE_LIGHT = ("wavelength_nm", "cone_deg", "width_mm", "height_mm")
"""Emitter numbers that a part may supply."""


def number(sensor: "Sensor", key: str) -> float:
    """Return a number of the design; raise `SpecError` if it is not a real number specified in the design."""
    value = value_at(sensor.design, key)
    table, _, name = key.partition(".")
    if table == "emitter" and name in OF_THE_LIGHT:
        value = getattr(sensor.light, name)
    if value is None and key == "body.arm_angle_deg":
        value = arm_angle_deg(sensor.design)
    if key == "material.absorption_per_mm" or (key == "material.index" and value is None):
        value = getattr(sensor.material, name)  # the design's stated absorption, otherwise the resin's
    if isinstance(value, bool | int) or not isinstance(value, float):
        raise SpecError(
            key, value=value, limit="must be a real number specified in the design", remedy="set it in the design"
        )
    return value


def tolerance_of(sensor: "Sensor", key: str) -> tuple[float, bool]:
    """Return the tolerance of a number, and whether it is a standard uncertainty; default: one per cent."""
    stated = sensor.design.tolerance.of(key)
    u = {
        "material.index": sensor.material.u_index,
        "material.absorption_per_mm": sensor.material.u_absorption_per_mm,
    }.get(key)
    if stated is None and u:
        return u, True
    usual = USUAL.get(key) or (PLACED_MM if "[" in key and key.endswith("_mm") else 0.0)
    if key.startswith("network."):
        usual = DRAWN_DEG if key.endswith("_deg") else DRAWN_MM if "_mm" in key else 0.0
    if key == "mechanics.modulus_MPa":
        usual = MODULUS_SHARE * number(sensor, key)
    return stated or usual or 0.01 * abs(number(sensor, key)) or 0.01, False


def inert(sensor: "Sensor", key: str) -> str:
    """Return why a number of the design has no independent effect on the light; empty if it has one."""
    design = sensor.design
    resin = design.material.resin is not None
    flat, in_plane = design.trace.dimension == "2d", "has no effect in the plane"
    if sensor.is_measured and key.startswith("lens."):
        return "the lens is measured"
    if sensor.is_network:
        if why := _without_effect_on(design, key):
            return why
    elif sensor.is_drawn and key.startswith(("lens.", "body.", "emitter.distance_mm")) and key != "body.thickness_mm":
        return "the body is drawn"
    cases = {
        "lens.layer_mm": (True, LAYERS),
        "lens.y_focus_mm": (
            not isinstance(design.lens.y_focus_mm, float),
            "the design specifies no value: set one"
            if design.lens.shape == "line-focus"
            else "applies to line-focus only",
        ),
        "emitter.y_mm": (flat, in_plane),
        "emitter.wavelength_nm": (
            bool(design.emitter.spectrum) or (not resin and not sensor.scene().wavelengths_nm),
            "emitter.spectrum states the wavelengths"
            if design.emitter.spectrum
            else "the index is specified, independent of the wavelength",
        ),
        "emitter.width_mm": (sensor.light.width_mm == 0.0, "the emitter is a point"),
        "emitter.height_mm": (flat or sensor.light.height_mm == 0.0, in_plane if flat else "the emitter is a line"),
        "body.thickness_mm": (flat and not sensor.is_loaded, in_plane),  # a force is distributed over it
        "material.index": (
            resin or _is_matched(sensor),
            "follows from the resin and the wavelength" if resin else MATCHED,
        ),
        "material.absorption_per_mm": (resin and not design.material.states_absorption, "follows from the resin"),
        "lens.focus_mm": (not sensor.has_lens, "the design has no lens"),
        "lens.design_index": (
            not sensor.has_lens or design.lens.design_index is None,
            "follows from the material's index" if sensor.has_lens else "the design has no lens",
        ),
        "receivers.gap_mm": (design.receivers.gap_mm is None, "the design has no air gap"),
    }
    applies, why = cases.get(key, (False, ""))
    return why if applies else ""


def _without_effect_on(design: Design, key: str) -> str:
    """Return why a number has no effect on a network: another kind of body has it, or all parts specify it."""
    table, _, name = key.partition(".")
    if table == "body" and name != "thickness_mm":
        return "the body is a network"
    if design.body.file is not None and (table == "lens" or key == "emitter.distance_mm"):
        return "the network is drawn"
    parts = {"lens": design.network.lenses, "emitter": design.network.emitters}.get(table, ())
    if table == "lens" and not parts:
        return "the network has no lens"
    own = bool(parts) and all(getattr(part, name, None) is not None for part in parts)
    return f"every {table} of the network specifies its own value" if own else ""


def _is_matched(sensor: "Sensor") -> bool:
    """Return whether a medium of the body's own index touches a bare wall; behind a film the dependence is smooth."""
    bare = [wall for wall in sensor.design.wall if wall.gap_um is None and not wall.coating]
    return any(wall.index == sensor.material.index for wall in bare)


def usual_keys(sensor: "Sensor") -> tuple[str, ...]:
    """Return the numbers on which a sensor's light depends, inert ones included."""
    if sensor.is_network:
        return (*OPTICAL_KEYS, *_of_network(sensor.design.network))
    knots = (f"lens.knots_um[{place}]" for place in range(len(sensor.design.lens.knots_um or ())))
    in_space = OF_A_LENS_IN_SPACE if sensor.is_sampled else ()
    return (*OPTICAL_KEYS, *in_space, *knots, *(_of_loads(sensor) if sensor.is_loaded else ()))


def _of_network(network: Network) -> Iterator[str]:
    """Yield widths, lengths and directions of guides, and the numbers that lenses and emitters specify themselves."""
    for number, guide in enumerate(network.guides):
        key = f"network.guides[{number}]"
        yield f"{key}.width_mm" if isinstance(guide.width_mm, float) else f"{key}.width_mm[0]"
        yield from (f"{key}.{name}" for name in ("length_mm", "direction_deg") if getattr(guide, name) is not None)
    for table in ("lenses", "emitters"):
        for number, one in enumerate(getattr(network, table)):
            stated = {name: value for name, value in one if isinstance(value, float)}
            yield from (f"network.{table}[{number}].{name}" for name in stated)


def _of_loads(sensor: "Sensor") -> Iterator[str]:
    """Yield the specified positions of holds and fingers of a soft body, and its modulus."""
    for table in ("hold", "press", "pull"):
        for number, row in enumerate(getattr(sensor.design, table)):
            stated = [key for key in ("from_mm", "to_mm", "at_mm", "radius_mm") if getattr(row, key, None)]
            yield from (f"{table}[{number}].{key}" for key in stated)
    if sensor.design.mechanics.modulus_MPa is not None:
        yield "mechanics.modulus_MPa"
