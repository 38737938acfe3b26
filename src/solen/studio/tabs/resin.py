"""The resin tab: converts spectra, discs and guides into resin properties and a resin file."""

from pathlib import Path

from solen.material.evaluations import evaluations
from solen.recording import read
from solen.studio.offers import Offer

_RESULTS = {
    "index": "the index",
    "cutback": "the loss of guides",
    "cure": "the working curve",
    "stiffness": "the stiffness",
    "penetration": "the penetration depth",
    "refractometer": "a refractometer",
}

OFFERS = (
    Offer(
        "resin index",
        "solen.pipeline.resin.index:index",
        "Index of a layer",
        files={"file": "Spectra of a layer: T, and R if measured"},
        written={"out": "index.json"},
        first=("thickness_um", "u_thickness_um", "baseline", "substrate", "at_nm"),
    ),
    Offer(
        "resin cure",
        "solen.pipeline.resin.cure:cure",
        "Working curve",
        files={"files": "Tables of cured discs: thickness, and dose or time"},
        results={"penetration": "Result of the penetration depth"},
        written={"out": "cure.json"},
        first=("irradiance_mW_per_cm2", "layer_um", "exposure_s"),
    ),
    Offer(
        "resin cutback",
        "solen.pipeline.resin.cutback:cutback",
        "Loss of guides",
        files={"file": "Table of guides: length and power"},
        written={"out": "cutback.json"},
        first=("launched", "dark", "wavelength_nm"),
    ),
    Offer(
        "resin penetration",
        "solen.pipeline.resin.penetration:penetration",
        "Penetration depth",
        files={"file": "Absorbance of the liquid resin"},
        written={"out": "penetration.json"},
        first=("path_um", "led_nm", "led_fwhm_nm"),
    ),
    Offer(
        "resin exposures",
        "solen.pipeline.resin.exposures:exposures",
        "Layers by exposure",
        files={"files": "Spectra of layers with different exposures"},
        written={"out": "exposures.json"},
        first=("wavelength_nm", "thickness_um"),
    ),
    Offer(
        "resin stiffness",
        "solen.pipeline.resin.stiffness:stiffness",
        "Stiffness",
        files={"files": "Exports of a testing machine"},
        written={"out": "stiffness.json"},
        first=("cube_mm", "length_mm", "area_mm2", "mode"),
    ),
    Offer(
        "resin spectra",
        "solen.pipeline.resin.spectra:spectra",
        "List of spectra",
        files={"files": "Spectra"},
        first=("trace",),
    ),
    Offer(
        "resin build",
        "solen.pipeline.resin.library:build",
        "Save a resin",
        results={name: f"Result of {words}" for name, words in _RESULTS.items()},
        beside={"out": "{name}.toml"},
        first=("name", "formulation", "source"),
    ),
    Offer("resin show", "solen.pipeline.resin.library:show", "Show a resin", first=("name", "at_nm")),
)


def commands_for(path: Path) -> tuple[str, ...]:
    """Return the resin evaluations that accept a file."""
    return tuple(f"resin {name}" for name in evaluations(read(path)))
