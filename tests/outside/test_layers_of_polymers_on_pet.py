"""Published n and k of polymers as layers on published PET: forth and back; as formulas; against the shipped table."""

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
    """Wavelength in nm from 400 to 1000, n and, where it is stated, k."""
    text = (outside / "refractiveindex" / f"{name}.yml").read_text(encoding="utf-8")
    rows = np.array([line.split() for line in yaml.safe_load(text)["DATA"][0]["data"].splitlines()], dtype=float)
    rows[:, 0] *= 1e3
    return np.asarray(rows[(rows[:, 0] >= 400 - 1e-9) & (rows[:, 0] <= 1000 + 1e-9)].T)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang"])
@pytest.mark.parametrize("thickness_um", [25.0, 200.0])
def test_layers_on_pet_come_back_as_they_went(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = published(outside, name)
    sheet = published(outside, "PET_Zhang")
    pet = Substrate(np.interp(nm, sheet[0], sheet[1]), np.interp(nm, sheet[0], sheet[2]), 100.0)
    read = on_substrate(n, k, thickness_um, nm, Setup(pet))
    found = invert_on_substrate(read.T, read.R, nm, thickness_um, Setup(pet, near=float(n.mean())))
    assert found.n == pytest.approx(n, abs=1e-9)
    assert found.k == pytest.approx(k, abs=1e-12)
    assert extinction(read.T, n, nm, thickness_um, Setup(pet)).k == pytest.approx(k, abs=1e-12)
    clear = invert_lossless(read.T, nm, Setup(pet, near=float(n.mean())))
    assert (clear.n[~np.isnan(clear.n)] >= n[~np.isnan(clear.n)] - 1e-9).all()  # an upper bound


@pytest.mark.parametrize(
    ("name", "scatter"), [("PMMA_Zhang-Tomson", 8e-4), ("PC_Zhang", 1.2e-3), ("Loctite3526_Iezzi", 1e-6)]
)
def test_published_points_follow_a_cauchy_formula(outside: Path, name: str, scatter: float) -> None:
    nm, n = published(outside, name)[:2]
    found = fit("cauchy", nm, n)
    assert found.rms < scatter
    assert found.model.index(589.0) == pytest.approx(float(np.interp(589.0, nm, n)), abs=3 * scatter)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang", "PET_Zhang", "Loctite3526_Iezzi"])
def test_the_shipped_table_holds_the_published_numbers(outside: Path, name: str) -> None:
    nm, n = published(outside, name)[:2]
    page = name.partition("_")[2]
    family = {"PMMA": "methyl_methacrylate", "PDMS": "siloxane", "PC": "carbonate", "PET": "terephthalate"}
    wanted = family.get(name.partition("_")[0], "Loctite")
    (entry,) = [one for one in materials() if one.page and wanted in one.page[1] and one.page[2] == page]
    assert np.array(entry.n) == pytest.approx(np.interp(entry.wavelength_nm, nm, n), abs=2e-5)


@pytest.mark.parametrize("name", ["PMMA_Zhang-Tomson", "Loctite3526_Iezzi"])
def test_a_refractometer_value_leads_to_the_published_curve(outside: Path, name: str) -> None:
    """n at 589.3 nm alone; within three stated uncertainties and the published scatter everywhere."""
    nm, n = published(outside, name)[:2]
    value, u = refractometer(float(np.interp(589.3, nm, n)), 5e-4).fit.along(nm)
    assert (abs(value - n) < 3.3 * u + 1e-3).all()
