"""A scene that is not a Y: a parabolic mirror makes a beam, a ball lens focuses it on a small receiver.

The emitter is at the mirror's focus, so its light leaves parallel to +x, shifted upwards. The ball focuses it to a
spot, blurred by spherical aberration; a second receiver around the first one collects the blur.
"""

from solen.curve import Arc, Parabola, Segment
from solen.scene import Fan, Interface, Region, Scene
from solen.trace import trace

FOCAL_MM = 10.0  # of the mirror: x = z² / (4 f), its focus at x = f
BALL_X_MM, BALL_Z_MM, BALL_RADIUS_MM, INDEX = 30.0, 10.0, 4.0, 1.44
SPOT_HALF_MM = 0.1
AXIS_DEG, CONE_DEG = 36.87, 28.0  # counter-clockwise from +z: up and to the left, where the mirror is


def focus_x_mm() -> float:
    """Return where rays near the ball's axis meet: n R / (2 (n - 1)) behind its centre."""
    return BALL_X_MM + INDEX * BALL_RADIUS_MM / (2.0 * (INDEX - 1.0))


def scene(rays: int) -> Scene:
    """Return mirror, ball and receivers; a receiver's face is its left side, here the side towards the ball."""
    mirror = Parabola((0.0, 0.0), (0.0, 1.0), 1.0 / (4.0 * FOCAL_MM), 0.0, 20.0)
    x, low, high = focus_x_mm(), BALL_Z_MM - SPOT_HALF_MM, BALL_Z_MM + SPOT_HALF_MM
    return Scene(
        regions=(Region("air", 1.0), Region("glass", INDEX)),
        interfaces=(
            Interface("mirror", mirror, "air", "air", "mirror"),
            Interface("ball", Arc.circle((BALL_X_MM, BALL_Z_MM), BALL_RADIUS_MM), "glass", "air"),
            Interface("below", Segment((x, low - 20.0), (x, low)), "air", "air", "receiver", "blur"),
            Interface("middle", Segment((x, low), (x, high)), "air", "air", "receiver", "spot"),
            Interface("above", Segment((x, high), (x, high + 20.0)), "air", "air", "receiver", "blur"),
        ),
        sources=(Fan((FOCAL_MM, 0.0), AXIS_DEG, CONE_DEG, rays),),
    )


def main() -> tuple[float, float]:
    """Return the fractions of the counted rays in the spot and in the blur around it."""
    found = trace(scene(100_000), "count")
    spot, blur = found.detectors["spot"].power, found.detectors["blur"].power
    print(f"focus of the ball at x = {focus_x_mm():.4f} mm")
    print(f"within ±{SPOT_HALF_MM} mm of it {spot:.4f} of the light, round it {blur:.4f}")
    return spot, blur


if __name__ == "__main__":
    main()
