"""Files to start from: protocols, simulated rigs with their designs, and files for a network's own design."""

from importlib.resources import files as resources
from typing import Any

import numpy as np

from solen.errors import SpecError
from solen.spec import Design, loads, template, with_values
from solen.spec.network import Network
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
"""Files to start from, and the shipped source of each."""
CHIP_MM = 0.2
"""Width of the chip in mm in the shipped rigs' designs: the response of a point emitter saturates within a degree."""
DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "sensor": ("paper-860", {"emitter.width_mm": CHIP_MM}),
    "sensor-bending": ("paper-860", {"emitter.width_mm": CHIP_MM, "motion.kind": "bend"}),
    "sensor-press": ("press-860", {"emitter.width_mm": CHIP_MM}),
}
"""Designs of the shipped rigs: their templates, and the values that differ from these."""


def starter_files() -> dict[str, str]:
    """Return protocols, rigs and designs to start from, by the name of the file without its extension."""
    folder = resources("solen.bench") / "examples"
    texts = {name: (folder / f"{shipped}.toml").read_text(encoding="utf-8") for name, shipped in SHIPPED.items()}
    designs = {name: dumps(with_values(loads(template(one)), values)) for name, (one, values) in DESIGNS.items()}
    return texts | designs


MAX_STATES, SCATTER, VISITS = 25, 200, 12
"""Largest number of combinations of positions in a plan for a calibration; states scattered between them; states of a
second plan.
"""
_RIG = """# A simulated rig for {name}: emitters of the board and its inputs by the design's names, a stage for each
# motion.
schema = 1
name = "rig of {name}"
seed = 1

{stages}
[board]
rate_hz = 200.0
trim_v = 1.0    # voltage to which each receiver's trimmer sets its brightest reading

[[sensor]]
name = "network"
design = "{file}"
emitters = {{{emitters}}}
inputs = {{{inputs}}}

[spread]
parts = true    # receivers and emitters vary within the tolerances of their datasheets

[ambient]
mean_mw_cm2 = 0.02
flicker_percent = 30.0
flicker_hz = 100.0
"""
_PLAN = """# States for a calibration, held long enough to be averaged: every combination of some positions,
# and many that are scattered between them, which show what a grid alone would miss.
schema = 1
name = "states"

[grid]
scatter = {scatter}
velocity_deg_per_s = 15.0
hold_s = 0.3

[grid.to_deg]
{places}
"""
_VISITS = """# States drawn at random, with which a calibration can be compared.
schema = 1
name = "visits"

{steps}
"""
_STEP = """[[step]]
to_deg = {{{to}}}
velocity_deg_per_s = 15.0
hold_s = 0.3
"""


def network_files(design: Design, file: str) -> dict[str, str]:
    """Return a simulated rig of a network, a plan for its calibration and one to check it; ``file`` names the design.

    Raises `SpecError` if the design is not a network, or has no motion.
    """
    network = design.network
    if design.body.kind != "network":
        limit = "is not a network, whose rig has a stage for each motion"
        raise SpecError("body.kind", value=design.body.kind, limit=limit, remedy="leave --design out")
    if not network.motion:
        raise SpecError("network.motion", limit="missing: nothing moves", remedy="add [[network.motion]]")
    wired = {key: _numbered([one.name for one in getattr(network, key)]) for key in ("emitters", "receivers")}
    stages = "".join(f"[stages.{motion.name}]\n" for motion in network.motion)
    rig = {"name": design.name.replace('"', "'"), "file": file, "stages": stages}
    return {
        "rig": _RIG.format(**rig, emitters=wired["emitters"], inputs=wired["receivers"]),
        "states": _PLAN.format(places="\n".join(_places(network)), scatter=SCATTER * (1 + len(network.motion)) // 3),
        "visits": _VISITS.format(steps="\n".join(_visits(network))),
    }


def _numbered(names: list[str]) -> str:
    return ", ".join(f"{name} = {number}" for number, name in enumerate(names, 1))


def _places(network: Network) -> list[str]:
    """Return positions of each motion over its range, both ends included, with a limited number of combinations."""
    most = max(2, int(MAX_STATES ** (1.0 / len(network.motion)) + 1e-9))
    rows = []
    for motion in network.motion:
        places = np.linspace(motion.from_deg, motion.to_deg, min(motion.steps + 1, most))
        rows.append(f"{motion.name} = [{', '.join(f'{place:.6g}' for place in places.tolist())}]")
    return rows


def _visits(network: Network) -> list[str]:
    rng = np.random.default_rng(1)
    low, high = np.array([(motion.from_deg, motion.to_deg) for motion in network.motion]).T
    states = np.round(rng.uniform(low, high, (VISITS, len(network.motion))), 3).tolist()
    names = [motion.name for motion in network.motion]
    rows = (", ".join(f"{name} = {place:g}" for name, place in zip(names, state, strict=True)) for state in states)
    return [_STEP.format(to=row) for row in rows]
