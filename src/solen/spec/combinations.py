"""Checks of key combinations across the tables of a design: which keys require or exclude one another."""

from typing import TYPE_CHECKING

from solen.spec.body import UNUSED_KEYS, Keys, unused_keys
from solen.spec.network import REMEDY_OF_PLACE, SHAPES
from solen.spec.soft import check_loads
from solen.spec.strict import refused

if TYPE_CHECKING:  # the design calls this module
    from solen.spec.design import Design
    from solen.spec.strict import Strict

OF_MOTIONS: dict[str, Keys] = {
    "rotation": {"motion": ("pivot", "join")},
    "bend": {"motion": ("centre_line", "bend_mm")},
    "loaded": {"motion": ("drives", "depths_mm", "forces_N", "emitter_on")},
}
"""Keys that only one kind of motion uses."""


def check_combinations(design: "Design") -> None:
    """Raise an error if keys of different tables contradict one another."""
    outline, bends = design.body.kind == "outline", design.motion.kind == "bend"
    _refuse_stated(design, unused_keys(design.body.kind), f'body.kind = "{design.body.kind}"')
    for kind, keys in OF_MOTIONS.items():
        if kind != design.motion.kind:
            _refuse_stated(design, keys, f'motion.kind = "{design.motion.kind}"')
    check_loads(design)
    _check_network(design)
    if outline and design.body.file is None:
        raise refused("body.file", 'missing: kind = "outline" needs it', remedy='add file = "sensor.dxf"')
    if design.fabricate.pockets and design.receivers.coupling == "air-gap":
        limit = 'does not apply with receivers.coupling = "air-gap": a pocket seats a receiver on the body'
        raise refused("fabricate.pockets", limit, value=True, remedy="leave one of them out")
    if design.trace.dimension == "extruded" and design.emitter.is_fan:
        limit = 'needs light out of the plane, but emitter.pattern = "fan" emits in the plane only'
        raise refused("trace.dimension", limit, value="extruded", remedy='set emitter.pattern = "lambertian"')
    if design.lens.in_space and design.trace.dimension != "extruded":
        limit = 'needs dimension = "extruded": in the plane this lens is the Cartesian oval'
        raise refused(
            "trace.dimension", limit, value=design.trace.dimension, remedy='set it, or shape = "cartesian-oval"'
        )
    if bends or design.motion.kind == "loaded":
        _check_carried(design)
    if bends:
        _check_bend(design)
    elif design.motion.kind == "rotation" and design.body.kind == "y":
        _check_moves(design)


def _refuse_stated(design: "Design", keys: Keys, because: str) -> None:
    for table, names in keys.items():
        part: Strict = getattr(design, table)
        for name in names:
            value = getattr(part, name)
            if value != type(part).model_fields[name].default:
                raise refused(f"{table}.{name}", f"does not apply with {because}", value=value, remedy="leave it out")


def _check_network(design: "Design") -> None:
    """Check that only a network has network tables, and that it has guides, emitters and receivers."""
    network, has = design.network, design.body.kind == "network"
    drawn = design.body.file is not None
    for key in ("emitters", "receivers") if drawn else ("guides", "emitters", "receivers"):
        if has and not getattr(network, key):
            raise refused(f"network.{key}", 'missing: body.kind = "network" needs it', remedy=f"add [[network.{key}]]")
    if has and design.lens.shape not in SHAPES:
        limit = "must be an analytic cylindrical shape for a lens of a network"
        raise refused("lens.shape", limit, value=design.lens.shape, remedy=f"set one of {', '.join(SHAPES)}")
    if has:
        _check_drawn(design) if drawn else _check_places(design)
    stated = next((key for key in type(network).model_fields if getattr(network, key)), None)
    if stated is not None and not has:
        limit = f'does not apply with body.kind = "{design.body.kind}"'
        raise refused(f"network.{stated}", limit, remedy='set body.kind = "network"')


