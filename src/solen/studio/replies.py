"""Requests from a page, and the frames in reply; the stages compute their content."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

from pydantic import Field

from solen.errors import SolenError
from solen.explore.live import Curve, coarse, planar_model_error, refined
from solen.explore.optimise import straightness_options
from solen.explore.tolerance_effects import ToleranceEffect, combined_change, tolerance_effects
from solen.results import plain
from solen.sensor import Sensor, as_built, in_plane, picture
from solen.sensor.network.response import network_response
from solen.sensor.picture import DEFAULT_RAYS, MAX_RAYS
from solen.spec import json_schema
from solen.spec.placed import lit
from solen.spec.strict import Number, Strict
from solen.spec.toml import DEFERRED
from solen.studio.commands import same_as
from solen.studio.document import Document, State
from solen.studio.frames import encoded
from solen.studio.search import SearchRequest

ROW = ("key", "tolerance", "largest", "u_largest", "at_deg")
"""Fields that a page shows for each parameter in the list of tolerances."""
COMPARISON_RAYS = 2**14
"""Number of rays per angle for the curves with which the design is compared."""


class View(Strict):
    """View settings for a design on the page."""

    angle_deg: Number = Field(0.0, description="Angle, or value of whatever else the motion drives.")
    rays: int = Field(DEFAULT_RAYS, ge=1, le=MAX_RAYS, description="Rays drawn.")
    split: bool = Field(False, description="Whether rays are split at faces; otherwise, rays stay whole.")
    light: Literal["design", "plane", "space"] = Field(
        "design", description="Whether the response is traced in the plane or in space."
    )
    tolerances: bool = Field(
        False, description="Whether the effect of each tolerance is computed when the page is idle."
    )
    lens: Literal["own", "designed", "flat"] = Field(
        "own", description="The lens of the design, the designed lens instead of a measured one, or a flat face."
    )
    lit: str | None = Field(None, max_length=200, description="Emitter of a network that is lit; default: network.lit.")


class PageRequest(Strict):
    """A request from a page: a change of view or design, or an action such as undo or save."""

    id: int = Field(0, ge=0, lt=2**53, description="Number of the request, which the reply repeats.")
    view: View | None = Field(None, description="New view of the design.")
    values: dict[str, Any] = Field(default_factory=dict, max_length=64, description="Values, keyed by dotted key.")
    handle: str | None = Field(None, max_length=200, description="Handle that is dragged.")
    to: tuple[Number, Number] | None = Field(None, description="Position to which the handle is dragged.")
    gesture: str = Field(
        "", max_length=60, description="Name of the gesture; changes of one gesture are undone together."
    )
    do: Literal["undo", "redo", "save", "reload", "suggest", "restore", "leave", "pin"] | None = Field(
        None, description="An order."
    )
    search: SearchRequest | None = Field(None, description="A background search to start.")
    take: int | None = Field(
        None, ge=1, description="Number of the design on the front of the search that is to be opened."
    )


def hello_frame(document: Document) -> bytes:
    """Return the first frame of a page."""
    motion = document.state.design.motion
    head = {"kind": "hello", "file": document.path.name, "is_new": document.is_new, "schema": json_schema()}
    return encoded(head | {"unit": motion.unit})


def suggestion_frame(state: State) -> bytes:
    """Return the frame that suggests a search for a more linear response, as a search request."""
    options = straightness_options(state.design)
    request = SearchRequest(**{name: getattr(options, name) for name in ("minimise", "maximise", "free", "subject_to")})
    return encoded({"kind": "suggested", "sought": request.model_dump()})


def in_space(sensor: Sensor) -> bool:
    """Return whether rays are traced in space."""
    return sensor.design.trace.dimension == "extruded"


def lit_sensor(state: State, view: View) -> Sensor:
    """Return the sensor of the design; for a network, with the emitter selected on the page, if it still exists."""
    names = [emitter.name for emitter in state.design.network.emitters]
    return state.sensor if view.lit not in names else Sensor.of(lit(state.design, view.lit))


def shown_sensor(state: State, view: View) -> Sensor:
    """Return the sensor whose response is shown on a page."""
    sensor = lit_sensor(state, view)
    if view.lens == "designed" and sensor.is_measured:
        sensor = sensor.as_designed
    elif view.lens == "flat" and sensor.has_lens and not sensor.is_drawn:
        sensor = sensor.without_lens
    if view.light == "plane":
        return in_plane(sensor)
    return as_built(sensor) if view.light == "space" and sensor.design.trace.dimension == "2d" else sensor


def nearest_value(state: State, angle_deg: float) -> float:
    """Return the nearest value within the range of the motion; 0 for a network, which has several motions."""
    if state.sensor.is_network:
        return 0.0
    values = state.design.motion.values()
    return min(max(angle_deg, values[0]), values[-1])


def picture_frame(
    document: Document, state: State, view: View, request_id: int, *, all_values: bool, curve: bool
) -> bytes:
    """Return the frame of the drawing, with an approximate response if ``curve``, and all values if ``all_values``."""
    sensor = shown_sensor(state, view)
    values = state.design.motion.values()
    image = picture(sensor, nearest_value(state, view.angle_deg), view.rays, split=view.split)
    head: dict[str, Any] = {
        "kind": "drawn",
        "id": request_id,
        "angle_deg": image.angle_deg,
        "angles_deg": [values[0], values[-1]],
        "faces": image.faces,
        "ends": image.ends,
        "handles": image.handles,
    }
    if all_values:
        head |= _full_state(document, state)
    arrays = {"outline": image.outline, "emitter": image.emitter, "rays": image.rays}
    if document.comparison is not None:
        curve_head, columns = _comparison_picture(document.comparison, view)
        head, arrays = head | curve_head, arrays | columns
    if curve:
        curve_head, columns = _rough_response(sensor)
        head, arrays = head | curve_head, arrays | columns
    return encoded(head, arrays)


def _comparison_picture(state: State, view: View) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the drawing of the compared design, which is empty if the design cannot be built."""
    try:
        image = picture(shown_sensor(state, view), nearest_value(state, view.angle_deg), view.rays, split=view.split)
    except SolenError:
        return {}, {}
    head = {"name": state.design.name, "faces": image.faces, "ends": image.ends, "handles": {}}
    arrays = {"beside_outline": image.outline, "beside_emitter": image.emitter, "beside_rays": image.rays}
    return {"beside": head}, arrays


