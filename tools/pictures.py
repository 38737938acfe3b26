"""Draw the pictures of the documentation that no command draws: ``python tools/pictures.py``."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from examples.four_motions import MOTIONS
from examples.index_of_a_layer import INDEX, THICKNESS_UM, WAVELENGTH_NM, U, routes
from solen.material.index import Length, forward, measured, reading
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


def main() -> None:
    """Draw them all."""
    (IMAGES / "index-routes.svg").write_bytes(encoded(index_routes(), ".svg", "index routes"))
    (IMAGES / "index-figure.svg").write_bytes(encoded(index_command(), ".svg", "index figure"))
    (IMAGES / "four-motions.svg").write_bytes(encoded(four_motions(), ".svg", "four motions"))


if __name__ == "__main__":
    main()
