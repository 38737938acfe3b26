"""Draw the images of the documentation that are not figures of commands: ``python -m tools.pictures``."""

import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image as Pillow
from skimage import data

from examples.coins import circle
from examples.coins import edges as coin_edges
from examples.four_motions import MOTIONS
from examples.index_of_a_layer import INDEX, THICKNESS_UM, WAVELENGTH_NM, U, routes
from solen.analysis.demodulation import DemodulationOptions, demodulated
from solen.lens import LayeredLens, LineFocusLens
from solen.material.index import forward
from solen.material.index.layer import index_of_layer
from solen.material.index.options import IndexOptions
from solen.material.index.stack import Setup, Substrate, on_substrate
from solen.material.index.substrate import invert_on_substrate
from solen.readout import circuit_of, lagged, volts
from solen.recording import Channel, Provenance, Recording
from solen.report.bench.demodulate import demodulation_figure
from solen.report.canvas import INK, LEFT, LINES, LOST, RIGHT, drawn, encoded, series
from solen.report.design.loaded import deformation_figure
from solen.report.design.readout import readout_figure
from solen.report.resin.index import index_figure
from solen.sensor import Sensor
from solen.sensor.loaded import deform
from solen.sensor.readings import design_readings
from solen.spec import loads, template, with_values
from tools.wiring import wiring

IMAGES = Path(__file__).parent.parent / "docs" / "images"
ANGLES_DEG = np.linspace(-3.0, 3.0, 49)
CHIP_WIDTHS_MM = {"point emitter": 0.0, "chip 0.2 mm wide": 0.2}


def four_motions() -> Figure:
    """Draw the contrast against angle for the four motions, with a point emitter and with a chip."""
    figure = Figure(figsize=(8.0, 3.4))
    panels = figure.subplots(1, 2, sharey=True)
    design = loads(template("paper-860"))
    for axes, (title, width_mm) in zip(panels, CHIP_WIDTHS_MM.items(), strict=True):
        for number, (name, values) in enumerate(MOTIONS.items()):
            sensor = Sensor.of(with_values(design, {"emitter.width_mm": width_mm, **values}))
            axes.plot(ANGLES_DEG, sensor.power(ANGLES_DEG.tolist()).contrast, **series(number), label=name)
        axes.set(title=f"simulated, {title}", xlabel="angle / °")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("contrast (R − L)/(R + L)")
    panels[1].legend(fontsize="small")
    return figure


def index_routes() -> Figure:
    """Draw the index of a simulated layer determined by three methods, and its true index."""
    figure = Figure(figsize=(8.0, 3.6))
    axes = figure.add_subplot()
    colours = {"R and T measured": RIGHT, "T alone, lossless": LOST, "as published": LEFT}
    for name, spectrum in routes().items():
        if name in colours:
            dashes = LINES[list(colours).index(name)]
            label = name if spectrum.measurement else f"{name}: not a measurement"
            axes.plot(WAVELENGTH_NM, spectrum.n.value, color=colours[name], ls=dashes, lw=1.0, label=label)
    axes.plot(WAVELENGTH_NM, INDEX, color=INK, lw=1.8, label="true index")
    axes.set(title="simulated, noise of 0.1 % in T and R", xlabel="wavelength (nm)", ylabel="refractive index n")
    axes.legend(fontsize="small", loc="center right")
    axes.grid(alpha=0.3)
    return figure


def index_command() -> Figure:
    """Draw the figure of ``solen resin index --figure`` for a simulated layer with a partly wrong reflectance."""
    rng = np.random.default_rng(2)
    nm = np.arange(400.0, 901.0, 2.0)
    loss = 2e-6 + 4e-5 * np.exp(-(nm - 380.0) / 25.0)
    r, t = (value + rng.normal(0.0, U, nm.size) for value in forward(1.482 + 5e3 / nm**2, loss, THICKNESS_UM, nm))
    r[(nm > 640.0) & (nm < 672.0)] -= 0.09
    columns = {"transmittance": t, "reflectance": r}
    channels = [Channel(name, name, "1", values, "nm") for name, values in columns.items()]
    recording = Recording((Channel("nm", "wavelength", "nm", nm), *channels), Provenance(simulated=True))
    options = IndexOptions(thickness_um=THICKNESS_UM, u_thickness_um=1.0, u_T=U, u_R=U)
    return index_figure(index_of_layer(recording, options))


