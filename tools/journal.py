"""Draw the kinds of figure that the paper and its supplement have, from simulated data, each with one command.

``python tools/journal.py FOLDER`` writes the data and a .png of each figure; ``page.png`` there shows all of them side
by side, to be looked at against the captions: 2A-C, S1A-D, S2, 3E, S5.
"""

import os
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from solen.cli import run_command
from solen.geometry.coupons import layout
from solen.material.index import forward
from tests.metrology.coupon_support import Camera, Print
from tests.metrology.inspect_support import Shot, lens
from tests.metrology.render.camera import png
from tests.pipeline.test_fidelity_command import png as coupon_png

PAGE = "--width-mm 90 --no-titles --letters A --dpi 150"
COMMANDS = {
    "2A-C": "resin index layer.csv --thickness-um 50 --figure FILE --width-mm 180 --no-titles --letters A --dpi 150",
    "S1A": f"resin stiffness a1.csv a2.csv a3.csv b1.csv b2.csv b3.csv --label pristine pristine pristine modified "
    f"modified modified --cube-mm 10 --mode compression --figure FILE --panels A {PAGE}",
    "S1B": f"resin spectra pristine.csv modified.csv --trace T --figure FILE {PAGE} --limits x=400:900",
    "S1C": f"resin cure modified-discs.csv pristine-discs.csv --figure FILE {PAGE}",
    "S1D": f"resin exposures exposures.csv --figure FILE --panels A {PAGE}",
    "S2": f"print coupons --out coupons --only film-layer --figure FILE {PAGE}",
    "3E": f"print inspect lens.png --design part/sensor.toml --um-per-px 5 --figure FILE --panels A {PAGE}",
    "S5": f"print fidelity a.png --job coupons/group-a.json --um-per-px 14 --figure FILE {PAGE}",
}


def write_inputs() -> None:
    """Simulated measurements of two resins, their layers, discs, cubes, a lens and a coupon."""
    rng, nm = np.random.default_rng(1), np.arange(400.0, 901.0, 5.0)
    for name, k in (("layer", 1e-5), ("pristine", 6e-5), ("modified", 2e-5)):
        reflected, transmitted = forward(1.49 + 4e3 / nm**2, k, 50.0, nm)
        columns = np.column_stack([nm, transmitted, reflected])
        np.savetxt(f"{name}.csv", columns, delimiter=",", header="wavelength_nm,T,R", comments="# simulated\n")
    for name, dp, ec in (("pristine", 95.0, 8.0), ("modified", 110.0, 6.0)):
        dose = np.repeat(13.0 * np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), 3)
        um = dp * np.log(dose / ec) * (1.0 + 0.03 * rng.standard_normal(dose.size))
        np.savetxt(f"{name}-discs.csv", np.column_stack([dose, um]), delimiter=",",
                   header="dose_mJ_per_cm2,thickness_um", comments="")  # fmt: skip
    rows = [(s, w, 0.92 - 0.004 * s - 12.0 * np.exp(-(w - 300.0) / 20.0) + 0.001 * rng.standard_normal())
            for s in (2, 4, 6) for w in nm]  # fmt: skip
    np.savetxt("exposures.csv", rows, delimiter=",", header="exposure_s,wavelength_nm,T", comments="")
    strain = np.linspace(0.0, 0.3, 61)
    for name, modulus in (("a", 1.9), ("b", 1.1)):
        for number in (1, 2, 3):
            stretch = 1.0 - strain
            newton = modulus * rng.normal(1.0, 0.04) / 3.0 * (stretch**-2 - stretch) * 100.0
            table = np.column_stack([10.0 * strain, newton])
            np.savetxt(f"{name}{number}.csv", table, delimiter=",", header="displacement_mm,force_N", comments="")
    Path("lens.png").write_bytes(png(Shot(lens("solen-860")).taken(1)))
    coupon_png(Path("a.png"), Camera(14.0, 3.0, blur_px=1.2).picture(Print(layout("group-a"))))


def main(folder: Path) -> None:
    """Draw them all, and the page."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    write_inputs()
    run_command(["new", "part", "--quiet"])
    run_command(["print", "coupons", "--out", "coupons", "--only", "group-a", "--quiet"])
    pictures = []
    for name, command in COMMANDS.items():
        print(name, run_command([*command.replace("FILE", f"{name}.png").split(), "--quiet"]))
        pictures.append(Image.open(f"{name}.png").convert("RGB"))
    heights, places, wide = [0, 0, 0], [], max(picture.width for picture in pictures)
    for picture in pictures:
        column = heights.index(min(heights))
        places.append((column * wide, heights[column]))
        heights[column] += picture.height + 20
    page = Image.new("RGB", (3 * wide, max(heights)), "white")
    for picture, place in zip(pictures, places, strict=True):
        page.paste(picture, place)
    page.save("page.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
