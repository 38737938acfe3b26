"""The scene of a sensor: its body in air, the emitter before it, a receiver on each arm."""

from solen.curve import Curve, Segment
from solen.geometry import Body, Face
from solen.material import Optical
from solen.scene.model import Interface, Region, Scene
from solen.scene.sources import Fan
from solen.spec import Design

AIR = Region("air", 1.0)
BODY = "body"


def sensor_scene(design: Design, body: Body, material: Optical, rays: int | None = None) -> Scene:
    """Scene of a body of the given material; ``rays`` overrides the design's number.

    Receivers are called ``right`` and ``left``. With ``coupling = "matched"`` an arm's end is itself the receiver's
    black face: all that arrives from inside is detected. With ``"air-gap"`` the arm's end is a bare face and the
    receiver, as wide as the arm, stands ``gap_mm`` before it; light reaching its back is absorbed, not detected.
    """
    interfaces: list[Interface] = []
    for face in body.faces:
        interfaces.extend(_interfaces(design, face))
    emitter = Fan(
        body.emitter.point,
        body.emitter.axis_deg,
        design.emitter.cone_deg,
        design.emitter.rays if rays is None else rays,
    )
    regions = (AIR, Region(BODY, material.index, material.absorption_per_mm))
    return Scene(regions, tuple(interfaces), (emitter,), name=design.name)


def _interfaces(design: Design, face: Face) -> list[Interface]:
    part, _, side = face.name.partition("-")
    if part != "receiver":
        return [Interface(face.name, face.curve, BODY, AIR.name)]
    if design.receivers.coupling == "matched":
        return [Interface(face.name, face.curve, BODY, AIR.name, "receiver", side)]
    return [
        Interface(f"end-{side}", face.curve, BODY, AIR.name),
        Interface(face.name, _before(face.curve, design.receivers.gap_mm or 0.0), AIR.name, AIR.name, "receiver", side),
    ]


def _before(end: Curve, gap_mm: float) -> Segment:
    """The receiver's face ``gap_mm`` outside an arm's end, its left towards the arm."""
    nx, nz = end.normal_at(end.start)

    def outside(point: tuple[float, float]) -> tuple[float, float]:
        return (point[0] - gap_mm * nx, point[1] - gap_mm * nz)

    return Segment(outside(end.start), outside(end.end))
