"""Write the readings of golden scenes again: ``python -m tests.scenes.regenerate [NAME ...]``.

Without names, the readings of all scenes are written. With ``--scenes``, the scenes in `SCENES` are written first.
"""

import argparse
from collections.abc import Callable

from solen.curve import Arc, CartesianOval, Parabola, Segment
from solen.geometry import y_body
from solen.lens import lens_of
from solen.material import optical
from solen.plane import Point, Rigid
from solen.scene import Beam, Fan, Interface, Monitor, Rays, Region, Scene, save, sensor_scene
from solen.spec import Design, Lens, Material, Receivers
from tests.scenes.golden_support import FOLDER, as_csv, scene_of

AIR = Region("air", 1.0)


def sensor(design: Design, angle_deg: float) -> Scene:
    material = optical(design)
    return sensor_scene(design, y_body(design, lens_of(design, material.index), angle_deg), material, 2000)


def sensor_turned() -> Scene:
    """Return the paper's sensor at −0.5 degrees, with light in both arms."""
    return sensor(Design(name="sensor turned", material=Material(index=1.44)), -0.5)


def sensor_behind_a_gap() -> Scene:
    """Return an absorbing sensor without lens, with receivers behind air gaps."""
    design = Design(
        name="sensor behind a gap",
        material=Material(index=1.49, absorption_per_mm=0.005),
        lens=Lens(shape="none"),
        receivers=Receivers(coupling="air-gap", gap_mm=0.5),
    )
    return sensor(design, 3.0)


def polygon(name: str, corners: list[Point], inside: str, outside: str) -> tuple[Interface, ...]:
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    return tuple(Interface(f"{name}-{i}", Segment(a, b), inside, outside) for i, (a, b) in enumerate(ends))


def prism_and_screen() -> Scene:
    """Return a prism in a polarised beam, a screen of two receivers, and a black wall for the reflected light."""
    prism = polygon("prism", [(-2.0, 0.0), (2.0, 0.0), (0.0, 3.4)], "glass", "air")
    screen = (
        Interface("near", Segment((6.0, -6.0), (6.0, -1.0)), "air", "air", "receiver", "near"),
        Interface("far", Segment((6.0, -1.0), (6.0, 6.0)), "air", "air", "receiver", "far"),
    )
    black = Interface("black", Segment((-6.0, 6.0), (-6.0, -6.0)), "air", "air", "absorbing")
    beam = Beam((-5.0, -0.6), (-4.6, -1.3), -60.0, 101, power=2.0, s_share=1.0)
    return Scene(
        (AIR, Region("glass", 1.52)),
        (*prism, *screen, black),
        (beam,),
        (Monitor("before", (5.0, -6.0), (5.0, 6.0), 6),),
    )


def nested_balls() -> Scene:
    """Return a drop that contains a bubble and a dense core, illuminated from outside and from inside."""
    circles = (
        Interface("drop", Arc.circle((0.0, 0.0), 4.0), "water", "air"),
        Interface("bubble", Arc.circle((1.5, 0.5), 1.0).reversed(), "water", "hollow"),
        Interface("core", Arc.circle((-1.6, 0.0), 1.2), "core", "water"),
    )
    regions = (AIR, Region("water", 1.33, 0.01), Region("hollow", 1.0), Region("core", 1.8, 0.2))
    sources = (Fan((0.0, -7.0), 0.0, 50.0, 101), Fan((0.2, -2.0), 20.0, 360.0, 61, power=0.5, s_share=0.2))
    return Scene(regions, circles, sources, (Monitor("above", (9.0, 5.0), (-9.0, 5.0), 9),))


def mirror_cabinet() -> Scene:
    """Return straight, circular and parabolic mirrors around single rays, with a receiver and a wall."""
    mirrors = (
        Interface("flat", Segment((-5.0, -4.0), (5.0, -4.0)), "air", "air", "mirror"),
        Interface("hollow", Arc((0.0, 0.0), 6.0, 150.0, 60.0), "air", "air", "mirror"),
        Interface("dish", Parabola((5.5, 0.0), (0.0, 1.0), -0.08, -3.0, 3.0), "air", "air", "mirror"),
    )
    catcher = Interface("catcher", Segment((3.0, 5.0), (-3.0, 5.0)), "air", "air", "receiver", "catcher")
    wall = Interface("wall", Arc.through((4.0, 4.0), (5.0, 5.0), (6.0, 4.0)), "air", "air", "absorbing")
    directions = tuple((float(k), 5.0 - abs(k)) for k in range(-6, 7))
    rays = Rays(((0.5, -1.0),) * 13, directions, power=1.3)
    return Scene((AIR,), (*mirrors, catcher, wall), (rays,), (Monitor("cut", (-6.0, 1.0), (6.0, 1.0), 4),))


def oval_relay() -> Scene:
    """Return two oval lenses face to face, one of them reversed, in front of a receiver and rotated by 10 degrees."""
    front = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.6, 4.0, 12.0, 20.0, -20.0)
    back = front.moved(Rigid.about((0.0, 3.0), 180.0)).reversed()
    rotation = Rigid.about((0.0, 3.0), 10.0)
    sides = (
        Interface("front", front.moved(rotation), "glass", "air"),
        Interface("right", Segment(front.end, back.end).moved(rotation), "glass", "air", "absorbing"),
        Interface("back", back.moved(rotation), "air", "glass"),
        Interface("left", Segment(back.start, front.start).moved(rotation), "glass", "air", "mirror"),
    )
    screen = Interface("screen", Segment((4.0, 12.0), (-4.0, 12.0)), "air", "air", "receiver", "screen")
    glass = Region("glass", 1.6, 0.03)
    return Scene((AIR, glass), (*sides, screen), (Fan((0.0, -4.0), 0.0, 44.0, 301),))


SCENES: dict[str, tuple[Callable[[], Scene], float]] = {
    "sensor-turned": (sensor_turned, 1e-3),  # two of 2000 rays, which may enter either arm at the edge of the fork
    "sensor-behind-a-gap": (sensor_behind_a_gap, 1e-3),
    "prism-and-screen": (prism_and_screen, 1e-9),
    "nested-balls": (nested_balls, 1e-6),  # the minimum weight of a branch
    "mirror-cabinet": (mirror_cabinet, 1e-9),
    "oval-relay": (oval_relay, 1e-6),
}
"""Function that builds each scene, and tolerance of its readings."""


def regenerate(name: str, *, scenes: bool) -> None:
    """Write the readings of a scene, and if ``scenes``, first the scene itself."""
    make, tolerance = SCENES[name]
    if scenes:
        save(FOLDER / f"{name}.json", make())
    (FOLDER / f"{name}.csv").write_text(as_csv(scene_of(name), tolerance), encoding="utf-8", newline="\n")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=list(SCENES))
    parser.add_argument("--scenes", action="store_true", help="also write the scenes in SCENES")
    options = parser.parse_args()
    for name in options.names:
        regenerate(name, scenes=options.scenes)


if __name__ == "__main__":
    main()
