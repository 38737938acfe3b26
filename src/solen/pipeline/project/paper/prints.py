"""Figures S2, 3E–G and S5: the one-layer sample, printed lenses with their ovals, and printing resolution."""

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
    alt = "base on the build plate, film cured onto it, layer cured, film with layer in the beam, rays through a slab"
    picture = Picture("S2.svg", alt, lambda: figure_of(plans), PAGE.model_copy(update={"letters": "A"}))
    sizes = film_layer_sizes(plans.layouts[0]) | settings_of_print()
    return Made((picture,), tuple(compared(key, size) for key, size in sizes.items()))


def _lenses(folder: Path) -> Made:
    drawn = [_lens(folder, number, letter, nm) for number, (letter, nm) in enumerate(LENSES_NM.items())]
    return Made(tuple(picture for picture, _ in drawn), tuple(row for _, row in drawn))


def _lens(folder: Path, number: int, letter: str, nm: str) -> tuple[Picture, Comparison]:
    sensor, file = shipped(f"paper-{nm}"), folder / f"lens-{nm}.png"
    design = files.write_text(folder / f"paper-{nm}.toml", dumps(sensor.design))
    files.write_bytes(file, images.lens_image(sensor, number))
    scale = InspectOptions(um_per_px=images.LENS_UM_PER_PX)
    inspection = inspect(file, design=design, options=scale).result
    rms_um, u_um, nearest_um = deviation_um(inspection)
    alt = f"simulated micrograph of the lens for {nm} nm with the ovals for its index and the other two indices"
    options = COLUMN.model_copy(update={"panels": "A", "letters": letter})
    picture = Picture(f"3{letter}.png", alt, partial(figure_of, inspection), options, MARK)
    return picture, compared(f"printed-{nm}", rms_um, u_um, nearest_um=nearest_um)


def _coupons(folder: Path) -> Made:
    drawn = [_coupon(folder, letter, name, key) for letter, (name, key) in COUPONS_OF.items()]
    sizes = [compared(key, size) for key, size in coupon_sizes().items()]
    return Made(tuple(picture for picture, _ in drawn), (*(row for _, row in drawn), *sizes))


def _coupon(folder: Path, letter: str, name: str, key: str) -> tuple[Picture, Comparison]:
    coupon = layout(name)
    if key == "step":
        file, content = folder / f"{name}.tif", images.coupon_heights(coupon)
        scale = HeightMapOptions(um_per_px=images.HEIGHT_UM_PER_PX, z_um=1.0)
    else:
        file, content = folder / f"{name}.png", images.coupon_image(coupon)
        scale = HeightMapOptions(um_per_px=images.COUPON_UM_PER_PX)
    files.write_bytes(file, content)
    measurement = fidelity(file, coupon=name, options=scale).result
    alt = (
        f"simulated {measurement.image} of the {name} coupon with its measured outline, and its deviations from nominal"
    )
    picture = Picture(f"S5{letter}.png", alt, partial(coupon_figure, measurement, key, letter), mark=MARK)
    return picture, compared(key, *smallest_um(measurement, LIMITS[key]))


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
