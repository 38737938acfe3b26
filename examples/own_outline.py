"""A scene with a custom outline: a body bounded by a spline, an LED chip of finite width, a dispersive resin.

The chip emits three wavelengths; the drop refracts blue more than red. Rays are sampled with a scrambled Sobol' net, so
the received fraction has a standard error. The scene is written to a file and read back unchanged.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from solen.curve import Segment, Spline
from solen.material import Cauchy
from solen.scene import Chip, Interface, Region, Scene, load, save
from solen.trace import trace

OUTLINE_MM = [(0.0, 4.0), (2.2, 5.0), (3.0, 7.5), (2.4, 11.0), (0.0, 13.0), (-2.4, 11.0), (-3.0, 7.5), (-2.2, 5.0)]
LED = ((450.0, 0.2), (530.0, 0.5), (625.0, 0.3))  # wavelength in nm, weight


def drop() -> Scene:
    """Return the drop; its points are in counter-clockwise order, so the body is on the left of its outline."""
    body = Spline.through(OUTLINE_MM, closed=True)
    resin = Cauchy(A=1.49, B_um2=0.006, C_um4=0.0, valid_nm=(400.0, 900.0))
    return Scene(
        regions=(Region("air", 1.0), Region("resin", resin, absorption_per_mm=0.01)),
        interfaces=(
            Interface("body", body, left="resin", right="air"),
            Interface("screen", Segment((3.0, 20.0), (-3.0, 20.0)), "air", "air", "receiver", "screen"),
        ),
        sources=(Chip((0.0, 0.0), width_mm=0.2, axis_deg=0.0, cone_deg=50.0, rays=65_536, spectrum=LED),),
    )


def main() -> tuple[float, float, float]:
    """Return the fraction of the power on the screen: from a Sobol' net, its standard error, and from a lattice."""
    with TemporaryDirectory() as folder:
        scene = load(save(Path(folder) / "drop.json", drop()))
    sampled = trace(scene, "power", sampling="sobol", seed=1, position_bins=6).detectors["screen"]
    lattice = trace(scene, "power").detectors["screen"]
    print(f"on the screen: {sampled.power:.4f} ± {sampled.u_power:.4f}, with a regular lattice {lattice.power:.4f}")
    print("along the screen:", " ".join(f"{power:.3f}" for power in sampled.power_by_position[0]))
    return sampled.power, sampled.u_power, lattice.power


if __name__ == "__main__":
    main()
