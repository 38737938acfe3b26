"""Draw the kinds of figure that the paper and its supplement have, from simulated data, each with one command.

``python -m tools.journal FOLDER`` writes the data and the figures there, and small copies for the page that shows them
(docs/figures.md): 2A-C, 3E-G, S1A-D, S2A-E, S5A-D.
"""

import os
import sys
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from solen.arrays import FloatArray
from solen.cli import run_command
from solen.geometry.coupons import layout
from solen.material.index import forward
from tests.metrology.coupon_support import Camera, Print
from tests.metrology.inspect_support import Shot, lens
from tests.pipeline.test_fidelity_command import png

IMAGES = Path(__file__).resolve().parent.parent / "docs" / "images"
COLUMN = "--width-mm 90 --no-titles --dpi 150"
PAGE = "--width-mm 180 --no-titles --letters A --dpi 150"
CUBES = "a1.csv a2.csv a3.csv b1.csv b2.csv b3.csv --label pristine pristine pristine modified modified modified"
LENSES = {"3e": "860", "3f": "500", "3g": "450"}
COUPONS = {"s5a": "group-a", "s5b": "group-b", "s5d": "holes"}
COMMANDS = {
    "2": f"resin index layer.csv --thickness-um 50 --u-R 0.0005 --u-T 0.0005 --figure FILE {PAGE}",
    "s1a": f"resin stiffness {CUBES} --cube-mm 10 --mode compression --figure FILE --panels A --letters A {COLUMN}",
    "s1b": f"resin spectra pristine.csv modified.csv --trace T --limits x=400:900 --figure FILE --letters B {COLUMN}",
    "s1c": f"resin cure discs/pristine.csv discs/modified.csv --figure FILE --letters C {COLUMN}",
    "s1d": f"resin exposures exposures.csv --figure FILE --panels A --letters D {COLUMN}",
    "s2": f"print coupons --out coupons --only film-layer --figure FILE {PAGE}",
    **{
        name: f"print inspect lens-{nm}.png --design paper-{nm}/sensor.toml --um-per-px 5 --figure FILE --panels A "
        f"--letters {name[1].upper()} {COLUMN}"
        for name, nm in LENSES.items()
    },
    **{
        name: f"print fidelity {coupon}.png --job coupons/{coupon}.json --um-per-px 8 --figure FILE {COLUMN}"
        for name, coupon in COUPONS.items()
    },
    "s5c": f"print fidelity group-c.tif --job coupons/group-c.json --um-per-px 14 --z-um 1 --figure FILE {COLUMN}",
}
PHOTOGRAPHS = {*LENSES, *COUPONS, "s5c"}
"""Of these a PNG would be several times as large as a JPEG."""


def table(name: str, columns: FloatArray, header: str) -> None:
    """A table of simulated numbers, which says so."""
    Path(name).parent.mkdir(exist_ok=True)
    np.savetxt(name, columns, delimiter=",", header=f"# simulated\n{header}", comments="")


def write_spectra(rng: np.random.Generator) -> None:
    """T and R of layers of two resins, and T of layers by their exposure."""
    nm = np.arange(400.0, 901.0, 5.0)
    for name, k in (("layer", 1e-5), ("pristine", 6e-5), ("modified", 2e-5)):
        r, t = forward(1.49 + 4e3 / nm**2, k, 50.0, nm)
        noise = 5e-4 * rng.standard_normal((2, nm.size))
        table(f"{name}.csv", np.column_stack([nm, t + noise[0], r + noise[1]]), "wavelength_nm,T,R")
    seconds, at = (grid.ravel() for grid in np.meshgrid([2.0, 4.0, 6.0], nm, indexing="ij"))
    t = 0.92 - 0.004 * seconds - 12.0 * np.exp(-(at - 300.0) / 20.0) + 0.001 * rng.standard_normal(at.size)
    table("exposures.csv", np.column_stack([seconds, at, t]), "exposure_s,wavelength_nm,T")


def write_discs_and_cubes(rng: np.random.Generator) -> None:
    """Thicknesses of cured discs, and force on cubes pressed together, of two resins."""
    for name, dp, ec in (("pristine", 95.0, 8.0), ("modified", 110.0, 6.0)):
        dose = np.repeat(13.0 * np.arange(1.0, 7.0), 3)
        um = dp * np.log(dose / ec) * (1.0 + 0.03 * rng.standard_normal(dose.size))
        table(f"discs/{name}.csv", np.column_stack([dose, um]), "dose_mJ_per_cm2,thickness_um")
    strain = np.linspace(0.0, 0.3, 61)
    for name, modulus in (("a", 1.9), ("b", 1.1)):
        for number in (1, 2, 3):
            stretch = 1.0 - strain
            newton = modulus * rng.normal(1.0, 0.04) / 3.0 * (stretch**-2 - stretch) * 100.0
            table(f"{name}{number}.csv", np.column_stack([10.0 * strain, newton]), "displacement_mm,force_N")


def write_pictures() -> None:
    """Micrographs of the three lenses and of coupons, one of them as a map of heights."""
    for nm in LENSES.values():
        run_command(["new", f"paper-{nm}", "--example", f"paper-{nm}", "--quiet"])
        png(Path(f"lens-{nm}.png"), Shot(lens(f"solen-{nm}")).taken(1) / 255.0)
    names = [*COUPONS.values(), "group-c"]
    run_command(["print", "coupons", "--out", "coupons", "--only", ",".join(names), "--quiet"])
    for name in COUPONS.values():
        merged = frozenset({"g-0.03", "g-0.02"}) if name == "group-b" else frozenset()
        png(Path(f"{name}.png"), Camera(8.0, 3.0, blur_px=1.2).picture(Print(layout(name), merged=merged)))
    heights = Camera(14.0, 3.0).z_map(Print(layout("group-c")))
    tifffile.imwrite("group-c.tif", (1e3 * heights).astype(np.float32), description="simulated map of heights")


def small_copy(name: str) -> None:
    """The figure as the page shows it: few colours, or a JPEG of a photograph."""
    with Image.open(f"{name}.png") as picture:
        if name in PHOTOGRAPHS:
            picture.convert("RGB").save(IMAGES / f"paper-{name}.jpg", quality=80)
        else:
            picture.convert("RGB").quantize(64).save(IMAGES / f"paper-{name}.png", optimize=True)


def main(folder: Path) -> None:
    """Draw them all."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    rng = np.random.default_rng(1)
    write_spectra(rng)
    write_discs_and_cubes(rng)
    write_pictures()
    for name, command in COMMANDS.items():
        if run_command([*command.replace("FILE", f"{name}.png").split(), "--quiet"]) != 0:
            sys.exit(f"figure {name} was not drawn")
        small_copy(name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
