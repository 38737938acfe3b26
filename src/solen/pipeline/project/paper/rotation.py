"""Figures 3A–D, 4A–C and S4: lens profiles, the rotation as simulated and as tested, other indices, and no lens."""

from pathlib import Path

from solen.paper.design_numbers import body_sizes, lens_sizes, peak_nm, pivot_deviation_mm, source_of, u_major_base_mm
from solen.paper.sensor_numbers import (
    LED,
    POINT,
    SIDE_DEG,
    contrasts,
    focus_mm,
    percent_without_lens,
    ratio,
    saturation_deg,
    shipped,
)
from solen.paper.statements import Comparison, compared
from solen.pipeline.project.paper.model import COLUMN, Made, PaperFigure, Picture
from solen.report.paper.figures import states_figure
from solen.report.plot import figure_of
from solen.sensor import Sensor

OTHERS_NM = ("500", "450")
ZOOM_MM = 3.0
SIDES = (-SIDE_DEG, SIDE_DEG)
STATES = (-SIDE_DEG, 0.0, SIDE_DEG)
POINT_RAYS = "100 rays of a point source in the plane"


def _lenses(_: Path) -> Made:
    lens = shipped(POINT).lens
    alt = "the ovals for the indices 1.44, 1.49 and 1.54 from x = −2 to 2 mm; the lower the index, the deeper the lens"
    picture = Picture("3A.svg", alt, lambda: figure_of(lens), COLUMN.model_copy(update={"letters": "A"}))
    comparisons = [compared(f"focus-{nm}", focus_mm(shipped(f"paper-{nm}"))) for nm in ("860", *OTHERS_NM)]
    sizes = [compared(key, size) for key, size in lens_sizes(shipped(POINT)).items()]
    return Made((picture,), (*comparisons, *sizes))


def _simulated(_: Path) -> Made:
    point, led = shipped(POINT), shipped(LED)
    point_contrasts, led_contrasts = contrasts(point), contrasts(led)
    fraction, _u = ratio(led_contrasts.separation, point_contrasts.separation)
    detail_alt = f"{POINT_RAYS}, near the lens at 0°: they meet behind it"
    sides_alt = f"{POINT_RAYS} at −3° and +3°: they reach only the right and only the left receiver"
    return Made(
        (
            Picture("3B.svg", detail_alt, lambda: states_figure(point, (0.0,), "B", ZOOM_MM), COLUMN),
            Picture("3CD.svg", sides_alt, lambda: states_figure(point, SIDES, "CD")),
        ),
        (
            compared("balanced", point_contrasts.contrast[1], point_contrasts.u_contrast[1]),
            compared(
                "to-right", point_contrasts.contrast[0], point_contrasts.u_contrast[0], saturation=saturation_deg(point)
            ),
            compared("to-left", point_contrasts.contrast[2], point_contrasts.u_contrast[2]),
            compared("in-space", *led_contrasts.separation, fraction=fraction),
            *_sizes(point),
        ),
    )


def _sizes(point: Sensor) -> list[Comparison]:
    """Compare the sizes of the body, its light source and its centre of rotation with the paper."""
    sizes = body_sizes(point)
    u = {"major-base": u_major_base_mm(sizes)}
    rows = [compared(key, size, u.get(key, 0.0)) for key, size in (sizes | source_of(point)).items()]
    return [*rows, compared("pivot", pivot_deviation_mm(point, -SIDE_DEG))]


def _parts() -> list[Comparison]:
    """Compare the peak wavelengths in the datasheets of the emitter and the receiver with the paper."""
    led, receiver = peak_nm("VSMY1850"), peak_nm("TEMT7100X01")
    return [compared("led-peak", *led, peak=led[0]), compared("receiver-peak", *receiver)]


def _experiment(_: Path) -> Made:
    led = shipped(LED)
    led_contrasts = contrasts(led)
    alt = (
        "rays of the LED in the plane: equally many at both receivers at 0°, more at the right one at −3°, more at the "
        "left one at +3°"
    )
    keys = ("experiment-right", "experiment-balanced", "experiment-left")
    rows = [
        compared(key, *pair) for key, *pair in zip(keys, led_contrasts.contrast, led_contrasts.u_contrast, strict=True)
    ]
    mark = "SIMULATED: the LED of solen-860 with its chip; rays are shown in the plane, no seed"
    picture = Picture("4ABC.svg", alt, lambda: states_figure(led, (0.0, *SIDES), "ABC"), mark=mark)
    return Made((picture,), (rows[1], rows[0], rows[2], *_parts()))


def _others(_: Path) -> Made:
    point = shipped(POINT)
    designs = {nm: shipped(f"paper-{nm}") for nm in OTHERS_NM}
    sensors = {"ABC": designs["500"], "DEF": designs["450"], "GHI": point.without_lens}
    text = {"ABC": "n = 1.49", "DEF": "n = 1.54", "GHI": "without the lens: hardly any difference"}
    pictures = [
        Picture(
            f"S4{letters}.svg",
            f"{POINT_RAYS} at −3°, 0° and +3°, {text[letters]}",
            lambda sensor=sensor, letters=letters: states_figure(sensor, STATES, letters),  # type: ignore[misc]
        )
        for letters, sensor in sensors.items()
    ]
    rows = [compared(f"lens-{nm}", *contrasts(sensor).separation) for nm, sensor in designs.items()]
    return Made(tuple(pictures), (*rows, compared("control-simulated", *percent_without_lens(point, contrasts(point)))))


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
