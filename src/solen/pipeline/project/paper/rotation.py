"""Lens and ray figures: profiles, the rotation as simulated and as tested, other indices, no lens (3, 4, S4)."""

from pathlib import Path

from solen.paper.design_numbers import body_sizes, lens_sizes, peak_nm, pivot_off_mm, source_of, u_major_base_mm
from solen.paper.sensor_numbers import (
    LED,
    POINT,
    SIDE_DEG,
    focus_mm,
    percent_without_lens,
    ratio,
    saturated_from_deg,
    shipped,
    turned,
)
from solen.paper.statements import Comparison, compared
from solen.pipeline.project.paper.model import COLUMN, Made, PaperFigure, Picture
from solen.report.paper.figures import rays_of_states
from solen.report.plot import figure_of
from solen.sensor import Sensor

OTHERS_NM = ("500", "450")
ZOOM_MM = 3.0
SIDES = (-SIDE_DEG, SIDE_DEG)
STATES = (-SIDE_DEG, 0.0, SIDE_DEG)
OF_POINT = "100 rays of a point source in the plane"


def _lenses(_: Path) -> Made:
    lens = shipped(POINT).lens
    alt = "the ovals of 1.44, 1.49 and 1.54 from x = −2 to 2 mm; the lower the index, the deeper the lens"
    picture = Picture("3A.svg", alt, lambda: figure_of(lens), COLUMN.model_copy(update={"letters": "A"}))
    found = [compared(f"focus-{nm}", focus_mm(shipped(f"paper-{nm}"))) for nm in ("860", *OTHERS_NM)]
    sizes = [compared(key, size) for key, size in lens_sizes(shipped(POINT)).items()]
    return Made((picture,), (*found, *sizes))


def _simulated(_: Path) -> Made:
    point, led = shipped(POINT), shipped(LED)
    found, real = turned(point), turned(led)
    share, _u = ratio(real.apart, found.apart)
    near = f"{OF_POINT}, near the lens at 0°: they meet behind it"
    both = f"{OF_POINT} at −3° and +3°: they reach only the right and only the left receiver"
    return Made(
        (
            Picture("3B.svg", near, lambda: rays_of_states(point, (0.0,), "B", ZOOM_MM), COLUMN),
            Picture("3CD.svg", both, lambda: rays_of_states(point, SIDES, "CD")),
        ),
        (
            compared("balanced", found.contrast[1], found.u_contrast[1]),
            compared("to-right", found.contrast[0], found.u_contrast[0], saturation=saturated_from_deg(point)),
            compared("to-left", found.contrast[2], found.u_contrast[2]),
            compared("in-space", *real.apart, share=share),
            *_sizes(point),
        ),
    )


def _sizes(point: Sensor) -> list[Comparison]:
    """Compare the sizes of the Y, its light and its centre of rotation with the paper's."""
    sizes = body_sizes(point)
    u = {"major-base": u_major_base_mm(sizes)}
    rows = [compared(key, size, u.get(key, 0.0)) for key, size in (sizes | source_of(point)).items()]
    return [*rows, compared("pivot", pivot_off_mm(point, -SIDE_DEG))]


def _parts() -> list[Comparison]:
    """Return the peak wavelengths of the paper's emitter and receiver from their datasheets."""
    led, receiver = peak_nm("VSMY1850"), peak_nm("TEMT7100X01")
    return [compared("led-peak", *led, peak=led[0]), compared("receiver-peak", *receiver)]


def _experiment(_: Path) -> Made:
    led = shipped(LED)
    found = turned(led)
    alt = "rays of the LED in the plane: equal at 0°, more at the right receiver at −3°, more at the left one at +3°"
    keys = ("experiment-right", "experiment-balanced", "experiment-left")
    rows = [compared(key, *pair) for key, *pair in zip(keys, found.contrast, found.u_contrast, strict=True)]
    mark = "SIMULATED: the LED of solen-860 with its chip; the rays of the plane are shown, no seed"
    picture = Picture("4ABC.svg", alt, lambda: rays_of_states(led, (0.0, *SIDES), "ABC"), mark=mark)
    return Made((picture,), (rows[1], rows[0], rows[2], *_parts()))


def _others(_: Path) -> Made:
    point = shipped(POINT)
    others = {nm: shipped(f"paper-{nm}") for nm in OTHERS_NM}
    drawn = {"ABC": others["500"], "DEF": others["450"], "GHI": point.without_lens}
    words = {"ABC": "n = 1.49", "DEF": "n = 1.54", "GHI": "without the lens: hardly any difference"}
    pictures = [
        Picture(
            f"S4{letters}.svg",
            f"{OF_POINT} at −3°, 0° and +3°, {words[letters]}",
            lambda sensor=sensor, letters=letters: rays_of_states(sensor, STATES, letters),  # type: ignore[misc]
        )
        for letters, sensor in drawn.items()
    ]
    rows = [compared(f"lens-{nm}", *turned(sensor).apart) for nm, sensor in others.items()]
    return Made(tuple(pictures), (*rows, compared("control-simulated", *percent_without_lens(point, turned(point)))))


LENSES = PaperFigure(
    "3A",
    "Lens profiles by the Cartesian oval's equation, for the three indices.",
    (
        "solen new paper-860 --example paper-860",
        "solen lens paper-860/sensor.toml --figure fig3a.pdf --letters A",
    ),
    _lenses,
)
SIMULATED = PaperFigure(
    "3B-D",
    "The simulation: (B) detail of the lens (n = 1.44), (C) after a rotation by −3°, (D) by +3°.",
    (
        "solen trace paper-860/sensor.toml --angle-deg -3 --figure fig3c.pdf --letters C",
        "solen trace paper-860/sensor.toml --angle-deg 3 --figure fig3d.pdf --letters D",
        "solen run paper-860/sensor.toml --out results   # rays-at-the-lens.svg is the detail",
    ),
    _simulated,
)
EXPERIMENT = PaperFigure(
    "4A-C",
    "The test: (A) at the start, (B) right rotation (−3°), (C) left rotation (+3°).",
    ("solen new solen-860 --example solen-860", "solen run solen-860/sensor.toml --out results   # rays.svg"),
    _experiment,
)
OTHERS = PaperFigure(
    "S4",
    "Simulations for (A–C) n = 1.49 and (D–F) 1.54, and (G–I) without the lens, each at −3°, 0° and +3°. "
    "The text of the paper assigns only G–I; the order of the others is assumed.",
    (
        "solen new paper-500 --example paper-500",
        "solen run paper-500/sensor.toml --out results-500   # rays.svg",
        "solen new paper-450 --example paper-450",
        "solen run paper-450/sensor.toml --out results-450",
        "solen run paper-860/sensor.toml --out results   # rays-without-lens.svg",
    ),
    _others,
)
