"""Measurements that the paper shows but does not publish, simulated as tables that the commands read.

Each table is computed with solen's measurement model, with noise from a fixed seed; its first line states this. Values
that the paper does not report are assumed, and defined as constants here; they are not results.

`SAMPLES` contains a `Sample` for each file: a description of its model, and its text. `write_samples` writes files.
"""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tomli_w

from solen import files
from solen.arrays import FloatArray
from solen.bench.starter import starter_files
from solen.fabricate.process.process_file import default_process
from solen.material.cure.layers import cure_depth_um
from solen.material.index import forward
from solen.material.resin import library_resin
from solen.material.stiffness.models import KINDS as MODELS
from solen.material.stiffness.modes import UNIAXIAL

SEED = 1
WAVELENGTHS_NM = np.arange(400.0, 901.0, 4.0)
RESIN, LAYER_UM, EXTINCTION = "loctite-3526", 25.0, 1e-5
"""The shipped resin closest to a printing resin, layer thickness in the paper, and assumed extinction coefficient."""
NOISE = 5e-4
"""Assumed standard deviation of T and R, which the commands use as their uncertainty."""
KINDS = ("pristine", "modified")
EXTINCTIONS = {"pristine": 6e-5, "modified": 2e-5}
MODULUS_MPA = {"pristine": 1.9, "modified": 1.1}
DP_FACTOR, EC_FACTOR = 0.9, 1.3
"""Assumed penetration depth and critical dose of the pristine resin, as multiples of the default process values."""
EXPOSURES_S, EXTINCTION_PER_S = (2.0, 4.0, 6.0), 1e-5
"""The exposures of the paper, and the assumed increase in extinction per second."""
DISC_SCATTER, CUBE_SCATTER = 0.03, 0.04
CUBE_MM = 10.0
REPEATS = 3


@dataclass(frozen=True)
class Sample:
    """A simulated file: a description of its model, and a function that computes its text."""

    model: str
    text: Callable[[], str]


def index_of(nm: FloatArray | float) -> FloatArray:
    """Return the index of the simulated layer."""
    return np.asarray(library_resin(RESIN).index.indices(nm)[0], dtype=float)


def _table(model: str, header: str, *columns: FloatArray) -> str:
    rows = (",".join(f"{value:.6g}" for value in row) for row in np.column_stack(columns))
    return "\n".join((f"# simulated: {model}, seed {SEED}", header, *rows)) + "\n"


def _spectra(model: str, extinction: float, number: int) -> str:
    """Return a table of T and R of a layer in air."""
    rng = np.random.default_rng([SEED, number])
    r, t = forward(index_of(WAVELENGTHS_NM), extinction, LAYER_UM, WAVELENGTHS_NM)
    noise = NOISE * rng.standard_normal((2, WAVELENGTHS_NM.size))
    return _table(model, "wavelength_nm,T,R", WAVELENGTHS_NM, t + noise[0], r + noise[1])


def _exposures(model: str) -> str:
    rng = np.random.default_rng([SEED, 3])
    s, nm = (grid.ravel() for grid in np.meshgrid(EXPOSURES_S, WAVELENGTHS_NM, indexing="ij"))
    _, t = forward(index_of(nm), EXTINCTION + EXTINCTION_PER_S * s, LAYER_UM, nm)
    return _table(model, "exposure_s,wavelength_nm,T", s, nm, t + NOISE * rng.standard_normal(nm.size))


def _discs(model: str, kind: str) -> str:
    """Return a table of thicknesses of cured discs against dose."""
    settings = default_process().process
    dp, ec = settings.Dp_um, settings.Ec_mJ_per_cm2
    if kind == "pristine":
        dp, ec = DP_FACTOR * dp, EC_FACTOR * ec
    dose = np.repeat(settings.irradiance_mW_per_cm2 * np.arange(1.0, 7.0), REPEATS)
    scatter = np.random.default_rng([SEED, 4, KINDS.index(kind)]).standard_normal(dose.size)
    um = cure_depth_um(dose, dp, ec) * (1.0 + DISC_SCATTER * scatter)
    return _table(model, "dose_mJ_per_cm2,thickness_um", dose, um)


def _cube(model: str, kind: str, number: int) -> str:
    """Return a table of the force on a compressed cube, a neo-Hookean solid."""
    rng = np.random.default_rng([SEED, 5, KINDS.index(kind), number])
    stretch = 1.0 - np.linspace(0.0, 0.3, 61)
    modulus = MODULUS_MPA[kind] * (1.0 + CUBE_SCATTER * rng.standard_normal())
    model_of = MODELS["neo-hookean"]
    stress = model_of.stress(np.array([modulus / 6.0]), UNIAXIAL, stretch)
    return _table(model, "displacement_mm,force_N", CUBE_MM * (1.0 - stretch), -(CUBE_MM**2) * stress)


def _protocol() -> str:
    """Return the shipped rotation test without its slow cycles, which are not in the paper."""
    data = tomllib.loads(starter_files()["rotation"])
    return tomli_w.dumps(data | {"slow_cycles": 0})


def _sample(model: str, make: Callable[..., str], *arguments: str | float) -> Sample:
    return Sample(model, partial(make, model, *arguments))


_SLAB_MODEL = f"incoherent slab of {LAYER_UM:g} µm with the index of {RESIN}"
_EXTINCTION_TEXT = ", ".join(f"k = {k:g} ({kind})" for kind, k in EXTINCTIONS.items())
SAMPLES: dict[str, Sample] = {
    "layer.csv": _sample(f"{_SLAB_MODEL}, k = {EXTINCTION:g}", _spectra, EXTINCTION, 0),
    "exposures.csv": _sample(f"{_SLAB_MODEL}, k increasing with exposure", _exposures),
    "rotation.toml": Sample("", _protocol),
    "rig.toml": Sample("", lambda: starter_files()["rig"]),
    "sensor.toml": Sample("", lambda: starter_files()["sensor"]),
}
for _number, _kind in enumerate(KINDS):
    SAMPLES[f"{_kind}.csv"] = _sample(f"{_SLAB_MODEL}, {_EXTINCTION_TEXT}", _spectra, EXTINCTIONS[_kind], 1 + _number)
    SAMPLES[f"discs/{_kind}.csv"] = _sample("Jacobs' working curve with an assumed Dp and Ec", _discs, _kind)
    for _cube_number in range(1, REPEATS + 1):
        SAMPLES[f"cubes/{_kind}-{_cube_number}.csv"] = _sample(
            "neo-Hookean cube of an assumed modulus", _cube, _kind, _cube_number
        )


def write_samples(folder: Path, *names: str) -> list[Path]:
    """Write the named samples into a folder; return their paths in the same order."""
    targets = [folder / name for name in names]
    for target in targets:
        target.parent.mkdir(parents=True, exist_ok=True)
    return files.write_all({target: SAMPLES[name].text().encode() for target, name in zip(targets, names, strict=True)})


def mark_of(name: str) -> str:
    """Return the note for a figure that shows a sample."""
    return f"SIMULATED: {SAMPLES[name].model}; seed {SEED}"
