"""Slabs of polymers with published indices from 0.4 to 20 µm: n and k recovered from their computed R and T."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from solen.arrays import FloatArray
from solen.material.index import Length, forward, invert, measured, reading
from solen.material.index.masks import Reason

POLYMERS = ("PMMA_Zhang-Tomson", "PDMS_Zhang-10-1", "PC_Zhang", "PET_Zhang")
THICKNESSES_UM = (25.0, 50.0, 100.0, 200.0)
U_READING = 1e-3


def published(outside: Path, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the wavelengths in nm, n and k of a polymer."""
    text = (outside / "refractiveindex" / f"{name}.yml").read_text(encoding="utf-8")
    rows = yaml.safe_load(text)["DATA"][0]["data"].strip().splitlines()
    um, n, k = np.array([[float(word) for word in row.split()] for row in rows]).T
    return um * 1e3, n, k


@pytest.mark.parametrize("thickness_um", THICKNESSES_UM)
@pytest.mark.parametrize("name", POLYMERS)
def test_inverts_slab_of_polymer(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = published(outside, name)
    r, t = forward(n, k, thickness_um, nm)
    index = measured(nm, reading(t), reading(r), Length(thickness_um))
    assert np.abs(index.k.value - k).max() < 1e-12  # also within bands where T is 1e-103
    known = index.n.known
    assert np.abs(index.n.value - n)[known].max() < 1e-9
    # within strong bands two indices fit; there n is masked, and one of the two is that of the polymer
    assert set(index.n.codes[~known].tolist()) <= {Reason.AMBIGUOUS}
    assert (~known).sum() <= 25
    roots = invert(r, t, thickness_um, nm)
    error = np.minimum(np.abs(roots.n - n), np.abs(roots.other_n - n))
    assert error.max() < 1e-9
    assert known[nm < 3000.0].all()


@pytest.mark.parametrize("thickness_um", THICKNESSES_UM)
@pytest.mark.parametrize("name", POLYMERS)
def test_stated_uncertainty_of_polymer_holds_with_noise(outside: Path, name: str, thickness_um: float) -> None:
    nm, n, k = published(outside, name)
    selected = nm <= 2000.0
    nm, n, k = nm[selected], n[selected], k[selected]
    rng = np.random.default_rng(8)
    repeats = 1000 // nm.size + 1  # more than a thousand readings with independent noise
    nm, n, k = (np.tile(values, repeats) for values in (nm, n, k))
    r, t = (value + rng.normal(0.0, U_READING, nm.size) for value in forward(n, k, thickness_um, nm))
    index = measured(nm, reading(t, U_READING), reading(r, U_READING), Length(thickness_um))
    assert index.n.known.mean() > 0.999
    error = np.abs(index.n.value - n)[index.n.known]
    for bound, level in ((index.n.u, 0.6827), (index.n.u95, 0.95)):
        scatter = 4 * np.sqrt(level * (1 - level) / nm.size)
        assert np.mean(error <= bound[index.n.known]) == pytest.approx(level, abs=scatter)
