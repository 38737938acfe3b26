"""A scene that is not a Y sensor: a parabolic mirror collimates light, and a ball lens focuses it on a receiver.

The emitter is at the focus of the mirror, so the reflected light is parallel to the x axis, centred at the height of
the ball. The ball focuses it to a spot, blurred by spherical aberration; a second receiver, around the first one,
collects the blur.
"""

from solen.curve import Arc, Parabola, Segment
from solen.scene import Fan, Interface, Region, Scene
from solen.trace import trace

FOCAL_MM = 10.0  # of the mirror: x = z² / (4 f), with the focus at x = f
BALL_X_MM, BALL_Z_MM, BALL_RADIUS_MM, INDEX = 30.0, 10.0, 4.0, 1.44
SPOT_HALF_MM = 0.1
AXIS_DEG, CONE_DEG = 36.87, 28.0  # counter-clockwise from +z: upwards and to the left, towards the mirror


def focus_x_mm() -> float:
    """Return the x of the paraxial focus of the ball: n R / (2 (n - 1)) behind its centre."""
    return BALL_X_MM + INDEX * BALL_RADIUS_MM / (2.0 * (INDEX - 1.0))


def scene(rays: int) -> Scene:
    """Return mirror, ball and receivers; the face of a receiver is its left side, here towards the ball."""
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
    """Return the fractions of the rays that are counted in the spot and in the blur around it."""
    detectors = trace(scene(100_000), "count").detectors
    spot, blur = detectors["spot"].power, detectors["blur"].power
    print(f"focus of the ball at x = {focus_x_mm():.4f} mm")
    print(f"{spot:.4f} of the light is within ±{SPOT_HALF_MM} mm of the focus, {blur:.4f} around it")
    return spot, blur


if __name__ == "__main__":
    main()
