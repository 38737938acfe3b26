"""A scene defined in code: a beam through an absorbing slab, with a monitor on each side.

Light is reflected repeatedly between the two faces. The tracer follows both rays of every split, so its powers equal
the sums of geometric series: the fraction T = (1 - R)² τ / (1 - R² τ²) is transmitted and R + R τ T is reflected, where
R is the reflectance of a face and τ the internal transmittance of a single pass.
"""

from solen.curve import Segment
from solen.refraction import fresnel
from solen.scene import Beam, Interface, Monitor, Region, Scene
from solen.trace import Limits, trace

INDEX, ABSORPTION_PER_MM, THICKNESS_MM = 1.5, 0.05, 4.0
HALF_WIDTH_MM = 100.0


def slab() -> Scene:
    """Return the slab between z = 0 and its thickness; the left side of a curve is at +90° to its direction."""
    left, right = -HALF_WIDTH_MM, HALF_WIDTH_MM
    front = Segment((left, 0.0), (right, 0.0))  # runs to the right, so its left side is towards +z: glass
    back = Segment((right, THICKNESS_MM), (left, THICKNESS_MM))
    ends = (Segment(front.b, back.a), Segment(back.b, front.a))  # far from the beam: regions must be closed
    return Scene(
        regions=(Region("air", 1.0), Region("glass", INDEX, ABSORPTION_PER_MM)),
        interfaces=tuple(Interface(f"side-{i}", side, "glass", "air") for i, side in enumerate((front, back, *ends))),
        sources=(Beam((-1.0, -10.0), (1.0, -10.0), direction_deg=0.0, rays=9),),
        monitors=(
            Monitor("before", (left, -5.0), (right, -5.0)),  # power towards its left side, +z, is positive
            Monitor("behind", (left, 9.0), (right, 9.0)),
        ),
    )


def main() -> tuple[float, float, float]:
    """Return the net power towards +z before and behind the slab, and the power absorbed in it."""
    result = trace(slab(), "power", Limits(min_weight=1e-12))
    before, behind = result.monitors["before"].power, result.monitors["behind"].power
    print(f"reflectance of a face: {fresnel(1.0, 1.0, INDEX).s:.6f}")
    print(f"net power before the slab {before:.9f}, behind it {behind:.9f}")
    print(f"absorbed in the slab {result.ledger.absorbed:.9f}, truncated {result.ledger.truncated:.1e}")
    return before, behind, result.ledger.absorbed


if __name__ == "__main__":
    main()
