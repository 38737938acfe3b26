"""Figures 2 and S1: spectra and index of a layer, stiffness, transparency, cure and exposure of the resin."""

from pathlib import Path

from solen.material.cure import CureOptions
from solen.material.cure.published_bounds import largest_Ec
from solen.material.index.options import IndexOptions
from solen.material.stiffness import Dimensions, StiffnessOptions
from solen.paper import samples
from solen.paper.design_numbers import size_of, wavelength_nm
from solen.paper.index_by_absorbance import (
    error_of_index,
    fall_of_polymers,
    literature_at,
    literature_between,
    rise_of_literature,
    transmittance_for,
)
from solen.paper.sample_numbers import (
    depth_at,
    least_transmittance_percent,
    mean_change_percent,
    modulus_change,
    paper_exposure,
    range_nm,
    slope_percent_per_s,
)
from solen.paper.samples import mark_of, write_samples
from solen.paper.statements import Comparison, compared, paper_value
from solen.pipeline.project.paper.model import COLUMN, PAGE, Made, PaperFigure, Picture
from solen.pipeline.resin.cure import cure
from solen.pipeline.resin.exposures import exposures
from solen.pipeline.resin.index import index
from solen.pipeline.resin.spectra import spectra
from solen.pipeline.resin.stiffness import stiffness
from solen.report.paper.figures import layer_figure, working_curves
from solen.report.plot import figure_of

LED_NM = 860.0
CUBE = Dimensions(cube_mm=samples.CUBE_MM)
PAPER_RATE, PAPER_S = paper_exposure()
INDICES_NM = (860.0, 500.0, 450.0)
MIN_NM, MAX_EXPOSURE_S, PRINTER = 400.0, 7.0, "asiga-max-uv"
CUBES = tuple(f"cubes/{kind}-{number}.csv" for kind in samples.KINDS for number in range(1, samples.REPEATS + 1))
LABELS = tuple(kind for kind in samples.KINDS for _ in range(samples.REPEATS))


def _layer(folder: Path) -> Made:
    (file,) = write_samples(folder, "layer.csv")
    known = {"thickness_um": samples.LAYER_UM, "u_T": samples.NOISE}
    result = index(file, options=IndexOptions(**known, u_R=samples.NOISE)).result
    published = index(file, options=IndexOptions(**known, mode="as-published", transmittance=("T",))).result
    alt = (
        "T and R of a simulated layer; its absorbance and absorptance; its index compared with the paper's three, "
        "which decrease much faster with wavelength than the published range"
    )
    options = PAGE.model_copy(update={"letters": "A"})
    return Made(
        (Picture("2.svg", alt, lambda: layer_figure(result), options, mark_of(file.name)),),
        (
            compared("transmittance", *least_transmittance_percent(result)),
            compared("absorbance", *error_of_index(published, LED_NM)),
            compared("slab", *error_of_index(result, LED_NM)),
            *map(_index, INDICES_NM),
            _dispersion(),
            *_typical(),
        ),
    )


def _index(nm: float) -> Comparison:
    key = f"index-{nm:g}"
    return compared(key, *literature_at(nm), transmittance=transmittance_for(paper_value(key), nm))


def _dispersion() -> Comparison:
    fall, u, largest = fall_of_polymers(INDICES_NM[-1], INDICES_NM[0])
    return compared("dispersion", fall, u, most=largest)


def _typical() -> list[Comparison]:
    """Compare with published indices the index that the paper calls typical, and its increase below 450 nm."""
    indices = [paper_value(f"index-{nm:g}") for nm in INDICES_NM]
    typical = compared("index-typical", *literature_between(*INDICES_NM), least=min(indices), largest=max(indices))
    return [typical, compared("index-rise", *rise_of_literature(MIN_NM, INDICES_NM[-1]))]


def _stiffness(folder: Path) -> Made:
    tests = write_samples(folder, *CUBES)
    result = stiffness(*tests, options=StiffnessOptions(mode="compression"), dimensions=CUBE, label=LABELS).result
    alt = (
        "compressive stress against strain of simulated cubes of two resins, mean and standard "
        "deviation of three cubes each"
    )
    options = COLUMN.model_copy(update={"panels": "A", "letters": "A"})
    picture = Picture("S1A.svg", alt, lambda: figure_of(result), options, mark_of(CUBES[0]))
    return Made(
        (picture,), (compared("compliance", *modulus_change(result)), compared("cube", size_of("cubes", "cube")))
    )


