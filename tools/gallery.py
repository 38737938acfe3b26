"""Pictures of the gallery, each drawn from the results of the example that it illustrates."""

import json
import runpy
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from solen.report.canvas import INK, LEFT, LOST, RIGHT, drawn, encoded, series
from solen.report.plot import figure_of
from solen.report.print.as_printed import draw_deviation
from solen.sensor import Sensor
from solen.sensor.traced import trace_design
from solen.spec import loads, template, with_values
from solen.trace.described import SceneFile, described, trace_scene

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images" / "gallery"
STATED = IMAGES / "drawn.json"
"""File of the pictures' checksums, with the number of drawn parts and the sum of their values."""


class Example(NamedTuple):
    """An example after it has run: its names, and the return value of its ``main``."""

    names: dict[str, Any]
    result: Any


def run(name: str) -> Example:
    """Run an example."""
    names = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
    return Example(names, names["main"]())


def _axes(width: float = 6.4, height: float = 3.0) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height))
    return figure, figure.add_subplot()


def _bars(values: dict[str, float], label: str, colour: str = RIGHT) -> Figure:
    """Draw values as bars with their names, the first on top."""
    figure, axes = _axes(height=0.6 + 0.3 * len(values))
    axes.barh(list(values), list(values.values()), color=colour, height=0.6)
    axes.invert_yaxis()
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set(xlabel=label, title="simulated")
    axes.grid(axis="y", visible=False)
    return figure


def _scene(scene: Any, title: str) -> Figure:
    """Draw a scene with its rays."""
    file = SceneFile(scene)
    figure = figure_of(described(file, trace_scene(file, paths=True), paths=True))
    figure.axes[0].set_title(f"simulated: {title}")
    return figure


def _rays(values: dict[str, Any], angle_deg: float = 0.0) -> Figure:
    """Draw rays in the paper's sensor with some values of its design changed."""
    sensor = Sensor.of(with_values(loads(template("paper-860")), {"emitter.rays": 60} | values))
    return figure_of(trace_design(sensor, angle_deg))


def paper_sensor(example: Example) -> Figure:
    """Draw counted rays of the sensor turned to the right."""
    return _rays({"trace.mode": "count"}, example.names["ANGLES_DEG"][0])


def three_wavelengths(example: Example) -> Figure:
    """Draw depth, acceptance and received light of the three designs against their index."""
    figure = Figure(figsize=(7.2, 2.6))
    index = [row.refractive_index for row in example.result]
    labels = {"depth_mm": "depth (mm)", "acceptance_deg": "accepts ± (deg)", "received": "received share"}
    for number, (axes, (name, label)) in enumerate(zip(figure.subplots(1, 3), labels.items(), strict=True)):
        values = [getattr(row, name) for row in example.result]
        axes.plot(index, values, color=series(number)["color"], marker="o")
        axes.set(xlabel="index of the resin", ylabel=label)
    figure.suptitle("simulated: designs for 860, 500 and 450 nm")
    return figure


def straight_response(example: Example) -> Figure:
    """Draw the contrast of both designs against the angle, with the straight line between its ends."""
    figure, axes = _axes()
    for number, (name, response) in enumerate(example.names["RESPONSES"].items()):
        axes.plot(response.angle_deg, response.contrast, **series(number), label=name)
        axes.plot(response.angle_deg[[0, -1]], response.contrast[[0, -1]], color=LOST, lw=0.8)
    axes.set(xlabel="angle (deg)", ylabel="contrast", title="simulated, emitter 0.03 mm off")
    axes.legend()
    return figure


def wrong_index(example: Example) -> Figure:
    """Draw rays of the lens in the other index, which meet before the arms part."""
    printed, cut_for = example.names["PRINTED"], example.names["CUT_FOR"]
    return _rays({"material.index": printed, "lens.design_index": cut_for})