def two_indices() -> Figure:
    """Draw T and R of a clear layer on PET against its index, and the two indices with the same T and R."""
    figure = Figure(figsize=(8.0, 3.2))
    setup, n = Setup(Substrate(1.57, 0.0, 100.0)), np.linspace(1.0, 1.8, 161)
    curves = on_substrate(n, 0.0, 25.0, 589.3, setup)
    measured = on_substrate(1.49, 0.0, 25.0, 589.3, setup)
    other_n = invert_on_substrate(measured.T, measured.R, 589.3, 25.0, setup).other_n[0]
    solutions = ((1.49, "n = 1.49"), (other_n, f"n = {other_n:.2f}, same T and R"))
    panels, names = figure.subplots(1, 2), ("T relative to the bare film", "R")
    for axes, curve, value, name in zip(panels, curves, measured, names, strict=True):
        axes.plot(n, curve, color=INK, lw=1.6)
        axes.axhline(float(value), color=LOST, lw=0.8, ls="--")
        for number, (solution, label) in enumerate(solutions):
            axes.plot([solution], [float(value)], **series(number, dots=True), label=label)
        axes.set(xlabel="index of the layer", ylabel=name)
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", loc="lower center" if name[0] == "T" else "upper center")
    figure.suptitle("simulated: a clear layer on PET, n = 1.57", fontsize="medium")
    return figure


def coins() -> Figure:
    """Draw the outlines measured by ``examples/coins.py``, coloured by their deviation from a circle."""
    figure = Figure(figsize=(6.4, 4.6))
    axes = figure.add_subplot()
    photograph = data.coins()
    axes.imshow(photograph, cmap="gray")
    points = None
    for edge in coin_edges(photograph / 255.0):
        x, y, diameter, _ = circle(edge)
        px = edge.points_px[edge.kept]
        deviation = np.hypot(px[:, 0] - x, px[:, 1] - y) - 0.5 * diameter
        points = axes.scatter(px[:, 0], px[:, 1], c=deviation, s=1.5, cmap="coolwarm", vmin=-2.0, vmax=2.0)
        axes.text(x, y, f"{diameter:.2f}", color="white", fontsize=6, ha="center", va="center")
    if points is not None:
        figure.colorbar(points, ax=axes, label="deviation from a circle (px)", shrink=0.8)
    axes.set_axis_off()
    return figure


READOUT = {"emitter.width_mm": 0.2, "readout.emitter_current_ma": 2.0, "readout.load_ohm": 1500.0}


def readout_picture() -> Figure:
    """Draw the figure of ``solen readout --figure`` for the sensor of the paper with a chip."""
    design = with_values(loads(template("paper-860")), READOUT)
    return readout_figure(design_readings(Sensor.of(design)))


def ambient_light() -> Figure:
    """Draw the figure of ``solen bench demodulate`` for a waveform in ambient light with flicker and a step."""
    rng = np.random.default_rng(4)
    circuit = circuit_of(with_values(loads(template("paper-860")), READOUT), {"right": 12.0, "left": 12.0})
    time = np.arange(40_000) / 10_000.0
    swing = np.tanh(2.0 * np.sin(np.pi * time))[:, None] * np.array([1.0, -1.0])
    on = (time * 200.0 * (1.0 + 50e-6) - 0.3) % 1.0 < 0.5
    ambient = 0.6 + 0.15 * np.cos(2.0 * np.pi * 100.0 * time) + 0.4 * (time > 2.6)
    voltage = lagged(volts(0.25 * (1.0 + swing) * on[:, None], circuit, ambient), circuit, 10_000.0)
    readings = circuit.adc.read(voltage + rng.normal(0.0, circuit.adc.noise_V, voltage.shape))
    columns = {"time": ("s", time)} | {
        name: ("V", values) for name, values in zip(circuit.names, readings.T, strict=True)
    }
    channels = tuple(Channel(name, "", unit, values) for name, (unit, values) in columns.items())
    recording = Recording(channels, Provenance("on and off at 200 Hz", simulated=True))
    return demodulation_figure(demodulated(recording, DemodulationOptions(rate_hz=200.0, mains_hz=50.0)))


