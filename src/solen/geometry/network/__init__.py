"""A network of guides: nodes, guides between them, and parts on the ends and sides of guides."""

from collections.abc import Mapping
from dataclasses import replace

from solen.errors import DesignError
from solen.geometry.body import Body
from solen.geometry.network.drawn import DrawnLens, drawn_lenses, drawn_network
from solen.geometry.network.outline import Walk, check_part_nodes, outlines
from solen.geometry.network.plan import Plan, at_rest, plan_of
from solen.geometry.walls import behind_gap, with_walls
from solen.lens import Lens
from solen.plane import Point
from solen.spec import Design
from solen.spec.placed import emitter_table, lit

__all__ = ["DrawnLens", "Plan", "at_rest", "drawn_lenses", "network_body", "network_lenses", "plan_of"]


def network_body(design: Design, angle_deg: float = 0.0, lenses: Mapping[str, Lens] | None = None) -> Body:
    """Return the checked body of a network with its motions at their angles and its active emitter.

    ``lenses``, keyed by name, replace those computed for the design.

    Raises
    ------
    DesignError
        If parts do not fit or intersect, a motion would tear the body, or an angle other than 0 is specified.
    """
    if angle_deg != 0.0:
        limit = "a network has several named motions instead of a single angle"
        raise DesignError("angle_deg", value=angle_deg, limit=limit, remedy="set network.motion[0].at_deg")
    design = lit(design)
    if design.outline_file is not None:
        return drawn_network(design).check()
    plan = plan_of(design)
    walk = Walk.of(plan if lenses is None else replace(plan, lenses=dict(lenses)))
    check_part_nodes(walk)
    split = [behind_gap(outline, design.receivers.gap_mm) for outline in outlines(walk)]
    first, *others = with_walls([faces for faces, _ in split], design.wall)
    separate = tuple(face for _, faces in split for face in faces)
    tables = [(emitter, emitter_table(design, emitter)) for emitter in design.network.emitters]
    poses = {emitter.name: walk.emitter(emitter, table.distance_mm, table.offset_mm) for emitter, table in tables}
    emitters = tuple((emitter.name, replace(poses[emitter.name], width_mm=table.width_mm)) for emitter, table in tables)
    marks: dict[str, Point] = dict(walk.plan.positions)
    return Body(first, poses[design.network.lit or ""], marks, tuple(others), separate, emitters=emitters).check()


def network_lenses(design: Design) -> dict[str, Lens]:
    """Return the lenses computed for the design of a network, keyed by name; empty if the network is drawn."""
    return {} if design.outline_file is not None else at_rest(design).lenses
