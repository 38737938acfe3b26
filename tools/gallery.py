"""Images of the gallery, each drawn from the results of the example that it illustrates."""

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
from solen.trace.scene_file import SceneFile, label_trace, trace_scene

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images" / "gallery"
RECORD = IMAGES / "drawn.json"
"""Checksums of the images, with the number of drawn elements and the sum of their values."""


class Example(NamedTuple):
    """An example after it has run: its global names and the return value of its ``main``."""

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
    """Draw values as horizontal bars with their names, the first at the top."""
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
    figure = figure_of(label_trace(file, trace_scene(file, paths=True), paths=True))
    figure.axes[0].set_title(f"simulated: {title}")
    return figure


def _rays(values: dict[str, Any], angle_deg: float = 0.0) -> Figure:
    """Draw rays in the sensor of the paper with some values of its design changed."""
    sensor = Sensor.of(with_values(loads(template("paper-860")), {"emitter.rays": 60} | values))
    return figure_of(trace_design(sensor, angle_deg))


def paper_sensor(example: Example) -> Figure:
    """Draw counted rays in the sensor at the first angle."""
    return _rays({"trace.mode": "count"}, example.names["ANGLES_DEG"][0])


def three_wavelengths(example: Example) -> Figure:
    """Draw depth, acceptance and received power of the three designs against their index."""
    figure = Figure(figsize=(7.2, 2.6))
    index = [row.refractive_index for row in example.result]
    labels = {"depth_mm": "depth (mm)", "acceptance_deg": "acceptance ± (deg)", "received": "received fraction"}
    for number, (axes, (name, label)) in enumerate(zip(figure.subplots(1, 3), labels.items(), strict=True)):
        values = [getattr(row, name) for row in example.result]
        axes.plot(index, values, color=series(number)["color"], marker="o")
        axes.set(xlabel="index of the resin", ylabel=label)
    figure.suptitle("simulated: designs for 860, 500 and 450 nm")
    return figure


def straight_response(example: Example) -> Figure:
    """Draw the contrast of both designs against angle, with straight lines between the ends."""
    figure, axes = _axes()
    for number, (name, response) in enumerate(example.names["RESPONSES"].items()):
        axes.plot(response.angle_deg, response.contrast, **series(number), label=name)
        axes.plot(response.angle_deg[[0, -1]], response.contrast[[0, -1]], color=LOST, lw=0.8)
    axes.set(xlabel="angle (deg)", ylabel="contrast", title="simulated, emitter 0.03 mm off axis")
    axes.legend()
    return figure


def wrong_index(example: Example) -> Figure:
    """Draw rays in the sensor with the wrong index, which cross the axis before the arms."""
    printed, design = example.names["PRINTED_INDEX"], example.names["DESIGN_INDEX"]
    return _rays({"material.index": printed, "lens.design_index": design})


def sweep_a_parameter(example: Example) -> Figure:
    """Draw the null against the decentre."""
    figure, axes = _axes()
    axes.plot(list(example.result), list(example.result.values()), color=RIGHT, marker="o")
    axes.set(xlabel="decentre of the emitter (mm)", ylabel="null (deg)", title="simulated")
    return figure


def sensitivity(example: Example) -> Figure:
    """Draw the change of the contrast caused by an error of 0.01 mm."""
    error_mm = example.names["ERROR_MM"]
    changes = {key: error_mm * change for key, change in example.result.items()}
    return _bars(changes, f"change of contrast at {example.names['ANGLE_DEG']}° due to {error_mm} mm")


def slab(example: Example) -> Figure:
    """Draw the fractions of the power that are reflected, absorbed and transmitted."""
    before, behind, absorbed = example.result
    return _bars({"reflected": 1.0 - before, "absorbed": absorbed, "transmitted": behind}, "fraction of the power")


def own_outline(example: Example) -> Figure:
    """Draw the drop and its rays."""
    scene = example.names["drop"]()
    (chip,) = scene.sources
    return _scene(replace(scene, sources=(chip.with_rays(60),)), "a drop, a chip and a screen")


def own_curve_scene(example: Example) -> Figure:
    """Draw mirror, ball lens and receivers."""
    return _scene(example.names["scene"](60), "mirror, ball lens and receivers")


def solid(example: Example) -> Figure:
    """Draw the volume error of the meshes against their tolerance."""
    _, exact, meshes = example.result
    figure, axes = _axes()
    axes.loglog(list(meshes), [abs(volume - exact) for volume in meshes.values()], color=RIGHT, marker="o")
    axes.set(xlabel="tolerance of the mesh (mm)", ylabel="volume error (mm³)", title="meshes of the 860 nm sensor")
    return figure


def as_printed(example: Example) -> Figure:
    """Draw the deviation of the printed lens from its design, and the contrast with both lenses."""
    figure = Figure(figsize=(7.6, 3.2))
    left, right = figure.subplots(1, 2)
    draw_deviation(left, example.result.lens)
    response, angles = example.result.response, example.names["ANGLES_DEG"]
    right.plot(angles, response.designed.contrast, **series(0), label="designed")
    right.errorbar(angles, response.printed.contrast, 2.0 * response.u_difference, color=LEFT, label="printed, ± 2 u")
    right.set(xlabel="angle (deg)", ylabel="contrast")
    right.legend()
    figure.suptitle("simulated")
    return figure


def which_route(example: Example) -> Figure:
    """Draw the uncertainty of each method."""
    return _bars(example.result, "standard uncertainty of n at 860 nm")