OF_A_DRAWING = ("nodes", "guides", "fixed")
"""Network keys that the drawing replaces."""
WHERE = ("node", "guide", "side", "at_mm", "from_mm", "to_mm", "distance_mm", *UNUSED_KEYS["outline"]["lens"])
"""Keys that place or shape a part of a network; if the network is drawn, the drawing defines them."""


def _check_places(design: "Design") -> None:
    """Reject a part without a position, and reject keys that apply only to a drawing."""
    for key in ("units", "join_mm"):
        if getattr(design.body, key) is not None:
            raise refused(f"body.{key}", "does not apply without body.file", value=getattr(design.body, key))
    for key in ("lenses", "emitters", "receivers"):
        for number, one in enumerate(getattr(design.network, key)):
            if one.node is None and one.guide is None and getattr(one, "lens", None) is None:
                limit = "must be a node or a guide's side"
                raise refused(f"network.{key}[{number}].node", limit, value=None, remedy=REMEDY_OF_PLACE)


def _check_drawn(design: "Design") -> None:
    """Reject keys that the drawing defines, a lens without an emitter, and motions that would tear the drawn body."""
    network, because = design.network, "with body.file"
    for key in OF_A_DRAWING:
        if getattr(network, key):
            raise refused(f"network.{key}", f"does not apply {because}: the network is drawn", remedy="leave it out")
    outline = UNUSED_KEYS["outline"]
    _refuse_stated(design, {table: outline[table] for table in ("lens", "emitter")}, "body.file")
    for key in ("lenses", "emitters", "receivers"):
        for number, one in enumerate(getattr(network, key)):
            for name in WHERE:
                if getattr(one, name, None) is not None:
                    limit = f"does not apply {because}: the part is drawn"
                    what = f"network.{key}[{number}].{name}"
                    raise refused(what, limit, value=getattr(one, name), remedy="leave it out")
    lit = {emitter.lens for emitter in network.emitters}
    for number, lens in enumerate(network.lenses):
        if lens.name not in lit:
            remedy = f'add lens = "{lens.name}" to the emitter in front of it'
            raise refused(f"network.lenses[{number}].name", "no emitter illuminates it", value=lens.name, remedy=remedy)
    emitters = [emitter.name for emitter in network.emitters]
    for number, motion in enumerate(network.motion):
        if motion.kind == "bend" or motion.part not in emitters:
            limit = "would tear the drawn body: only an emitter can turn in a drawn network"
            raise refused(f"network.motion[{number}].part", limit, value=motion.part)


def _check_carried(design: "Design") -> None:
    """Reject `motion.moves` for a bend or a load, which move the whole body."""
    motion = design.motion
    if motion.moves != (("emitter",) if design.body.lens_is_drawn else ("lens", "emitter")):
        limit = f'does not apply with motion.kind = "{motion.kind}": lens and emitter are carried along'
        raise refused("motion.moves", limit, value=list(motion.moves), remedy="leave it out")


def _check_bend(design: "Design") -> None:
    """Reject a bend of an outline whose design does not specify the range that bends."""
    motion = design.motion
    if not design.body.lens_is_drawn:
        return
    if motion.bend_mm is None:
        remedy = "add bend_mm = [z_from_mm, z_to_mm], the heights between which the outline bends"
        raise refused("motion.bend_mm", "missing: the bend of an outline needs it", remedy=remedy)
    if not motion.bend_mm[0] < motion.bend_mm[1]:
        raise refused("motion.bend_mm", "must run from low to high", value=list(motion.bend_mm))


def _check_moves(design: "Design") -> None:
    """Reject moving parts that the body does not have or that cannot rotate."""
    moves = design.motion.moves
    if "mirrors" in moves:
        raise refused("motion.moves", "a Y has no mirrors", value=list(moves), remedy="leave them out")
    if "lens" not in moves and design.motion.join != "bridge":
        limit = "does not apply unless the lens turns"
        raise refused("motion.join", limit, value=design.motion.join, remedy="leave it out")
    if "receivers" in moves and design.receivers.coupling != "air-gap":
        limit = "receivers on the arm ends cannot turn without the arms"
        raise refused("motion.moves", limit, value=list(moves), remedy='set receivers.coupling = "air-gap"')