def _rough_response(sensor: Sensor) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return an approximate response, or the reason why none is available."""
    try:
        rough = coarse(sensor)
    except SolenError as bad:
        return {"no_curve": str(bad)}, {}
    if rough is None:
        return {"no_curve": ""}, {}
    curve_head, columns = _curve("own", rough)
    return {"curve": curve_head}, columns


def _full_state(document: Document, state: State) -> dict[str, Any]:
    return {
        "version": document.version,
        "values": state.design.model_dump(),
        "effective": effective(state.sensor),
        "changed": sorted(state.changes),
        "is_beside": document.comparison is not None,
        "can_undo": document.position > 0,
        "can_redo": document.position < len(document.states) - 1,
        "is_saved": document.is_saved,
        "same": same_as(document.path, {} if document.is_saved else state.changes),
        "warnings": [*filter(None, [document.unsaved_error]), *state.sensor.warnings],
        "offered": "" if document.earlier_changes is None else document.earlier_changes.name,
        "has_lens": state.sensor.has_lens and not state.sensor.is_drawn,
        "is_measured": state.sensor.is_measured,
        "in_space": in_space(state.sensor),
        "emitters": [emitter.name for emitter in state.design.network.emitters],
        "lit": state.sensor.design.network.lit,
        "motions": [
            {"name": motion.name, "at_deg": motion.at_deg, "range_deg": [motion.from_deg, motion.to_deg]}
            for motion in state.design.network.motion
        ],
    }


def effective(sensor: Sensor) -> dict[str, Any]:
    """Return the values that a part, a spectrum or a resin supplies for the design, keyed by dotted key."""
    design = sensor.design
    values = {
        f"emitter.{key}": getattr(sensor.light, key)
        for key in DEFERRED
        if not design.emitter.sets(key) and getattr(sensor.light, key) != getattr(design.emitter, key)
    }
    if design.material.resin is not None:
        values["material.index"] = sensor.material.index
        if not design.material.sets_absorption:
            values["material.absorption_per_mm"] = sensor.material.absorption_per_mm
    return values


def refined_frames(
    state: State, version: int, view: View, stop: Callable[[], bool], comparison: State | None = None
) -> Iterator[bytes]:
    """Yield frames with the refined response and with comparison curves; end early when ``stop`` returns True."""
    sensor = shown_sensor(state, view)
    if sensor.is_network:
        yield encoded({"kind": "powers", "in_space": in_space(sensor), **plain(network_response(sensor.design, [{}]))})
        yield encoded({"kind": "rest", "version": version})
        return
    compared = False
    for curve in refined(sensor, stop):
        yield _frame("own", curve)
        if not compared:
            yield from _comparison_frames(
                sensor, curve, stop, None if comparison is None else shown_sensor(comparison, view)
            )
            compared = True
    if not stop():
        yield encoded({"kind": "rest", "version": version})


def tolerance_frames(state: State, view: View, stop: Callable[[], bool]) -> Iterator[bytes]:
    """Yield frames with the effects of tolerances, largest first, and their combination; each frame adds one effect."""
    effects: list[ToleranceEffect] = []
    for effect in tolerance_effects(shown_sensor(state, view), stop):
        effects = sorted([*effects, effect], key=lambda item: item.largest, reverse=True)
        rows = [{name: getattr(item, name) for name in ROW} for item in effects]
        yield encoded({"kind": "matters", "rows": rows}, {"angle": effect.angle_deg, "band": combined_change(effects)})


def _comparison_frames(
    sensor: Sensor, curve: Curve, stop: Callable[[], bool], pinned: Sensor | None
) -> Iterator[bytes]:
    """Yield frames with the comparison curves, and with the difference between plane and space."""
    flat = sensor.design.trace.dimension == "2d"
    others: dict[str, Callable[[], Sensor]] = {
        "space" if flat else "plane": partial(as_built if flat else in_plane, sensor)
    }
    if sensor.has_lens and not sensor.is_drawn:
        others["flat"] = lambda: sensor.without_lens
    if pinned is not None:
        others["pinned"] = lambda: pinned
    for name, make_sensor in others.items():
        try:
            comparison = None if stop() else coarse(make_sensor(), COMPARISON_RAYS)
        except SolenError:
            continue  # a comparison that cannot be built is omitted
        if comparison is None:
            continue
        yield _frame(name, comparison)
        if name in ("plane", "space"):
            plane, space = (curve, comparison) if flat else (comparison, curve)
            yield encoded({"kind": "words", "misleading": planar_model_error(plane.response, space.response)})


def _frame(name: str, curve: Curve) -> bytes:
    curve_head, columns = _curve(name, curve)
    return encoded({"kind": "curve", "curve": curve_head}, columns)


def _curve(name: str, curve: Curve) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header and the columns for a response."""
    response = curve.response
    head = {
        "name": name,
        "rays": curve.rays,
        "in_space": curve.in_space,
        "finished": curve.finished,
        "merits": plain(curve.merits),
        "ends": [plain(response.contrast[i]) for i in (0, -1)],
        "u_ends": [plain(response.u_contrast[i]) for i in (0, -1)],
    }
    return head, {
        f"{name}_angle": response.angle_deg,
        f"{name}_contrast": response.contrast,
        f"{name}_u": response.u_contrast,
        f"{name}_right": response.right,
        f"{name}_left": response.left,
    }
