"""Page requests and the frames that answer them: this module calls the stages and computes nothing."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

from pydantic import Field

from solen.errors import SolenError
from solen.explore.live import Curve, coarse, misleading, refined
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
"""Fields that a page shows for each parameter in its list of what matters."""
COMPARISON_RAYS = 2**14
"""Number of rays for each angle in curves compared with the design's own."""


class View(Strict):
    """View settings for a design on the page."""

    angle_deg: Number = Field(0.0, description="Angle, or value of whatever else the motion drives.")
    rays: int = Field(DEFAULT_RAYS, ge=1, le=MAX_RAYS, description="Rays drawn.")
    split: bool = Field(False, description="Whether both branches are followed at each face, rather than whole rays.")
    light: Literal["design", "plane", "space"] = Field(
        "design", description="Whether the response is traced in the plane or in space."
    )
    tolerances: bool = Field(
        False, description="Whether the effect of each tolerance is computed when the page is idle."
    )
    lens: Literal["own", "designed", "flat"] = Field(
        "own", description="The design's lens, the designed lens for a measured one, or a flat face."
    )
    lit: str | None = Field(None, max_length=200, description="Emitter of a network that is lit; default: network.lit.")


class PageRequest(Strict):
    """A page request: a change of view or design, or an order."""

    id: int = Field(0, ge=0, lt=2**53, description="Number of the request, which the answer repeats.")
    view: View | None = Field(None, description="New view of the design.")
    values: dict[str, Any] = Field(default_factory=dict, max_length=64, description="Values by dotted key.")
    handle: str | None = Field(None, max_length=200, description="Handle that is dragged.")
    to: tuple[Number, Number] | None = Field(None, description="Where to.")
    gesture: str = Field("", max_length=60, description="Gesture; changes of one gesture are undone together.")
    do: Literal["undo", "redo", "save", "reload", "suggest", "restore", "leave", "pin"] | None = Field(
        None, description="An order."
    )
    search: SearchRequest | None = Field(None, description="A search to start in the background.")
    take: int | None = Field(
        None, ge=1, description="Design on the front of the search that is to become the open one."
    )


def hello_frame(document: Document) -> bytes:
    """Return the first frame of a page."""
    motion = document.state.design.motion
    head = {"kind": "hello", "file": document.path.name, "is_new": document.is_new, "schema": json_schema()}
    return encoded(head | {"unit": motion.unit})


def suggestion_frame(state: State) -> bytes:
    """Return the frame that suggests a search for a more linear response, in the form of a page request."""
    options = straightness_options(state.design)
    sought = SearchRequest(**{name: getattr(options, name) for name in ("minimise", "maximise", "free", "subject_to")})
    return encoded({"kind": "suggested", "sought": sought.model_dump()})


def in_space(sensor: Sensor) -> bool:
    """Return whether rays are traced in space."""
    return sensor.design.trace.dimension == "extruded"


def lit_sensor(state: State, view: View) -> Sensor:
    """Return the design's sensor; for a network, light the emitter chosen on the page if it still exists."""
    names = [emitter.name for emitter in state.design.network.emitters]
    return state.sensor if view.lit not in names else Sensor.of(lit(state.design, view.lit))


def shown_sensor(state: State, view: View) -> Sensor:
    """Return the sensor whose response a page shows."""
    sensor = lit_sensor(state, view)
    if view.lens == "designed" and sensor.is_measured:
        sensor = sensor.as_designed
    elif view.lens == "flat" and sensor.has_lens and not sensor.is_drawn:
        sensor = sensor.without_lens
    if view.light == "plane":
        return in_plane(sensor)
    return as_built(sensor) if view.light == "space" and sensor.design.trace.dimension == "2d" else sensor


def nearest_value(state: State, angle_deg: float) -> float:
    """Return the nearest value within the range of the motion; 0 for a network, whose motions have names."""
    if state.sensor.is_network:
        return 0.0
    values = state.design.motion.values()
    return min(max(angle_deg, values[0]), values[-1])


def picture_frame(document: Document, state: State, view: View, asked: int, *, whole: bool, curve: bool) -> bytes:
    """Return the drawing's frame, with an approximate response if ``curve``, and with all values if ``whole``."""
    sensor = shown_sensor(state, view)
    values = state.design.motion.values()
    image = picture(sensor, nearest_value(state, view.angle_deg), view.rays, split=view.split)
    head: dict[str, Any] = {
        "kind": "drawn",
        "id": asked,
        "angle_deg": image.angle_deg,
        "angles_deg": [values[0], values[-1]],
        "faces": image.faces,
        "ends": image.ends,
        "handles": image.handles,
    }
    if whole:
        head |= _full_state(document, state)
    arrays = {"outline": image.outline, "emitter": image.emitter, "rays": image.rays}
    if document.beside is not None:
        described, columns = _comparison_picture(document.beside, view)
        head, arrays = head | described, arrays | columns
    if curve:
        described, columns = _rough_response(sensor)
        head, arrays = head | described, arrays | columns
    return encoded(head, arrays)