def _spectra(folder: Path) -> Made:
    tables = write_samples(folder, *(f"{kind}.csv" for kind in samples.KINDS))
    result = spectra(tables, trace=("T",)).result
    alt = "transmittance of simulated layers of the pristine and the modified resin from 400 to 900 nm"
    options = COLUMN.model_copy(update={"letters": "B", "limits": ("x=400:900",)})
    picture = Picture("S1B.svg", alt, lambda: figure_of(result), options, mark_of("modified.csv"))
    ends = [compared(key, nm) for key, nm in range_nm(result).items()]
    return Made((picture,), (compared("transparency", *mean_change_percent(result)), *ends))


def _cure(folder: Path) -> Made:
    tables = write_samples(folder, *(f"discs/{kind}.csv" for kind in reversed(samples.KINDS)))
    result = cure(tables, options=CureOptions(irradiance_mW_per_cm2=PAPER_RATE)).result
    energy = PAPER_RATE * PAPER_S
    alt = (
        "thickness of simulated discs of two resins against dose, the fitted lines, and the depth reported in the paper"
    )
    options = COLUMN.model_copy(update={"letters": "C"})
    picture = Picture("S1C.svg", alt, lambda: working_curves(result), options, mark_of("discs/modified.csv"))
    depth = compared("cure-depth", *depth_at(result, energy), Dp=result.Dp_um, Ec=largest_Ec(result.Dp_um))
    below = compared("cure-100", *depth_at(result, PAPER_RATE * MAX_EXPOSURE_S))
    projector = compared("projector", wavelength_nm(PRINTER))
    disc = compared("disc", size_of("cure-discs", "disc"))
    return Made(
        (picture,),
        (compared("cure-energy", energy), depth, compared("irradiance", PAPER_RATE), projector, disc, below),
    )


def _exposures(folder: Path) -> Made:
    result = exposures(write_samples(folder, "exposures.csv")).result
    alt = "transmittance of simulated layers exposed for 2, 4 and 6 s"
    options = COLUMN.model_copy(update={"panels": "A", "letters": "D"})
    picture = Picture("S1D.svg", alt, lambda: figure_of(result), options, mark_of("exposures.csv"))
    number = compared("exposures", float(len(set(result.exposure_s))))
    return Made((picture,), (compared("exposure", *slope_percent_per_s(result)), number))


LAYER = PaperFigure(
    "2",
    "UV-Vis spectra of one layer: (A) transmittance, (B) absorbance, (C) the refractive index of the layer as a slab.",
    (
        f"solen resin index data/layer.csv --thickness-um {samples.LAYER_UM:g} --u-T {samples.NOISE:g} "
        f"--u-R {samples.NOISE:g} --figure fig2.pdf --width-mm 180 --letters A",
    ),
    _layer,
)
MODIFIED = (
    PaperFigure(
        "S1A",
        "Compression of the pristine and the modified resin.",
        (
            f"solen resin stiffness data/cubes/*.csv --label {' '.join(sorted(LABELS))} --cube-mm {samples.CUBE_MM:g} "
            "--mode compression --figure s1a.pdf --panels A --letters A",
        ),
        _stiffness,
    ),
    PaperFigure(
        "S1B",
        "Transmittance of the pristine and the modified resin.",
        ("solen resin spectra data/pristine.csv data/modified.csv --trace T --figure s1b.pdf --letters B",),
        _spectra,
    ),
    PaperFigure(
        "S1C",
        "Working curve: depth of cure against dose.",
        ("solen resin cure data/discs/modified.csv data/discs/pristine.csv --figure s1c.pdf --letters C",),
        _cure,
    ),
    PaperFigure(
        "S1D",
        "Transmittance of layers cured for 2, 4 and 6 s.",
        ("solen resin exposures data/exposures.csv --figure s1d.pdf --panels A --letters D",),
        _exposures,
    ),
)
