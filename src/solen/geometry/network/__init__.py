"""A body that is a network of guides: nodes, guides between them, and what stands on their ends and sides."""

from collections.abc import Mapping
from dataclasses import replace

from solen.errors import DesignError
from solen.geometry.body import Body
from solen.geometry.network.outline import Walk, check_places, outlines
from solen.geometry.network.plan import Plan, at_rest, plan_of
from solen.geometry.walls import behind_gap, with_walls
from solen.lens import Lens
from solen.plane import Point
from solen.spec import Design
from solen.spec.placed import lit

__all__ = ["Plan", "at_rest", "network_body", "network_lenses", "plan_of"]


def network_body(design: Design, angle_deg: float = 0.0, lenses: Mapping[str, Lens] | None = None) -> Body:
    """Checked body of a network with its motions at their angles, before the emitter that lights.

    It has ``lenses`` by name in place of those cut for the design, where they are stated.

    Raises
    ------
    DesignError
        If parts do not fit or cross, a motion would tear them, or an angle is asked of them all.
    """
    if angle_deg != 0.0:
        limit = "a network has motions by name, and no single angle"
        raise DesignError("angle_deg", value=angle_deg, limit=limit, remedy="set network.motion[0].at_deg")
    design = lit(design)
    plan = plan_of(design)
    walk = Walk.of(plan if lenses is None else replace(plan, lenses=dict(lenses)))
    check_places(walk)
    bare = [behind_gap(outline, design.receivers.gap_mm) for outline in outlines(walk)]
    first, *others = with_walls([faces for faces, _ in bare], design.wall)
    apart = tuple(face for _, faces in bare for face in faces)
    placed = next(one for one in design.network.emitters if one.name == design.network.lit)
    emitter = walk.emitter(placed, design.emitter.distance_mm, design.emitter.offset_mm)
    marks: dict[str, Point] = dict(walk.plan.places)
    return Body(first, emitter, marks, tuple(others), apart).check()


def network_lenses(design: Design) -> dict[str, Lens]:
    """Lenses of a network by name."""
    return at_rest(design).lenses
