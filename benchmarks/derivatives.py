"""The derivative of a received power where only a shadow's edge moves: solen beside other ways to it.

Run with ``python -m benchmarks.derivatives`` in the project's folder. A square chip of 0.2 mm emits by Lambert's law; a
knife stands half way, and the received share of the light is differentiated by where its edge is. No ray's path changes
with that, so that whoever differentiates along paths finds zero; Optiland's non-sequential mode documents that it does
(0.6.3: "visibility gradients are zero") and is not run here. The truth is an integral over the edge: what crosses a
millimetre of it on the way to the receiver.

All times are of one process on all cores, compilation left out; ``error`` is beside the truth, relative.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from benchmarks import with_mitsuba
from benchmarks.tracing import best_s
from solen.curve import Segment
from solen.scene import CosinePower, Emitter, Extrusion, Interface, Region, Scene
from solen.trace import derivative, integrate, trace

EDGE_MM, STEP_MM = 0.3, 0.02
CHIP_MM, KNIFE_MM, SCREEN_MM = 0.2, 5.0, 10.0
HALF_WIDTH_MM, HALF_HEIGHT_MM, KNIFE_END_MM, CAMERA_MM = 2.0, 1.0, 8.0, 4.0
RAYS = 2**20
SAMPLES, PIXELS_WIDE, PIXELS_HIGH = 64, 64, 32


class Found(NamedTuple):
    """A derivative per mm, how long it took in s, and what was done."""

    how: str
    value: float
    seconds: float


def scene_at(edge_mm: float, rays: int = RAYS) -> Scene:
    """The scene with the knife's edge there: black to the right of it."""
    knife = Segment((edge_mm, KNIFE_MM), (KNIFE_END_MM, KNIFE_MM))
    screen = Segment((HALF_WIDTH_MM, SCREEN_MM), (-HALF_WIDTH_MM, SCREEN_MM))
    faces = (
        Interface("knife", knife, "air", "air", "absorbing"),
        Interface("screen", screen, "air", "air", "receiver", "screen"),
    )
    chip = Emitter((0.0, 0.0), 0.0, rays, CosinePower(1.0), 180.0, CHIP_MM, CHIP_MM)
    return Scene((Region("air", 1.0),), faces, (chip,), extrusion=Extrusion(2.0 * HALF_HEIGHT_MM))