def _comparison_picture(state: State, view: View) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the drawing of the design compared with the open one; return an empty drawing if it cannot be built."""
    try:
        image = picture(shown_sensor(state, view), nearest_value(state, view.angle_deg), view.rays, split=view.split)
    except SolenError:
        return {}, {}
    head = {"name": state.design.name, "faces": image.faces, "ends": image.ends, "handles": {}}
    arrays = {"beside_outline": image.outline, "beside_emitter": image.emitter, "beside_rays": image.rays}
    return {"beside": head}, arrays


def _rough_response(sensor: Sensor) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return an approximate response, or the reason why none is available yet."""
    try:
        rough = coarse(sensor)
    except SolenError as bad:
        return {"no_curve": str(bad)}, {}
    if rough is None:
        return {"no_curve": ""}, {}
    described, columns = _curve("own", rough)
    return {"curve": described}, columns


def _full_state(document: Document, state: State) -> dict[str, Any]:
    return {
        "version": document.version,
        "values": state.design.model_dump(),
        "effective": effective(state.sensor),
        "changed": sorted(state.changes),
        "is_beside": document.beside is not None,
        "can_undo": document.place > 0,
        "can_redo": document.place < len(document.states) - 1,
        "is_saved": document.is_saved,
        "same": same_as(document.path, {} if document.is_saved else state.changes),
        "warnings": [*filter(None, [document.why_not_kept]), *state.sensor.warnings],
        "offered": "" if document.offered is None else document.offered.name,
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
    """Return values that a part, a spectrum or a resin supplies for the design, by dotted key."""
    design = sensor.design
    found = {
        f"emitter.{key}": getattr(sensor.light, key)
        for key in DEFERRED
        if not design.emitter.states(key) and getattr(sensor.light, key) != getattr(design.emitter, key)
    }
    if design.material.resin is not None:
        found["material.index"] = sensor.material.index
        if not design.material.states_absorption:
            found["material.absorption_per_mm"] = sensor.material.absorption_per_mm
    return found


def refined_frames(
    state: State, version: int, view: View, stop: Callable[[], bool], beside: State | None = None
) -> Iterator[bytes]:
    """Yield frames with the response as it is refined, and with the compared curves; end early if ``stop`` is set."""
    sensor = shown_sensor(state, view)
    if sensor.is_network:
        yield encoded({"kind": "powers", "in_space": in_space(sensor), **plain(network_response(sensor.design, [{}]))})
        yield encoded({"kind": "rest", "version": version})
        return
    compared = False
    for own in refined(sensor, stop):
        yield _frame("own", own)
        if not compared:
            yield from _comparison_frames(sensor, own, stop, None if beside is None else shown_sensor(beside, view))
            compared = True
    if not stop():
        yield encoded({"kind": "rest", "version": version})


def tolerance_frames(state: State, view: View, stop: Callable[[], bool]) -> Iterator[bytes]:
    """Yield frames with the parameters that matter, largest first, and all tolerances together, one more each time."""
    found: list[ToleranceEffect] = []
    for effect in tolerance_effects(shown_sensor(state, view), stop):
        found = sorted([*found, effect], key=lambda each: each.largest, reverse=True)
        rows = [{name: getattr(each, name) for name in ROW} for each in found]
        yield encoded({"kind": "matters", "rows": rows}, {"angle": effect.angle_deg, "band": combined_change(found)})


def _comparison_frames(sensor: Sensor, own: Curve, stop: Callable[[], bool], pinned: Sensor | None) -> Iterator[bytes]:
    """Yield frames with the comparison curves and the difference that they show between plane and space."""
    flat = sensor.design.trace.dimension == "2d"
    others: dict[str, Callable[[], Sensor]] = {
        "space" if flat else "plane": partial(as_built if flat else in_plane, sensor)
    }
    if sensor.has_lens and not sensor.is_drawn:
        others["flat"] = lambda: sensor.without_lens
    if pinned is not None:
        others["pinned"] = lambda: pinned
    for name, made in others.items():
        try:
            beside = None if stop() else coarse(made(), COMPARISON_RAYS)
        except SolenError:
            continue  # skip a comparison that cannot be built
        if beside is None:
            continue
        yield _frame(name, beside)
        if name in ("plane", "space"):
            plane, space = (own, beside) if flat else (beside, own)
            yield encoded({"kind": "words", "misleading": misleading(plane.response, space.response)})


def _frame(name: str, curve: Curve) -> bytes:
    described, columns = _curve(name, curve)
    return encoded({"kind": "curve", "curve": described}, columns)


def _curve(name: str, curve: Curve) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header and columns for a response."""
    found = curve.response
    head = {
        "name": name,
        "rays": curve.rays,
        "in_space": curve.in_space,
        "finished": curve.finished,
        "merits": plain(curve.merits),
        "ends": [plain(found.contrast[i]) for i in (0, -1)],
        "u_ends": [plain(found.u_contrast[i]) for i in (0, -1)],
    }
    return head, {
        f"{name}_angle": found.angle_deg,
        f"{name}_contrast": found.contrast,
        f"{name}_u": found.u_contrast,
        f"{name}_right": found.right,
        f"{name}_left": found.left,
    }
