"""Files to start from: protocols, simulated rigs with their designs."""

from importlib.resources import files as resources
from typing import Any

from solen.spec import loads, template, with_values
from solen.spec.toml import dumps

SHIPPED = {
    "rotation": "rotation",
    "bending": "bending",
    "rig": "simulated",
    "rig-bending": "simulated-bending",
    "rig-daq": "simulated-daq",
    "press": "press",
    "rig-press": "simulated-press",
}
"""Files to start from, and what is shipped as each."""
CHIP_MM = 0.2
"""Width of the chip in the shipped rigs' designs: a point emitter's response saturates within a degree."""
DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "sensor": ("paper-860", {"emitter.width_mm": CHIP_MM}),
    "sensor-bending": ("paper-860", {"emitter.width_mm": CHIP_MM, "motion.kind": "bend"}),
    "sensor-press": ("press-860", {"emitter.width_mm": CHIP_MM}),
}
"""Designs of the shipped rigs: their templates, and what differs from these."""


def starter_files() -> dict[str, str]:
    """Protocols, rigs and designs to start from, by the name of the file without its ending."""
    folder = resources("solen.bench") / "examples"
    texts = {name: (folder / f"{shipped}.toml").read_text(encoding="utf-8") for name, shipped in SHIPPED.items()}
    designs = {name: dumps(with_values(loads(template(one)), values)) for name, (one, values) in DESIGNS.items()}
    return texts | designs
