"""Files to start from: protocols and simulated rigs with their designs, and a rig and protocols for a network."""

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
"""Shipped source of each file to start from, keyed by its name."""
CHIP_MM = 0.2
"""Width of the chip in mm in the designs of the shipped rigs; with a point emitter the response saturates within a
degree.
"""
DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "sensor": ("paper-860", {"emitter.width_mm": CHIP_MM}),
    "sensor-bending": ("paper-860", {"emitter.width_mm": CHIP_MM, "motion.kind": "bend"}),
    "sensor-press": ("press-860", {"emitter.width_mm": CHIP_MM}),
}
"""Template of each design of the shipped rigs, and the values that differ from it, keyed by the name of the file."""


def starter_files() -> dict[str, str]:
    """Return protocols, rigs and designs to start from, keyed by the name of the file without its extension."""
    folder = resources("solen.bench") / "examples"
    texts = {name: (folder / f"{shipped}.toml").read_text(encoding="utf-8") for name, shipped in SHIPPED.items()}
    designs = {name: dumps(with_values(loads(template(base)), values)) for name, (base, values) in DESIGNS.items()}
    return texts | designs


MAX_COMBINATIONS, SCATTER, VISITS = 25, 200, 12
"""Largest number of combinations of positions in the protocol for a calibration, number of states scattered between
them, and number of states in the protocol that checks the calibration.
"""
_RIG = """# A simulated rig for {name}: the board's emitters and inputs, keyed by the names in the design, and
# a stage for each motion.
schema = 1
name = "rig of {name}"
seed = 1

{stages}
[board]
rate_hz = 200.0
trim_v = 1.0    # voltage to which the trimmer of each receiver sets its brightest reading

[[sensor]]
name = "network"
design = "{file}"
emitters = {{{emitters}}}
inputs = {{{inputs}}}

[spread]
parts = true    # receivers and emitters vary within the tolerances in their datasheets

[ambient]
mean_mw_cm2 = 0.02
flicker_percent = 30.0
flicker_hz = 100.0
"""
_STATES = """# States for a calibration, each held long enough for an average: every combination of some positions,
# and many states scattered between them, which show how the response varies between the positions.
schema = 1
name = "states"

[grid]
scatter = {scatter}
velocity_deg_per_s = 15.0
hold_s = 0.3

[grid.to_deg]
{positions}
"""
_VISITS = """# Random states, with which a calibration can be checked.
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
    """Return a simulated rig for a network, a protocol for its calibration and one for a check.

    ``file`` is the path of the design. Raises `SpecError` if the design is not a network, or has no motion.
    """
    network = design.network
    if design.body.kind != "network":
        limit = 'must be "network": --design writes a rig with a stage for each motion of a network'
        remedy = "omit --design to write rigs and protocols with their designs"
        raise SpecError("body.kind", value=design.body.kind, limit=limit, remedy=remedy)
    if not network.motion:
        raise SpecError("network.motion", limit="is missing: nothing moves", remedy="add [[network.motion]]")
    rig = _RIG.format(
        name=design.name.replace('"', "'"),
        file=file,
        stages="".join(f"[stages.{motion.name}]\n" for motion in network.motion),
        emitters=_numbered([emitter.name for emitter in network.emitters]),
        inputs=_numbered([receiver.name for receiver in network.receivers]),
    )
    positions, scatter = "\n".join(_positions(network)), SCATTER * (1 + len(network.motion)) // 3
    return {
        "rig": rig,
        "states": _STATES.format(positions=positions, scatter=scatter),
        "visits": _VISITS.format(steps="\n".join(_visits(network))),
    }


def _numbered(names: list[str]) -> str:
    return ", ".join(f"{name} = {number}" for number, name in enumerate(names, 1))


def _positions(network: Network) -> list[str]:
    """Return a line for each motion: positions over its range, both ends included, within `MAX_COMBINATIONS`."""
    most = max(2, int(MAX_COMBINATIONS ** (1.0 / len(network.motion)) + 1e-9))
    lines = []
    for motion in network.motion:
        positions = np.linspace(motion.from_deg, motion.to_deg, min(motion.steps + 1, most)).tolist()
        lines.append(f"{motion.name} = [{', '.join(f'{position:.6g}' for position in positions)}]")
    return lines


def _visits(network: Network) -> list[str]:
    rng = np.random.default_rng(1)
    low, high = np.array([(motion.from_deg, motion.to_deg) for motion in network.motion]).T
    states = np.round(rng.uniform(low, high, (VISITS, len(network.motion))), 3).tolist()
    names = [motion.name for motion in network.motion]
    targets = (", ".join(f"{name} = {angle:g}" for name, angle in zip(names, state, strict=True)) for state in states)
    return [_STEP.format(to=target) for target in targets]
