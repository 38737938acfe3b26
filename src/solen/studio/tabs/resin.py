"""The resin tab: properties of a resin from spectra, discs and guides, and the resin file."""

from pathlib import Path

from solen.material.evaluations import evaluations
from solen.recording import read
from solen.studio.page_commands import PageCommand

_RESULTS = {
    "index": "the index",
    "cutback": "the loss of guides",
    "cure": "the working curve",
    "stiffness": "the stiffness",
    "penetration": "the penetration depth",
    "refractometer": "a refractometer",
}

COMMANDS = (
    PageCommand(
        "resin index",
        "solen.pipeline.resin.index:index",
        "Index of a layer",
        files={"file": "Spectra of a layer: T, and R if measured"},
        outputs={"out": "index.json"},
        first=("thickness_um", "u_thickness_um", "baseline", "substrate", "at_nm"),
    ),
    PageCommand(
        "resin cure",
        "solen.pipeline.resin.cure:cure",
        "Working curve",
        files={"files": "Tables of cured discs: thickness, and dose or time"},
        results={"penetration": "Result of the penetration depth"},
        outputs={"out": "cure.json"},
        first=("irradiance_mW_per_cm2", "layer_um", "exposure_s"),
    ),
    PageCommand(
        "resin cutback",
        "solen.pipeline.resin.cutback:cutback",
        "Loss of guides",
        files={"file": "Table of guides: length and power"},
        outputs={"out": "cutback.json"},
        first=("launched", "dark", "wavelength_nm"),
    ),
    PageCommand(
        "resin penetration",
        "solen.pipeline.resin.penetration:penetration",
        "Penetration depth",
        files={"file": "Absorbance of the liquid resin"},
        outputs={"out": "penetration.json"},
        first=("path_um", "led_nm", "led_fwhm_nm"),
    ),
    PageCommand(
        "resin exposures",
        "solen.pipeline.resin.exposures:exposures",
        "Layers with different exposures",
        files={"files": "Spectra of layers with different exposures"},
        outputs={"out": "exposures.json"},
        first=("wavelength_nm", "thickness_um"),
    ),
    PageCommand(
        "resin stiffness",
        "solen.pipeline.resin.stiffness:stiffness",
        "Stiffness",
        files={"files": "Exports of a testing machine"},
        outputs={"out": "stiffness.json"},
        first=("cube_mm", "length_mm", "area_mm2", "mode"),
    ),
    PageCommand(
        "resin spectra",
        "solen.pipeline.resin.spectra:spectra",
        "List of spectra",
        files={"files": "Spectra"},
        first=("trace",),
    ),
    PageCommand(
        "resin build",
        "solen.pipeline.resin.library:build",
        "Save a resin",
        results={name: f"Result of {words}" for name, words in _RESULTS.items()},
        design_outputs={"out": "{name}.toml"},
        first=("name", "formulation", "source"),
    ),
    PageCommand("resin show", "solen.pipeline.resin.library:show", "Show a resin", first=("name", "at_nm")),
)


def suitable_commands(path: Path) -> tuple[str, ...]:
    """Return the resin commands that accept a file."""
    return tuple(f"resin {name}" for name in evaluations(read(path)))
