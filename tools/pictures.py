"""Draw the pictures of the documentation that no command draws: ``python tools/pictures.py``."""

import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image as Pillow
from skimage import data

from examples.coins import circle
from examples.coins import edges as found_coins
from examples.four_motions import MOTIONS
from examples.index_of_a_layer import INDEX, THICKNESS_UM, WAVELENGTH_NM, U, routes
from solen.material.index import Length, forward, measured, reading
from solen.material.index.stack import Substrate, on_substrate
from solen.material.index.substrate import invert
from solen.pipeline.index import arrays
from solen.pipeline.indexfit import described, fitted, literature
from solen.report.canvas import INK, LEFT, LOST, RIGHT, encoded
from solen.report.index import index_figure
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

IMAGES = Path(__file__).parent.parent / "docs" / "images"
ANGLES_DEG = np.linspace(-3.0, 3.0, 49)
CHIPS = {"point emitter": 0.0, "chip 0.2 mm wide": 0.2}


def four_motions() -> Figure:
    """Contrast over angle of the four motions, under a point emitter and under a chip."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    design = loads(template("solen-860"))
    for axes, (title, width_mm) in zip(panels, CHIPS.items(), strict=True):
        for name, values in MOTIONS.items():
            sensor = Sensor.of(with_values(design, {"emitter.width_mm": width_mm, **values}))
            axes.plot(ANGLES_DEG, sensor.power(ANGLES_DEG.tolist()).contrast, label=name)
        axes.set(title=f"simulated, {title}", xlabel="angle / °")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("contrast (R − L)/(R + L)")
    panels[1].legend(fontsize="small")
    return figure


def index_routes() -> Figure:
    """Index of a simulated layer by four routes, beside its own."""
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.add_subplot()
    colours = {"R and T measured": RIGHT, "T alone, lossless": LOST, "as published": LEFT}
    for name, spectrum in routes().items():
        if name in colours:
            told = name if spectrum.measurement else f"{name}: no measurement"
            axes.plot(WAVELENGTH_NM, spectrum.n.value, color=colours[name], lw=1.0, label=told)
    axes.plot(WAVELENGTH_NM, INDEX, color=INK, lw=1.8, label="the layer's own")
    axes.set(title="simulated, 0.1 % of noise in T and R", xlabel="wavelength (nm)", ylabel="refractive index n")
    axes.legend(fontsize="small", loc="center right")
    axes.grid(alpha=0.3)
    return figure


def index_command() -> Figure:
    """What ``solen index --figure`` draws, for a simulated layer with a reflectance that was spoilt in part."""
    rng = np.random.default_rng(2)
    nm = np.arange(400.0, 901.0, 2.0)
    loss = 2e-6 + 4e-5 * np.exp(-(nm - 380.0) / 25.0)
    r, t = (value + rng.normal(0.0, U, nm.size) for value in forward(1.482 + 5e3 / nm**2, loss, THICKNESS_UM, nm))
    r[(nm > 640.0) & (nm < 672.0)] -= 0.09
    found = measured(nm, reading(t, U), reading(r, U), Length(THICKNESS_UM, 1.0))
    model, known = fitted("cauchy", found), literature(found, (), "table")[0]
    told = {"mode": found.mode, "measurement": True, "baseline": "air", "substrate": None, "literature": known}
    told |= (
        {"fit": described(model, found, [], None), "sources": [{"simulated": True}]}
        if not isinstance(model, str | None)
        else {}
    )
    return index_figure(arrays(found) | told)


def two_indices() -> Figure:
    """T and R of a clear layer on PET against the layer's index, and the two that read the same."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    sheet, n = Substrate(1.57, 0.0, 100.0), np.linspace(1.0, 1.8, 161)
    read = on_substrate(n, 0.0, 25.0, 589.3, sheet)
    seen = on_substrate(1.49, 0.0, 25.0, 589.3, sheet)
    other = invert(seen.T, seen.R, 589.3, 25.0, sheet).other_n[0]
    for axes, values, one, name in zip(
        figure.subplots(1, 2), read, seen, ("T against the bare sheet", "R"), strict=True
    ):
        axes.plot(n, values, color=INK, lw=1.6)
        axes.axhline(float(one), color=LOST, lw=0.8, ls="--")
        for at, colour, label in ((1.49, RIGHT, "n = 1.49"), (other, LEFT, f"n = {other:.2f} reads the same")):
            axes.plot([at], [float(one)], "o", color=colour, label=label)
        axes.set(xlabel="index of the layer", ylabel=name)
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", loc="lower center" if name[0] == "T" else "upper center")
    figure.suptitle("simulated: a clear layer on PET, n = 1.57", fontsize="medium")
    return figure


def coins() -> Figure:
    """The outlines that ``examples/coins.py`` measures, on the photograph, coloured by their distance from a circle."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.add_subplot()
    photograph = data.coins()
    axes.imshow(photograph, cmap="gray")
    shown = None
    for edge in found_coins(photograph / 255.0):
        x, y, diameter, _ = circle(edge)
        at = edge.points_px[edge.kept]
        off = np.hypot(at[:, 0] - x, at[:, 1] - y) - 0.5 * diameter
        shown = axes.scatter(*at.T, c=off, s=1.5, cmap="coolwarm", vmin=-2.0, vmax=2.0)
        axes.text(x, y, f"{diameter:.2f}", color="white", fontsize=6, ha="center", va="center")
    if shown is not None:
        figure.colorbar(shown, ax=axes, label="out of the circle (px)", shrink=0.8)
    axes.set_axis_off()
    return figure


def main() -> None:
    """Draw them all."""
    with Pillow.open(io.BytesIO(encoded(coins(), ".png", "coins"))) as drawn:  # a photograph: a PNG would have 700 kB
        drawn.convert("RGB").save(IMAGES / "coins.jpg", quality=80)
    (IMAGES / "two-indices.svg").write_bytes(encoded(two_indices(), ".svg", "two indices"))
    (IMAGES / "index-routes.svg").write_bytes(encoded(index_routes(), ".svg", "index routes"))
    (IMAGES / "index-figure.svg").write_bytes(encoded(index_command(), ".svg", "index figure"))
    (IMAGES / "four-motions.svg").write_bytes(encoded(four_motions(), ".svg", "four motions"))


if __name__ == "__main__":
    main()