def sweep_a_parameter(example: Example) -> Figure:
    """Draw the balance angle against the decentre."""
    figure, axes = _axes()
    axes.plot(list(example.result), list(example.result.values()), color=RIGHT, marker="o")
    axes.set(xlabel="emitter off its place (mm)", ylabel="balance at (deg)", title="simulated")
    return figure


def sensitivity(example: Example) -> Figure:
    """Draw the change of the contrast caused by an error of 0.01 mm."""
    error_mm = example.names["ERROR_MM"]
    changes = {key: error_mm * change for key, change in example.result.items()}
    return _bars(changes, f"change of the contrast at {example.names['ANGLE_DEG']}° by {error_mm} mm")


def slab(example: Example) -> Figure:
    """Draw the fractions of the power that are reflected, absorbed and transmitted."""
    before, behind, absorbed = example.result
    return _bars({"sent back": 1.0 - before, "absorbed": absorbed, "transmitted": behind}, "share of the power")


def own_outline(example: Example) -> Figure:
    """Draw the drop and its rays."""
    scene = example.names["drop"]()
    (chip,) = scene.sources
    return _scene(replace(scene, sources=(chip.with_rays(60),)), "a drop, a chip and a screen")


def own_curve_scene(example: Example) -> Figure:
    """Draw mirror, ball lens and receivers."""
    return _scene(example.names["scene"](60), "mirror, ball lens and receivers")


def solid(example: Example) -> Figure:
    """Draw the error of the meshes against their tolerance."""
    _, seated, meshes = example.result
    figure, axes = _axes()
    axes.loglog(list(meshes), [abs(volume - seated) for volume in meshes.values()], color=RIGHT, marker="o")
    axes.set(xlabel="tolerance of the mesh (mm)", ylabel="volume off by (mm³)", title="a mesh of the 860 nm sensor")
    return figure


def as_printed(example: Example) -> Figure:
    """Draw the printed lens and its design, and the contrast with both."""
    figure = Figure(figsize=(7.6, 3.2))
    left, right = figure.subplots(1, 2)
    draw_deviation(left, example.result.lens)
    found, angles = example.result.response, example.names["ANGLES_DEG"]
    right.plot(angles, found.designed.contrast, **series(0), label="designed")
    right.errorbar(angles, found.printed.contrast, 2.0 * found.u_difference, color=LEFT, label="printed, ± 2 u")
    right.set(xlabel="angle (deg)", ylabel="contrast")
    right.legend()
    figure.suptitle("simulated")
    return figure


def which_route(example: Example) -> Figure:
    """Draw uncertainties by method."""
    return _bars(example.result, "standard uncertainty of n at 860 nm")


def characterise_resin(example: Example) -> Figure:
    """Draw the errors of the measured resin properties, as multiples of their uncertainty or in per cent."""
    made = {"n": 1.48 + 0.005 / 0.86**2, "loss": 0.02, "Dp": 150.0, "C10_MPa": 0.2}
    off = {name: 100.0 * (example.result[name] / value - 1.0) for name, value in made.items()}
    return _bars(off, "found less what it was made of (%)")


def working_curve(example: Example) -> Figure:
    """Draw the cure depth against the dose, with the measured discs."""
    found = example.result
    figure, axes = _axes()
    dose = np.geomspace(found["Ec_mJ_per_cm2"], 100.0, 50)
    axes.semilogx(dose, found["Dp_um"] * np.log(dose / found["Ec_mJ_per_cm2"]), color=RIGHT, label="working curve")
    axes.plot([39.0], [found["at_3_s_um"]], **series(1, dots=True), label="3 s at 13 mW/cm²")
    axes.axhline(25.0, color=LOST, ls="--", label="a layer")
    axes.set(xlabel="dose (mJ/cm²)", ylabel="cure depth (µm)", title="simulated discs")
    axes.legend()
    return figure


