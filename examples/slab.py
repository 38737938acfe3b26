"""A scene defined in code: a beam through an absorbing slab, with a monitor on each side.

Light is reflected to and fro between the two faces, weaker each time. The tracer follows both branches of every split,
so its sums are those of a geometric series: T = (1 - R)² τ / (1 - R² τ²) is transmitted and R + R τ T reflected, where
R is the reflectance of one face and τ the transmission of one passage.
"""

from solen.curve import Segment
from solen.interface import fresnel
from solen.scene import Beam, Interface, Monitor, Region, Scene
from solen.trace import Limits, trace

INDEX, ABSORPTION_PER_MM, THICKNESS_MM = 1.5, 0.05, 4.0
WIDE_MM = 100.0


def slab() -> Scene:
    """Return glass between z = 0 and its thickness; the left of a curve is at +90° from its direction."""
    left, right = -WIDE_MM, WIDE_MM
    front = Segment((left, 0.0), (right, 0.0))  # walked to the right: +z, the glass, is on its left
    back = Segment((right, THICKNESS_MM), (left, THICKNESS_MM))
    ends = (Segment(front.b, back.a), Segment(back.b, front.a))  # far away, but media must be closed
    return Scene(
        regions=(Region("air", 1.0), Region("glass", INDEX, ABSORPTION_PER_MM)),
        interfaces=tuple(Interface(f"side-{i}", side, "glass", "air") for i, side in enumerate((front, back, *ends))),
        sources=(Beam((-1.0, -10.0), (1.0, -10.0), direction_deg=0.0, rays=9),),
        monitors=(
            Monitor("before", (left, -5.0), (right, -5.0)),  # its left is +z as well: power towards +z is positive
            Monitor("behind", (left, 9.0), (right, 9.0)),
        ),
    )


def main() -> tuple[float, float, float]:
    """Return the net power towards +z before and behind the slab, and the power absorbed in it."""
    found = trace(slab(), "power", Limits(min_weight=1e-12))
    before, behind = found.monitors["before"].power, found.monitors["behind"].power
    one_face = fresnel(1.0, 1.0, INDEX).s
    print(f"one face reflects {one_face:.6f}")
    print(f"net power before the slab {before:.9f}, behind it {behind:.9f}")
    print(f"absorbed in it {found.ledger.absorbed:.9f}, cut off {found.ledger.truncated:.1e}")
    return before, behind, found.ledger.absorbed


if __name__ == "__main__":
    main()
