"""Published n and k of polymers: recovered from layers on PET, fitted by formulas, and compared with shipped data."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from solen.arrays import FloatArray
from solen.material.index.fit import fit
from solen.material.index.literature import materials
from solen.material.index.refractometer import refractometer
from solen.material.index.stack import Setup, Substrate, on_substrate
from solen.material.index.substrate import extinction, invert_lossless, invert_on_substrate


def published(outside: Path, name: str) -> FloatArray:
    """Return wavelengths in nm from 400 to 1000, n and, if the file contains it, k."""
    text = (outside / "refractiveindex" / f"{name}.yml").read_text(encoding="utf-8")
    rows = np.array([line.split() for line in yaml.safe_load(text)["DATA"][0]["data"].splitlines()], dtype=float)
    rows[:, 0] *= 1e3
    return np.asarray(rows[(rows[:, 0] >= 400 - 1e-9) & (rows[:, 0] <= 1000 + 1e-9)].T)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang"])
@pytest.mark.parametrize("thickness_um", [25.0, 200.0])
def test_inverts_layers_on_pet(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = published(outside, name)
    sheet = published(outside, "PET_Zhang")
    pet = Substrate(np.interp(nm, sheet[0], sheet[1]), np.interp(nm, sheet[0], sheet[2]), 100.0)
    simulated = on_substrate(n, k, thickness_um, nm, Setup(pet))
    result = invert_on_substrate(simulated.T, simulated.R, nm, thickness_um, Setup(pet, near=float(n.mean())))
    assert result.n == pytest.approx(n, abs=1e-9)
    assert result.k == pytest.approx(k, abs=1e-12)
    assert extinction(simulated.T, n, nm, thickness_um, Setup(pet)).k == pytest.approx(k, abs=1e-12)
    lossless = invert_lossless(simulated.T, nm, Setup(pet, near=float(n.mean())))
    assert (lossless.n[~np.isnan(lossless.n)] >= n[~np.isnan(lossless.n)] - 1e-9).all()  # an upper bound


@pytest.mark.parametrize(
    ("name", "scatter"), [("PMMA_Zhang-Tomson", 8e-4), ("PC_Zhang", 1.2e-3), ("Loctite3526_Iezzi", 1e-6)]
)
def test_published_points_follow_cauchy_formula(outside: Path, name: str, scatter: float) -> None:
    nm, n = published(outside, name)[:2]
    result = fit("cauchy", nm, n)
    assert result.rms < scatter
    assert result.model.index(589.0) == pytest.approx(float(np.interp(589.0, nm, n)), abs=3 * scatter)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang", "PET_Zhang", "Loctite3526_Iezzi"])
def test_shipped_table_contains_published_values(outside: Path, name: str) -> None:
    nm, n = published(outside, name)[:2]
    page = name.partition("_")[2]
    family = {"PMMA": "methyl_methacrylate", "PDMS": "siloxane", "PC": "carbonate", "PET": "terephthalate"}
    name_in_table = family.get(name.partition("_")[0], "Loctite")
    (entry,) = [
        material
        for material in materials()
        if material.page and name_in_table in material.page[1] and material.page[2] == page
    ]
    assert np.array(entry.n) == pytest.approx(np.interp(entry.wavelength_nm, nm, n), abs=2e-5)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "Loctite3526_Iezzi"])
def test_refractometer_value_predicts_published_curve(outside: Path, name: str) -> None:
    """From n at 589.3 nm alone, within three stated uncertainties and the published scatter at every wavelength."""
    nm, n = published(outside, name)[:2]
    value, u = refractometer(float(np.interp(589.3, nm, n)), 5e-4).fit.indices(nm)
    assert (abs(value - n) < 3.3 * u + 1e-3).all()
