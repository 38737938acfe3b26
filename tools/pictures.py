"""Draw the pictures of the documentation that no command draws: ``python tools/pictures.py``."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from examples.four_motions import MOTIONS
from solen.report.canvas import encoded
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


def main() -> None:
    """Draw them all."""
    (IMAGES / "four-motions.svg").write_bytes(encoded(four_motions(), ".svg", "four motions"))


if __name__ == "__main__":
    main()
