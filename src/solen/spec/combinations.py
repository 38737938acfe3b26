"""Checks of keys in different tables of a design: which keys require or exclude one another."""

from typing import TYPE_CHECKING

from solen.spec.body import UNUSED_KEYS, Keys, unused_keys
from solen.spec.network import REMEDY_OF_POSITION, SHAPES
from solen.spec.soft import check_loads
from solen.spec.strict import refused

if TYPE_CHECKING:  # the design calls this module
    from solen.spec.design import Design
    from solen.spec.strict import Strict

KEYS_OF_MOTIONS: dict[str, Keys] = {
    "rotation": {"motion": ("pivot", "join")},
    "bend": {"motion": ("centre_line", "bend_mm")},
    "loaded": {"motion": ("drives", "depths_mm", "forces_N", "emitter_on")},
}
"""Keys that only this kind of motion uses."""


def check_combinations(design: "Design") -> None:
    """Raise an error if keys of different tables contradict one another."""
    outline, bends = design.body.kind == "outline", design.motion.kind == "bend"
    _refuse_keys(design, unused_keys(design.body.kind), f'body.kind = "{design.body.kind}"')
    for kind, keys in KEYS_OF_MOTIONS.items():
        if kind != design.motion.kind:
            _refuse_keys(design, keys, f'motion.kind = "{design.motion.kind}"')
    check_loads(design)
    _check_network(design)
    if outline and design.body.file is None:
        raise refused(
            "body.file", 'is missing: required with kind = "outline"', remedy='add, for example, file = "sensor.dxf"'
        )
    if design.fabricate.pockets and design.receivers.coupling == "air-gap":
        limit = 'does not apply with receivers.coupling = "air-gap": a pocket holds the receiver against the body'
        raise refused("fabricate.pockets", limit, value=True, remedy='omit pockets, or set coupling = "matched"')
    if design.trace.dimension == "extruded" and design.emitter.is_fan:
        limit = 'requires light out of the plane, but emitter.pattern = "fan" emits in the plane only'
        raise refused("trace.dimension", limit, value="extruded", remedy='set emitter.pattern = "lambertian"')
    if design.lens.in_space and design.trace.dimension != "extruded":
        limit = f'must be "extruded" with lens.shape = "{design.lens.shape}": in the plane, this lens is the oval'
        remedy = 'set trace.dimension = "extruded" or lens.shape = "cartesian-oval"'
        raise refused("trace.dimension", limit, value=design.trace.dimension, remedy=remedy)
    if bends or design.motion.kind == "loaded":
        _check_carried(design)
    if bends:
        _check_bend(design)
    elif design.motion.kind == "rotation" and design.body.kind == "y":
        _check_moves(design)


def _refuse_keys(design: "Design", keys: Keys, because: str) -> None:
    for table, names in keys.items():
        part: Strict = getattr(design, table)
        for name in names:
            value = getattr(part, name)
            if value != type(part).model_fields[name].default:
                raise refused(
                    f"{table}.{name}", f"does not apply with {because}", value=value, remedy=f"omit {table}.{name}"
                )


def _check_network(design: "Design") -> None:
    """Check that a network has guides, emitters and receivers, and that no other body has network tables."""
    network, drawn = design.network, design.body.file is not None
    if design.body.kind != "network":
        used = next((key for key in type(network).model_fields if getattr(network, key)), None)
        if used is not None:
            limit = f'does not apply with body.kind = "{design.body.kind}"'
            raise refused(f"network.{used}", limit, remedy='set body.kind = "network"')
        return
    for key in ("emitters", "receivers") if drawn else ("guides", "emitters", "receivers"):
        if not getattr(network, key):
            limit = 'is missing: required with body.kind = "network"'
            raise refused(f"network.{key}", limit, remedy=f"add [[network.{key}]]")
    if design.lens.shape not in SHAPES:
        limit = f"must be {', '.join(SHAPES[:-1])} or {SHAPES[-1]} in a network"
        raise refused("lens.shape", limit, value=design.lens.shape, remedy=f'set lens.shape = "{SHAPES[0]}"')
    _check_drawn(design) if drawn else _check_positions(design)