def characterise_resin(example: Example) -> Figure:
    """Draw the errors of the measured resin properties in per cent."""
    true = {"n": 1.48 + 0.005 / 0.86**2, "loss": 0.02, "Dp": 150.0, "C10_MPa": 0.2}
    errors = {name: 100.0 * (example.result[name] / value - 1.0) for name, value in true.items()}
    return _bars(errors, "error of the measured value (%)")


def working_curve(example: Example) -> Figure:
    """Draw the cure depth against dose, with the exposure of the paper."""
    result = example.result
    figure, axes = _axes()
    dose = np.geomspace(result["Ec_mJ_per_cm2"], 100.0, 50)
    axes.semilogx(dose, result["Dp_um"] * np.log(dose / result["Ec_mJ_per_cm2"]), color=RIGHT, label="working curve")
    axes.plot([39.0], [result["at_3_s_um"]], **series(1, dots=True), label="3 s at 13 mW/cm²")
    axes.axhline(25.0, color=LOST, ls="--", label="layer thickness")
    axes.set(xlabel="dose (mJ/cm²)", ylabel="cure depth (µm)", title="simulated discs")
    axes.legend()
    return figure


def ambient_light(example: Example) -> Figure:
    """Draw the rejection for each kind of light and method of subtraction."""
    figure, axes = _axes()
    positions = np.arange(len(example.result))
    for number, name in enumerate(("one-sided", "two-sided", "mean of 4")):
        values = [row[number] for row in example.result.values()]
        axes.bar(positions + 0.27 * (number - 1), values, 0.25, color=series(number)["color"], label=name)
    axes.set_xticks(positions, list(example.result))
    axes.set(ylabel="rejection (dB)", title="simulated ambient light")
    axes.legend()
    return figure


def coupon_steps(example: Example) -> Figure:
    """Draw the heights along the highest row of the height map."""
    figure, axes = _axes()
    height_map = example.names["height_map_mm"]()
    row = height_map[np.argmax(height_map.max(axis=1))]
    axes.plot(1e-3 * example.names["UM_PER_PX"] * np.arange(row.size)[::4], row[::4], color=RIGHT, lw=1.0)
    axes.set(xlabel="along the coupon (mm)", ylabel="height (mm)", title="simulated height map")
    return figure


def fingertip(example: Example) -> Figure:
    """Draw the calibration in newtons."""
    return figure_of(example.result[2])


def tolerance_run(example: Example) -> Figure:
    """Draw the yield, its largest losses and the distribution of the prints."""
    return figure_of(example.result)


def two_spectra(example: Example) -> Figure:
    """Draw the spectra, the index and the extinction of the layer."""
    return figure_of(example.result)


def decode_angles(example: Example) -> Figure:
    """Draw the decoded against the known angles of the other day."""
    _, decoded, known = example.result
    figure, axes = _axes()
    axes.plot(known, decoded, **series(0, dots=True), ms=3, label="decoded")
    axes.plot([known.min(), known.max()], [known.min(), known.max()], color=INK, lw=0.8, label="known")
    axes.set(xlabel="known angle (deg)", ylabel="decoded angle (deg)", title="simulated")
    axes.legend()
    return figure


def network_of_guides(example: Example) -> Figure:
    """Draw the rays of each emitter."""
    return figure_of(example.result)


def soft_body(example: Example) -> Figure:
    """Draw the strain, the forces and the light."""
    return figure_of(example.result)


DRAWINGS = {
    draw.__name__: draw
    for draw in (
        *(paper_sensor, three_wavelengths, straight_response, wrong_index, sweep_a_parameter, sensitivity, slab),
        *(own_outline, own_curve_scene, solid, as_printed, which_route, characterise_resin, working_curve),
        *(ambient_light, coupon_steps, fingertip, tolerance_run, two_spectra, decode_angles),
        *(network_of_guides, soft_body),
    )
}
"""Functions that draw the image of an example, keyed by example; `tools.pictures` draws three others."""
RASTER = {"network_of_guides", "soft_body", "own_outline", "own_curve_scene", "fingertip", "as_printed"}
"""Images whose PNG files are smaller than their SVG files."""


def file_of(name: str) -> Path:
    """Return the path of the image of an example."""
    return IMAGES / f"{name}{'.png' if name in RASTER else '.svg'}"


def values_of(figure: Figure) -> list[float]:
    """Return the sum of the coordinates of each element of a figure, which does not depend on fonts and sizes."""
    drawn_points = [
        points
        for axes in figure.axes
        for points in (
            *(line.get_xydata() for line in axes.lines),
            *(patch.get_patch_transform().transform(patch.get_path().vertices) for patch in axes.patches),
            *(path.vertices for collection in axes.collections for path in collection.get_paths()),
        )
    ]
    return [float(f"{np.nansum(np.abs(np.asarray(points, float))):.6g}") for points in drawn_points]


def main() -> None:
    """Draw all images, and write their checksums and sums to the record."""
    IMAGES.mkdir(exist_ok=True)
    record = {}
    for name, draw in DRAWINGS.items():
        example, image = run(name), file_of(name)
        image.write_bytes(encoded(drawn(partial(draw, example)), image.suffix, name, 90))
        sums = values_of(draw(example))
        record[name] = {"sha256": sha256(image.read_bytes()).hexdigest(), "values": [len(sums), sum(sums)]}
    RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