def truth(nodes: int = 60) -> float:
    """Light that crosses a millimetre of the edge and goes on to the screen, by Gauss's rule over chip and edge."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    chip, on_chip = 0.5 * CHIP_MM * points, 0.5 * weights
    x, y = chip[:, None, None], chip[None, :, None]
    # of the edge only the heights whose light arrives between top and bottom of the screen
    middle, half = 0.5 * y, 0.5 * HALF_HEIGHT_MM
    height = middle + half * points[None, None, :]
    square = (EDGE_MM - x) ** 2 + (height - y) ** 2 + KNIFE_MM**2
    crossing = KNIFE_MM**2 / (math.pi * square**2)  # cos² / (π r²)
    return float(np.sum(on_chip[:, None, None] * on_chip[None, :, None] * half * weights * crossing))


def by_solen() -> list[Found]:
    """The derivative of the integral, and central differences of a million sampled rays."""
    power = partial(derivative, scene_at, EDGE_MM)
    rows = [Found("solen, derivative", power().detectors["screen"].value, best_s(power, 3))]

    def difference(seed: int = 0) -> float:
        ends = [trace(scene_at(EDGE_MM + sign * STEP_MM), "power", sampling="sobol", seed=seed) for sign in (1, -1)]
        return (ends[0].detectors["screen"].power - ends[1].detectors["screen"].power) / (2.0 * STEP_MM)

    rows.append(Found(f"solen, central differences, 2 × {RAYS} rays", difference(), best_s(difference, 3)))

    def integrals() -> float:
        ends = [integrate(scene_at(EDGE_MM + sign * STEP_MM), "power", 1e-6) for sign in (1, -1)]
        return (ends[0].detectors["screen"].power - ends[1].detectors["screen"].power) / (2.0 * STEP_MM)

    rows.append(Found("solen, central differences of integrals to 1e-6", integrals(), best_s(integrals, 3)))
    return rows


def by_mitsuba() -> list[Found]:
    """Projective sampling of silhouettes, and derivatives along paths alone.

    A camera that faces the white screen sees its radiance, the irradiance over π, evenly over its picture.
    """
    import drjit as dr
    import mitsuba as mi

    made = mi.load_dict(_mitsuba_scene())
    values = mi.traverse(made)
    share = (2.0 * HALF_WIDTH_MM) * (2.0 * HALF_HEIGHT_MM) / CHIP_MM**2
    rows = []
    for how, integrator in (
        ("Mitsuba, projective sampling", {"type": "direct_projective", "sppc": SAMPLES, "sppp": 0, "sppi": SAMPLES}),
        ("Mitsuba, along paths", {"type": "prb", "max_depth": 2}),
    ):
        tracer = mi.load_dict(integrator)

        def slope(seed: int = 0, tracer: Any = tracer) -> float:
            edge = mi.Float(0.0)
            dr.enable_grad(edge)
            values["knife.to_world"] = _knife(EDGE_MM + edge)
            values.update()
            image = mi.render(made, values, integrator=tracer, spp=SAMPLES, seed=seed)
            dr.forward(edge)
            return float(np.mean(np.array(dr.grad(image)))) * share

        rows.append(Found(f"{how}, {SAMPLES} × {PIXELS_WIDE * PIXELS_HIGH} samples", slope(), best_s(slope, 3)))
    return rows


def _knife(edge: Any) -> Any:
    """Where the square from −1 to 1 has to be for the knife."""
    import mitsuba as mi

    size = mi.Vector3f(0.5 * (KNIFE_END_MM - edge), 4.0 * HALF_HEIGHT_MM, 1.0)
    middle = mi.Vector3f(0.5 * (KNIFE_END_MM + edge), KNIFE_MM, 0.0)
    return mi.Transform4f().translate(middle).rotate([1, 0, 0], 90).scale(size)


def _mitsuba_scene() -> dict[str, Any]:
    """Chip, knife, white screen and camera, in Mitsuba's (x, z, y)."""
    import mitsuba as mi

    transform = mi.ScalarTransform4f
    return {
        "type": "scene",
        "chip": {
            "type": "rectangle",
            "to_world": transform().rotate([1, 0, 0], -90).scale([0.5 * CHIP_MM, 0.5 * CHIP_MM, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        },
        "knife": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(_knife(EDGE_MM).matrix.numpy()[..., 0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        },
        "screen": {
            "type": "rectangle",
            "to_world": transform()
            .translate([0, SCREEN_MM, 0])
            .rotate([1, 0, 0], 90)
            .scale([HALF_WIDTH_MM, HALF_HEIGHT_MM, 1]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}},
        },
        "camera": {
            "type": "perspective",
            "fov": math.degrees(2.0 * math.atan(HALF_WIDTH_MM / CAMERA_MM)),
            "fov_axis": "x",
            "to_world": transform().look_at([0, SCREEN_MM - CAMERA_MM, 0], [0, SCREEN_MM, 0], [0, 0, 1]),
            "film": {
                "type": "hdrfilm",
                "width": PIXELS_WIDE,
                "height": PIXELS_HIGH,
                "pixel_format": "luminance",
                "rfilter": {"type": "box"},
            },
        },
    }


def main() -> None:
    """Print the table."""
    exact = truth()
    rows = by_solen()
    if with_mitsuba.missing() is None:
        rows += by_mitsuba()
    else:
        print(f"Mitsuba left out: {with_mitsuba.missing()}")
    print(f"truth {exact:.8f} per mm (with half the nodes {truth(30):.8f})")
    for row in rows:
        print(f"{row.how:60} {row.value:.8f}  error {row.value / exact - 1.0:9.1e}  {1e3 * row.seconds:8.1f} ms")


if __name__ == "__main__":
    main()
