"""Small scenes and checks that several tests share."""

import dataclasses
import math

from scipy.integrate import quad

from solen.curve import Arc, Curve, Segment
from solen.plane import Point, Rigid
from solen.scene import Fan, Interface, Monitor, Rays, Region, Scene
from solen.scene.model import Behaviour
from solen.scene.sources import Source
from solen.trace import Limits, Path, Trace, trace

FINE = Limits(min_weight=1e-15, max_hits=1000)
AIR = Region("air", 1.0)


def glass(index: float, absorption_per_mm: float = 0.0) -> Region:
    """Return a medium named glass."""
    return Region("glass", index, absorption_per_mm)


def slab(source: Source, index: float, thickness_mm: float, absorption_per_mm: float = 0.0) -> Scene:
    """Return a slab that begins at z = 0 and is 2 m wide, with absorbing ends and a monitor behind it."""
    corners = [(-1000.0, 0.0), (1000.0, 0.0), (1000.0, thickness_mm), (-1000.0, thickness_mm)]
    sides: dict[str, Behaviour] = {
        "front": "refracting",
        "right": "absorbing",
        "back": "refracting",
        "left": "absorbing",
    }
    behind = Monitor("behind", (-1000.0, thickness_mm + 1.0), (1000.0, thickness_mm + 1.0))
    ends = zip(sides.items(), corners, [*corners[1:], corners[0]], strict=True)
    interfaces = tuple(Interface(name, Segment(a, b), "glass", "air", kind) for (name, kind), a, b in ends)
    return Scene((AIR, glass(index, absorption_per_mm)), interfaces, (source,), (behind,))


def guide(length_mm: float, gap_mm: float | None = None, rays: int = 1) -> Scene:
    """Return a guide of index 1.44, 5 mm wide, and a fan of 120 degrees 1 mm in front of the middle of one end.

    Behind the other end, at a distance ``gap_mm``, is the receiver ``screen``, as wide as the guide; without a gap it
    receives all light that leaves that end.
    """
    corners = [(-2.5, 0.0), (2.5, 0.0), (2.5, length_mm), (-2.5, length_mm)]
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    faces = [Interface(f"face{i}", Segment(a, b), "glass", "air") for i, (a, b) in enumerate(ends)]
    half_mm, z_mm = (2.5, length_mm + gap_mm) if gap_mm else (1e5, length_mm + 1e-3)
    screen = Interface("screen", Segment((half_mm, z_mm), (-half_mm, z_mm)), "air", "air", "receiver", "screen")
    return Scene((AIR, glass(1.44)), (*faces, screen), (Fan((0.0, -1.0), 0.0, 120.0, rays),))


def guided_fraction() -> float:
    """Return the fraction of the light that leaves the far end of such a guide: the fan average of Σ (1 − R)/(1 + R)/2.

    The sum is over s and p, and R is the reflectance of the first interface. All light that enters is guided without
    loss.
    """

    def transmittance(angle: float) -> float:
        cos_in, cos_out = math.cos(angle), math.sqrt(1.0 - (math.sin(angle) / 1.44) ** 2)
        s = ((cos_in - 1.44 * cos_out) / (cos_in + 1.44 * cos_out)) ** 2
        p = ((1.44 * cos_in - cos_out) / (1.44 * cos_in + cos_out)) ** 2
        return 0.5 * ((1 - s) / (1 + s) + (1 - p) / (1 + p))

    half = math.radians(60.0)
    return float(quad(transmittance, 0.0, half)[0]) / half


def one_ray(origin: Point, angle_deg: float, s_share: float = 0.5) -> Rays:
    """Return a single ray, ``angle_deg`` counter-clockwise from +z."""
    angle = math.radians(angle_deg)
    return Rays((origin,), ((-math.sin(angle), math.cos(angle)),), s_share=s_share)


def box(half_mm: float, inside: str = "air") -> tuple[Interface, ...]:
    """Return four receivers around the origin, facing it."""
    corners = [(-half_mm, -half_mm), (half_mm, -half_mm), (half_mm, half_mm), (-half_mm, half_mm)]
    names = ("below", "right", "above", "left")
    ends = zip(names, corners, [*corners[1:], corners[0]], strict=True)
    return tuple(Interface(name, Segment(a, b), inside, inside, "receiver", name) for name, a, b in ends)


def body(curves: list[Curve], name: str = "glass", outside: str = "air") -> tuple[Interface, ...]:
    """Return refracting interfaces for counter-clockwise curves."""
    return tuple(Interface(f"{name}-{i}", curve, name, outside) for i, curve in enumerate(curves))


def moved(scene: Scene, motion: Rigid) -> Scene:
    """Return a scene after a rigid motion, with its sources converted to rays."""
    return dataclasses.replace(
        scene,
        interfaces=tuple(dataclasses.replace(i, curve=i.curve.moved(motion)) for i in scene.interfaces),
        monitors=tuple(
            dataclasses.replace(m, start=motion.point(m.start), end=motion.point(m.end)) for m in scene.monitors
        ),
        sources=tuple(_moved_source(source, motion) for source in scene.sources),
    )


def check_same_readings(a: Trace, b: Trace, tolerance: float) -> None:
    """Check that detectors, monitors and ledgers agree."""
    for name, reading in a.detectors.items():
        assert abs(b.detectors[name].power - reading.power) <= tolerance, name
        assert b.detectors[name].rays == reading.rays, name
    for name, crossed in a.monitors.items():
        assert abs(b.monitors[name].power - crossed.power) <= tolerance, name
    for fate in ("detected", "escaped", "absorbed", "truncated"):
        assert abs(getattr(a.ledger, fate) - getattr(b.ledger, fate)) <= tolerance, fate


def only_path(scene: Scene) -> Path:
    """Return the path of a scene's only ray, in counting mode."""
    (path,) = trace(scene, "count", Limits(max_hits=1000), segments=True).paths()
    return path


def circle_arcs(center: Point, radius_mm: float, pieces: int) -> list[Curve]:
    """Return a circle divided into equal arcs, counter-clockwise."""
    sweep = 360.0 / pieces
    return [Arc(center, radius_mm, 17.0 + i * sweep, sweep) for i in range(pieces)]


def _moved_source(source: Source, motion: Rigid) -> Rays:
    launch = source.launch()
    origins = zip(launch.x_mm.tolist(), launch.z_mm.tolist(), strict=True)
    directions = zip(launch.dx.tolist(), launch.dz.tolist(), strict=True)
    return Rays(
        tuple(motion.point(p) for p in origins),
        tuple(motion.vector(d) for d in directions),
        power=source.power,
        s_share=source.s_share,
    )
