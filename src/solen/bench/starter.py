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
}
"""Files to start from, and what is shipped as each."""
CHIP_MM = 0.2
"""Width of the chip in the shipped rigs' designs: a point emitter's response saturates within a degree."""
DESIGNS: dict[str, dict[str, Any]] = {
    "sensor": {"emitter.width_mm": CHIP_MM},
    "sensor-bending": {"emitter.width_mm": CHIP_MM, "motion.kind": "bend"},
}
"""Designs of the shipped rigs: what differs from the template."""


def starter_files() -> dict[str, str]:
    """Protocols, rigs and designs to start from, by the name of the file without its ending."""
    folder = resources("solen.bench") / "examples"
    texts = {name: (folder / f"{shipped}.toml").read_text(encoding="utf-8") for name, shipped in SHIPPED.items()}
    designs = {name: dumps(with_values(loads(template("paper-860")), values)) for name, values in DESIGNS.items()}
    return texts | designs