def ambient_light(example: Example) -> Figure:
    """Draw the rejection by kind of light and method of subtraction."""
    figure, axes = _axes()
    places = np.arange(len(example.result))
    for number, name in enumerate(("one-sided", "two-sided", "mean of 4")):
        values = [row[number] for row in example.result.values()]
        axes.bar(places + 0.27 * (number - 1), values, 0.25, color=series(number)["color"], label=name)
    axes.set_xticks(places, list(example.result))
    axes.set(ylabel="rejection (dB)", title="simulated ambient light")
    axes.legend()
    return figure


def coupon_steps(example: Example) -> Figure:
    """Draw the heights along the middle row of the height map."""
    figure, axes = _axes()
    height_map = example.names["height_map_mm"]()
    row = height_map[np.argmax(height_map.max(axis=1))]
    axes.plot(1e-3 * example.names["UM_PER_PX"] * np.arange(row.size)[::4], row[::4], color=RIGHT, lw=1.0)
    axes.set(xlabel="along the coupon (mm)", ylabel="height (mm)", title="simulated height map")
    return figure


def fingertip(example: Example) -> Figure:
    """Draw the calibration to newtons."""
    return figure_of(example.result[2])


def tolerance_run(example: Example) -> Figure:
    """Draw the yield, its causes and the spread of the prints."""
    return figure_of(example.result)


def two_spectra(example: Example) -> Figure:
    """Draw spectra, index and extinction of the layer."""
    return figure_of(example.result)


def decode_angles(example: Example) -> Figure:
    """Draw decoded and known angles of the other day, in the order of the readings."""
    _, decoded, known = example.result
    figure, axes = _axes()
    axes.plot(known, decoded, **series(0, dots=True), ms=3, label="decoded")
    axes.plot([known.min(), known.max()], [known.min(), known.max()], color=INK, lw=0.8, label="as it was")
    axes.set(xlabel="known angle (deg)", ylabel="decoded angle (deg)", title="simulated")
    axes.legend()
    return figure


def network_of_guides(example: Example) -> Figure:
    """Draw the rays of each emitter."""
    return figure_of(example.result)


def soft_body(example: Example) -> Figure:
    """Draw strain, forces and light."""
    return figure_of(example.result)


PICTURES = {
    one.__name__: one
    for one in (
        *(paper_sensor, three_wavelengths, straight_response, wrong_index, sweep_a_parameter, sensitivity, slab),
        *(own_outline, own_curve_scene, solid, as_printed, which_route, characterise_resin, working_curve),
        *(ambient_light, coupon_steps, fingertip, tolerance_run, two_spectra, decode_angles),
        *(network_of_guides, soft_body),
    )
}
"""Functions that draw the picture of an example, by the example's name; `tools.pictures` draws three others."""
LARGE = {"network_of_guides", "soft_body", "own_outline", "own_curve_scene", "fingertip", "as_printed"}
"""Pictures whose files are smaller as pixels than as vectors."""


def file_of(name: str) -> Path:
    """Return the path of an example's picture."""
    return IMAGES / f"{name}{'.png' if name in LARGE else '.svg'}"


def values_of(figure: Figure) -> list[float]:
    """Return sums of the values that each part of a figure shows, which do not depend on fonts and sizes."""
    drawn_points = [
        points
        for axes in figure.axes
        for points in (
            *(line.get_xydata() for line in axes.lines),
            *(patch.get_patch_transform().transform(patch.get_path().vertices) for patch in axes.patches),
            *(path.vertices for parts in axes.collections for path in parts.get_paths()),
        )
    ]
    return [float(f"{np.nansum(np.abs(np.asarray(points, float))):.6g}") for points in drawn_points]


def main() -> None:
    """Draw all pictures, and write their checksums and sums into a file beside them."""
    IMAGES.mkdir(exist_ok=True)
    stated = {}
    for name, draw in PICTURES.items():
        example, picture = run(name), file_of(name)
        picture.write_bytes(encoded(drawn(partial(draw, example)), picture.suffix, name, 90))
        sums = values_of(draw(example))
        stated[name] = {"sha256": sha256(picture.read_bytes()).hexdigest(), "values": [len(sums), sum(sums)]}
    STATED.write_text(json.dumps(stated, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
