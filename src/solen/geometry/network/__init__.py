"""A network of guides: nodes, guides between them, and the parts on guide ends and sides."""

from collections.abc import Mapping
from dataclasses import replace

from solen.errors import DesignError
from solen.geometry.body import Body
from solen.geometry.network.drawn import DrawnLens, drawn_lenses, drawn_network
from solen.geometry.network.outline import Walk, check_places, outlines
from solen.geometry.network.plan import Plan, at_rest, plan_of
from solen.geometry.walls import behind_gap, with_walls
from solen.lens import Lens
from solen.plane import Point
from solen.spec import Design
from solen.spec.placed import emitter_table, lit

__all__ = ["DrawnLens", "Plan", "at_rest", "drawn_lenses", "network_body", "network_lenses", "plan_of"]


def network_body(design: Design, angle_deg: float = 0.0, lenses: Mapping[str, Lens] | None = None) -> Body:
    """Return the checked body of a network with its motions at their angles and its active emitter.

    ``lenses`` by name, if specified, replace those computed for the design.

    Raises
    ------
    DesignError
        If parts do not fit or intersect, a motion would tear them, or a single angle is specified.
    """
    if angle_deg != 0.0:
        limit = "a network has several named motions instead of a single angle"
        raise DesignError("angle_deg", value=angle_deg, limit=limit, remedy="set network.motion[0].at_deg")
    design = lit(design)
    if design.outline_file is not None:
        return drawn_network(design).check()
    plan = plan_of(design)
    walk = Walk.of(plan if lenses is None else replace(plan, lenses=dict(lenses)))
    check_places(walk)
    bare = [behind_gap(outline, design.receivers.gap_mm) for outline in outlines(walk)]
    first, *others = with_walls([faces for faces, _ in bare], design.wall)
    apart = tuple(face for _, faces in bare for face in faces)
    tables = [(emitter, emitter_table(design, emitter)) for emitter in design.network.emitters]
    poses = {one.name: walk.emitter(one, own.distance_mm, own.offset_mm) for one, own in tables}
    lamps = tuple((one.name, replace(poses[one.name], width_mm=own.width_mm)) for one, own in tables)
    emitter = poses[design.network.lit or ""]
    marks: dict[str, Point] = dict(walk.plan.places)
    return Body(first, emitter, marks, tuple(others), apart, lamps=lamps).check()


def network_lenses(design: Design) -> dict[str, Lens]:
    """Return the lenses of a network, by name, that are computed for its design; empty if the network is drawn."""
    return {} if design.outline_file is not None else at_rest(design).lenses
