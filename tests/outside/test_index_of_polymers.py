"""Slabs of measured polymers, 0.4 to 20 µm: forward to R and T, back to n and k."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from solen.arrays import FloatArray
from solen.material.index import Length, forward, invert, measured, reading
from solen.material.index.masks import Why

POLYMERS = ("PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang", "PET_Zhang")
THICKNESSES_UM = (25.0, 50.0, 100.0, 200.0)
U = 1e-3


def tabulated(outside: Path, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Wavelength in nm, n and k of a polymer."""
    text = (outside / "refractiveindex" / f"{name}.yml").read_text(encoding="utf-8")
    rows = yaml.safe_load(text)["DATA"][0]["data"].strip().splitlines()
    um, n, k = np.array([[float(word) for word in row.split()] for row in rows]).T
    return um * 1e3, n, k


@pytest.mark.parametrize("thickness_um", THICKNESSES_UM)
@pytest.mark.parametrize("name", POLYMERS)
def test_a_polymer_comes_back_from_its_slab(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = tabulated(outside, name)
    r, t = forward(n, k, thickness_um, nm)
    found = measured(nm, reading(t), reading(r), Length(thickness_um))
    assert np.abs(found.k.value - k).max() < 1e-12  # through bands where T is 1e-103, too
    known = found.n.known
    assert np.abs(found.n.value - n)[known].max() < 1e-9
    # in strong bands two indices fit; there n is masked, and one of the two is the polymer's
    assert set(found.n.why[~known].tolist()) <= {Why.AMBIGUOUS}
    assert (~known).sum() <= 25
    raw = invert(r, t, thickness_um, nm)
    nearest = np.minimum(np.abs(raw.n - n), np.abs(raw.other_n - n))
    assert nearest.max() < 1e-9
    assert known[nm < 3000.0].all()


@pytest.mark.parametrize("thickness_um", THICKNESSES_UM)
@pytest.mark.parametrize("name", POLYMERS)
def test_with_noise_the_stated_uncertainty_of_a_polymer_holds(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = tabulated(outside, name)
    near = nm <= 2000.0
    nm, n, k = nm[near], n[near], k[near]
    rng = np.random.default_rng(8)
    draws = 1000 // nm.size + 1  # a thousand wavelengths and more, each with noise of its own
    nm, n, k = (np.tile(values, draws) for values in (nm, n, k))
    r, t = (value + rng.normal(0.0, U, nm.size) for value in forward(n, k, thickness_um, nm))
    found = measured(nm, reading(t, U), reading(r, U), Length(thickness_um))
    assert found.n.known.mean() > 0.999
    error = np.abs(found.n.value - n)[found.n.known]
    for bound, level in ((found.n.u, 0.6827), (found.n.u95, 0.95)):
        scatter = 4 * np.sqrt(level * (1 - level) / nm.size)
        assert np.mean(error <= bound[found.n.known]) == pytest.approx(level, abs=scatter)