DRAWN_TABLES = ("nodes", "guides", "fixed")
"""Network keys that the drawing replaces."""
DRAWN_KEYS = ("node", "guide", "side", "at_mm", "from_mm", "to_mm", "distance_mm", *UNUSED_KEYS["outline"]["lens"])
"""Keys that define the position or shape of a part; in a drawn network, the drawing defines them."""


def _check_positions(design: "Design") -> None:
    """Reject a part without a position, and reject keys that apply only to a drawing."""
    for key in ("units", "join_mm"):
        if getattr(design.body, key) is not None:
            raise refused(f"body.{key}", "does not apply without body.file", value=getattr(design.body, key))
    for key in ("lenses", "emitters", "receivers"):
        for number, part in enumerate(getattr(design.network, key)):
            if part.node is None and part.guide is None and getattr(part, "lens", None) is None:
                limit = "is missing: a part is placed at a node or on a side of a guide"
                raise refused(f"network.{key}[{number}].node", limit, remedy=REMEDY_OF_POSITION)


def _check_drawn(design: "Design") -> None:
    """Reject keys that the drawing defines, a lens without an emitter, and motions that would tear the drawn body."""
    network = design.network
    for key in DRAWN_TABLES:
        if getattr(network, key):
            limit = "does not apply with body.file: the drawing defines the network"
            raise refused(f"network.{key}", limit, remedy=f"omit network.{key}")
    outline = UNUSED_KEYS["outline"]
    _refuse_keys(design, {table: outline[table] for table in ("lens", "emitter")}, "body.file")
    for key in ("lenses", "emitters", "receivers"):
        for number, part in enumerate(getattr(network, key)):
            for name in DRAWN_KEYS:
                if getattr(part, name, None) is not None:
                    limit = "does not apply with body.file: the drawing defines the part"
                    what = f"network.{key}[{number}].{name}"
                    raise refused(what, limit, value=getattr(part, name), remedy=f"omit {name}")
    lit = {emitter.lens for emitter in network.emitters}
    for number, lens in enumerate(network.lenses):
        if lens.name not in lit:
            limit, remedy = "is not illuminated by any emitter", f'add lens = "{lens.name}" to an emitter'
            raise refused(f"network.lenses[{number}].name", limit, value=lens.name, remedy=remedy)
    emitters = [emitter.name for emitter in network.emitters]
    for number, motion in enumerate(network.motion):
        if motion.kind == "bend" or motion.part not in emitters:
            limit = "must be an emitter: any other motion would tear a drawn network"
            raise refused(f"network.motion[{number}].part", limit, value=motion.part)


def _check_carried(design: "Design") -> None:
    """Reject `motion.moves` for a bend or a load, which moves the whole body."""
    motion = design.motion
    if motion.moves != (("emitter",) if design.body.lens_is_drawn else ("lens", "emitter")):
        limit = f'does not apply with motion.kind = "{motion.kind}": the lens and the emitter always move with the body'
        raise refused("motion.moves", limit, value=list(motion.moves), remedy="omit motion.moves")


def _check_bend(design: "Design") -> None:
    """Reject a bend of a drawn outline if ``motion.bend_mm`` is missing or not in ascending order."""
    motion = design.motion
    if not design.body.lens_is_drawn:
        return
    if motion.bend_mm is None:
        remedy = "add bend_mm = [z_from_mm, z_to_mm], the values of z between which the outline bends"
        raise refused("motion.bend_mm", "is missing: required for the bend of an outline", remedy=remedy)
    if not motion.bend_mm[0] < motion.bend_mm[1]:
        raise refused("motion.bend_mm", "must be in ascending order", value=list(motion.bend_mm))


def _check_moves(design: "Design") -> None:
    """Reject moving parts that the body does not have or that cannot rotate."""
    moves = design.motion.moves
    if "mirrors" in moves:
        raise refused("motion.moves", "cannot include mirrors: a Y has none", value=list(moves), remedy="omit them")
    if "lens" not in moves and design.motion.join != "bridge":
        limit = "does not apply unless the lens turns"
        raise refused("motion.join", limit, value=design.motion.join, remedy="omit motion.join")
    if "receivers" in moves and design.receivers.coupling != "air-gap":
        limit = "cannot include receivers that are attached to the arms"
        raise refused("motion.moves", limit, value=list(moves), remedy='set receivers.coupling = "air-gap"')
