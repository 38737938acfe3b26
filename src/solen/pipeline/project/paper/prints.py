"""Print figures: the one-layer sample, printed lenses with their ovals, and resolution (S2, 3E–G, S5)."""

from functools import partial
from pathlib import Path

from solen import files
from solen.geometry.coupons import layout
from solen.metrology import InspectOptions
from solen.metrology.height_map import HeightMapOptions
from solen.paper import images
from solen.paper.design_numbers import coupon_sizes, settings_of_print
from solen.paper.sample_numbers import film_layer_sizes, smallest_um
from solen.paper.sensor_numbers import deviation_um, shipped
from solen.paper.statements import Comparison, compared
from solen.pipeline.print.coupons import coupons
from solen.pipeline.print.fidelity import fidelity
from solen.pipeline.print.inspect import inspect
from solen.pipeline.project.paper.model import COLUMN, PAGE, Made, PaperFigure, Picture
from solen.report.paper.figures import coupon_figure
from solen.report.plot import figure_of
from solen.spec import dumps

MARK = f"SIMULATED: {images.MODEL}; seed {images.SEED}"
LENSES_NM = {"E": "860", "F": "500", "G": "450"}
COUPONS_OF = {"A": ("group-a", "pillar"), "B": ("group-b", "gap"), "C": ("group-c", "step"), "D": ("holes", "hole")}
LIMITS = {"pillar": "positive_diameter", "gap": "gap", "step": "z_step", "hole": "hole_variation"}
FILM = "film-layer"


def _film(_: Path) -> Made:
    plans = coupons(only=FILM, listing=True).result
    alt = "base on the platform, film cured onto it, layer cured, film with layer in the beam, rays through a slab"
    picture = Picture("S2.svg", alt, lambda: figure_of(plans), PAGE.model_copy(update={"letters": "A"}))
    found = film_layer_sizes(plans.layouts[0]) | settings_of_print()
    return Made((picture,), tuple(compared(key, size) for key, size in found.items()))


def _lenses(folder: Path) -> Made:
    made = [_lens(folder, number, letter, nm) for number, (letter, nm) in enumerate(LENSES_NM.items())]
    return Made(tuple(picture for picture, _ in made), tuple(row for _, row in made))


def _lens(folder: Path, number: int, letter: str, nm: str) -> tuple[Picture, Comparison]:
    sensor, file = shipped(f"paper-{nm}"), folder / f"lens-{nm}.png"
    design = files.write_text(folder / f"paper-{nm}.toml", dumps(sensor.design))
    files.write_bytes(file, images.lens_image(sensor, number))
    scale = InspectOptions(um_per_px=images.LENS_UM_PER_PX)
    found = inspect(file, design=design, options=scale).result
    rms_um, u_um, rival = deviation_um(found)
    alt = f"simulated micrograph of the lens for {nm} nm with its own oval, and those of the other two indices"
    look = COLUMN.model_copy(update={"panels": "A", "letters": letter})
    picture = Picture(f"3{letter}.png", alt, partial(figure_of, found), look, MARK)
    return picture, compared(f"printed-{nm}", rms_um, u_um, rival=rival)


def _coupons(folder: Path) -> Made:
    made = [_coupon(folder, letter, name, key) for letter, (name, key) in COUPONS_OF.items()]
    sizes = [compared(key, size) for key, size in coupon_sizes().items()]
    return Made(tuple(picture for picture, _ in made), (*(row for _, row in made), *sizes))


def _coupon(folder: Path, letter: str, name: str, key: str) -> tuple[Picture, Comparison]:
    coupon = layout(name)
    if key == "step":
        file, content = folder / f"{name}.tif", images.coupon_heights(coupon)
        scale = HeightMapOptions(um_per_px=images.HEIGHT_UM_PER_PX, z_um=1.0)
    else:
        file, content = folder / f"{name}.png", images.coupon_image(coupon)
        scale = HeightMapOptions(um_per_px=images.COUPON_UM_PER_PX)
    files.write_bytes(file, content)
    found = fidelity(file, coupon=name, options=scale).result
    alt = (
        f"simulated {found.image} of the coupon {name} with its measured outline, and its sizes minus the nominal sizes"
    )
    picture = Picture(f"S5{letter}.png", alt, partial(coupon_figure, found, key, letter), mark=MARK)
    return picture, compared(key, *smallest_um(found, LIMITS[key]))


FILM_LAYER = PaperFigure(
    "S2",
    "Fabrication of a one-layer sample (A–D), and the slab model used to evaluate it (E).",
    (f"solen print coupons --out coupons --only {FILM} --figure figs2.pdf --letters A",),
    _film,
)
LENSES = PaperFigure(
    "3E-G",
    "Microscope images of printed lenses, compared with the Cartesian ovals of the three indices.",
    tuple(
        f"solen print inspect data/lens-{nm}.png --design data/paper-{nm}.toml --um-per-px {images.LENS_UM_PER_PX:g} "
        f"--figure fig3{letter.lower()}.tiff --panels A --letters {letter}"
        for letter, nm in LENSES_NM.items()
    ),
    _lenses,
)
COUPONS = PaperFigure(
    "S5",
    "Printing resolution: (A) pillars, (B) gaps, (C) steps in height, (D) holes.",
    tuple(
        f"solen print fidelity data/{name}.{'tif' if key == 'step' else 'png'} --coupon {name} --um-per-px "
        f"{images.HEIGHT_UM_PER_PX if key == 'step' else images.COUPON_UM_PER_PX:g}"
        f"{' --z-um 1' if key == 'step' else ''} --figure figs5{letter.lower()}.pdf"
        for letter, (name, key) in COUPONS_OF.items()
    ),
    _coupons,
)
