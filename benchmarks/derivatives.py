"""The derivative of a received power if only the edge of a shadow moves, computed by solen and by other methods.

Run with ``python -m benchmarks.derivatives`` in the project folder. A square chip of 0.2 mm has a Lambertian emission
pattern; a knife edge is half way to the receiver, and the received fraction is differentiated with respect to the
position of the edge. The path of no ray changes with it, so differentiation along paths gives zero; the documentation
of Optiland's non-sequential mode states this (0.6.3: "visibility gradients are zero"), and it is not run here. The true
value is the integral along the edge of the light per millimetre that passes it on its path to the receiver.

All times are for one process on all cores, without compilation; ``error`` is relative to the true value.
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


class Slope(NamedTuple):
    """A derivative per mm, its computing time in s, and its method."""

    method: str
    value: float
    seconds: float


def scene_at(edge_mm: float, rays: int = RAYS) -> Scene:
    """Return the scene with the knife edge at a position; the knife is on its right."""
    knife = Segment((edge_mm, KNIFE_MM), (KNIFE_END_MM, KNIFE_MM))
    screen = Segment((HALF_WIDTH_MM, SCREEN_MM), (-HALF_WIDTH_MM, SCREEN_MM))
    faces = (
        Interface("knife", knife, "air", "air", "absorbing"),
        Interface("screen", screen, "air", "air", "receiver", "screen"),
    )
    chip = Emitter((0.0, 0.0), 0.0, rays, CosinePower(1.0), 180.0, CHIP_MM, CHIP_MM)
    return Scene((Region("air", 1.0),), faces, (chip,), extrusion=Extrusion(2.0 * HALF_HEIGHT_MM))


def exact_slope(nodes: int = 60) -> float:
    """Return the light per millimetre that passes the edge and reaches the screen, by Gaussian quadrature."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    chip, on_chip = 0.5 * CHIP_MM * points, 0.5 * weights
    x, y = chip[:, None, None], chip[None, :, None]
    # only the heights at which light passes the edge and arrives between top and bottom of the screen
    middle, half = 0.5 * y, 0.5 * HALF_HEIGHT_MM
    height = middle + half * points[None, None, :]
    square = (EDGE_MM - x) ** 2 + (height - y) ** 2 + KNIFE_MM**2
    crossing = KNIFE_MM**2 / (math.pi * square**2)  # cos² / (π r²)
    return float(np.sum(on_chip[:, None, None] * on_chip[None, :, None] * half * weights * crossing))


def by_solen() -> list[Slope]:
    """Return the derivative of the integral, and central differences of a million sampled rays."""
    power = partial(derivative, scene_at, EDGE_MM)
    rows = [Slope("solen, derivative", power().detectors["screen"].value, best_s(power, 3))]

    def difference(seed: int = 0) -> float:
        ends = [trace(scene_at(EDGE_MM + sign * STEP_MM), "power", sampling="sobol", seed=seed) for sign in (1, -1)]
        return (ends[0].detectors["screen"].power - ends[1].detectors["screen"].power) / (2.0 * STEP_MM)

    rows.append(Slope(f"solen, central differences, 2 × {RAYS} rays", difference(), best_s(difference, 3)))

    def integrals() -> float:
        ends = [integrate(scene_at(EDGE_MM + sign * STEP_MM), "power", 1e-6) for sign in (1, -1)]
        return (ends[0].detectors["screen"].power - ends[1].detectors["screen"].power) / (2.0 * STEP_MM)

    rows.append(Slope("solen, central differences of integrals to 1e-6", integrals(), best_s(integrals, 3)))
    return rows


def by_mitsuba() -> list[Slope]:
    """Return derivatives from projective sampling of silhouettes, and from differentiation along paths only.

    A camera that faces the white screen sees its radiance, the irradiance divided by π, uniformly over its image.
    """
    import drjit as dr
    import mitsuba as mi

    scene = mi.load_dict(_mitsuba_scene())
    values = mi.traverse(scene)
    area_ratio = (2.0 * HALF_WIDTH_MM) * (2.0 * HALF_HEIGHT_MM) / CHIP_MM**2
    rows = []
    for method, integrator in (
        ("Mitsuba, projective sampling", {"type": "direct_projective", "sppc": SAMPLES, "sppp": 0, "sppi": SAMPLES}),
        ("Mitsuba, along paths", {"type": "prb", "max_depth": 2}),
    ):
        tracer = mi.load_dict(integrator)

        def slope(seed: int = 0, tracer: Any = tracer) -> float:
            edge = mi.Float(0.0)
            dr.enable_grad(edge)
            values["knife.to_world"] = _knife(EDGE_MM + edge)
            values.update()
            image = mi.render(scene, values, integrator=tracer, spp=SAMPLES, seed=seed)
            dr.forward(edge)
            return float(np.mean(np.array(dr.grad(image)))) * area_ratio

        rows.append(Slope(f"{method}, {SAMPLES} × {PIXELS_WIDE * PIXELS_HIGH} samples", slope(), best_s(slope, 3)))
    return rows


def _knife(edge: Any) -> Any:
    """Return the transformation of the square from −1 to 1 to the knife."""
    import mitsuba as mi

    size = mi.Vector3f(0.5 * (KNIFE_END_MM - edge), 4.0 * HALF_HEIGHT_MM, 1.0)
    middle = mi.Vector3f(0.5 * (KNIFE_END_MM + edge), KNIFE_MM, 0.0)
    return mi.Transform4f().translate(middle).rotate([1, 0, 0], 90).scale(size)


def _mitsuba_scene() -> dict[str, Any]:
    """Return chip, knife, white screen and camera, in Mitsuba's (x, z, y)."""
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
    exact = exact_slope()
    rows = by_solen()
    if with_mitsuba.missing() is None:
        rows += by_mitsuba()
    else:
        print(f"Mitsuba omitted: {with_mitsuba.missing()}")
    print(f"true value {exact:.8f} per mm (with half the nodes {exact_slope(30):.8f})")
    for row in rows:
        print(f"{row.method:60} {row.value:.8f}  error {row.value / exact - 1.0:9.1e}  {1e3 * row.seconds:8.1f} ms")


if __name__ == "__main__":
    main()