def lens_in_space() -> Figure:
    """Draw the faces of both lenses for skew rays, the layered one with visibly thick layers, and their profiles."""
    paper = {"distance_mm": 1.0, "focus_mm": 20.0, "half_width_mm": 2.0, "design_index": 1.44}
    smooth, coarse = LineFocusLens(**paper, y_focus_mm=2.0), LayeredLens(**paper, layer_mm=0.5)
    layered = LayeredLens(**paper)
    figure = Figure(figsize=(10.4, 3.6))
    x = np.linspace(-2.0, 2.0, 41)
    edges = np.repeat(coarse.edges_mm, 2)[1:-1]
    middles = np.repeat(coarse.middles_mm, 2)
    lenses = (("line-focus", smooth, x, x), ("layered, slabs of 0.5 mm", coarse, edges, middles))
    for number, (title, lens, y_drawn, y_evaluated) in enumerate(lenses, start=1):
        axes = figure.add_subplot(1, 3, number, projection="3d")
        x_grid, y_grid = np.meshgrid(x, y_drawn)
        z = lens.z_at(x_grid, np.meshgrid(x, y_evaluated)[1])
        axes.plot_surface(x_grid, y_grid, -z, color=RIGHT, edgecolor=INK, linewidth=0.15, rstride=1, cstride=1)
        axes.set(xlabel="x (mm)", ylabel="y (mm)", zticks=[], title=title)
        axes.set_box_aspect((2.0, 2.0, 0.9))
        axes.view_init(elev=38.0, azim=-52.0)
    profiles = figure.add_subplot(1, 3, 3)
    for number, y in enumerate((0.0, 1.0, 2.0)):
        y_values = np.full_like(x, y)
        profiles.plot(x, layered.z_at(x, y_values), **series(number), lw=1.6, label=f"layered, y = {y:g} mm")
        label = "line-focus, same sections" if number == 2 else None
        profiles.plot(x, smooth.z_at(x, y_values), color=LOST, lw=0.8, label=label)
    profiles.set(xlabel="x (mm)", ylabel="z (mm)", title="sections", ylim=(-0.1, 3.2))
    profiles.legend(fontsize="small", loc="upper center")
    return figure


def soft_body() -> Figure:
    """Draw the strain, forces and light of the shipped press at 0.3 N."""
    return deformation_figure(deform(Sensor.of(loads(template("press-860"))), 0.3))


def main() -> None:
    """Draw all images."""
    photograph = io.BytesIO(encoded(drawn(coins), ".png", "coins"))  # saved as JPEG: the PNG has 700 kB
    with Pillow.open(photograph) as image:
        image.convert("RGB").save(IMAGES / "coins.jpg", quality=80)
    (IMAGES / "two-indices.svg").write_bytes(encoded(drawn(two_indices), ".svg", "two indices"))
    (IMAGES / "index-routes.svg").write_bytes(encoded(drawn(index_routes), ".svg", "index routes"))
    (IMAGES / "index-figure.svg").write_bytes(encoded(drawn(index_command), ".svg", "index figure"))
    (IMAGES / "readout.svg").write_bytes(encoded(drawn(readout_picture), ".svg", "readout"))
    (IMAGES / "ambient-light.svg").write_bytes(encoded(drawn(ambient_light), ".svg", "ambient light"))
    (IMAGES / "board-wiring.svg").write_bytes(encoded(drawn(wiring), ".svg", "board wiring"))
    (IMAGES / "lens-in-space.png").write_bytes(encoded(drawn(lens_in_space), ".png", "lens in space"))
    (IMAGES / "soft-body.png").write_bytes(encoded(drawn(soft_body), ".png", "soft body", 130))
    (IMAGES / "four-motions.svg").write_bytes(encoded(drawn(four_motions), ".svg", "four motions"))


if __name__ == "__main__":
    main()
