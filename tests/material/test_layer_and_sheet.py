"""Joint fit of a layer and its bare sheet with k ≥ 0: values, refusals, and the coverage of the intervals."""

from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, SpecError
from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.material.index.stack import Baseline, Setup, Side, Substrate, incoherent, on_substrate
from solen.recording import Channel, Provenance, Recording

NM = np.arange(450.0, 901.0, 5.0)
SHEET_UM, LAYER_UM = 100.0, 25.0
NOISE, OFFSET = 1e-3, 5e-4


def sheet_and_layer(
    seed: int, k: float = 1e-6, side: Side = "layer", baseline: Baseline = "air"
) -> tuple[Recording, np.ndarray[Any, np.dtype[np.float64]]]:
    """Return readings of a layer on drawn PET and of that film, three each, and the index of the layer."""
    rng = np.random.default_rng(seed)
    um = NM / 1e3
    n = rng.uniform(1.44, 1.54) + rng.uniform(0.003, 0.008) / um**2
    film = Substrate(rng.uniform(1.60, 1.65) + 0.0077 / um**2 + 0.0005 / um**4, 1.4e-6, SHEET_UM)
    layer = on_substrate(n, k, LAYER_UM, NM, Setup(film, side, baseline))
    bare = incoherent([film.n], [film.k], [SHEET_UM], NM)
    offsets = {kind: rng.normal(0.0, OFFSET) for kind in ("T", "R")}
    channels = [Channel("wavelength", "wavelength", "nm", NM)]
    spectra = (("T", layer.T), ("R", layer.R), ("T sheet ", bare.through), ("R sheet ", bare.front))
    for name, values in spectra:
        kind, quantity = name[0], {"T": "transmittance", "R": "reflectance"}[name[0]]
        for number in range(3):
            read = values + offsets[kind] + rng.normal(0.0, NOISE, NM.size)
            channels.append(Channel(f"{name}{number}", quantity, "1", read, axis="wavelength"))
    return Recording(tuple(channels), Provenance(file="both.csv", simulated=True)), n


def names(start: str) -> tuple[str, ...]:
    return tuple(f"{start}{number}" for number in range(3))


BOTH: dict[str, Any] = {
    "thickness_um": LAYER_UM,
    "u_thickness_um": 0.5,
    "baseline": "air",
    "substrate_thickness_um": SHEET_UM,
    "transmittance": names("T"),
    "reflectance": names("R"),
    "bare_transmittance": names("T sheet "),
    "bare_reflectance": names("R sheet "),
    "u_T": OFFSET,
    "u_R": OFFSET,
}


def evaluate(recording: Recording, **more: Any) -> LayerIndex:
    return index_of_layer(recording, IndexOptions(**BOTH | more))


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_layer_and_sheet_are_fitted_jointly(side: Side) -> None:
    recording, n = sheet_and_layer(1, k=3e-5, side=side)
    result = evaluate(recording, side=side)
    assert result.mode == "joint"
    assert result.interference is None
    assert (np.abs(result.n - n) < 3.0 * result.u_n).all()
    assert np.median(result.u_n) < 0.005
    low, high = result.interval95_k.T
    assert ((low >= 0.0) & (high >= 0.0)).all()
    assert np.median(high) > 3e-5 > np.median(low)
    assert "fitted jointly" in result.warnings[0]


def test_the_joint_fit_of_a_clear_layer_is_more_precise_than_the_inversion_at_each_wavelength() -> None:
    recording, n = sheet_and_layer(2, k=0.0)
    result = evaluate(recording)
    assert not np.isfinite(result.k).any()
    pointwise = index_of_layer(
        recording,
        IndexOptions(**{key: value for key, value in BOTH.items() if "bare" not in key}, substrate="pet-drawn"),
    )
    assert np.nanmedian(result.u_n) < 0.3 * np.nanmedian(pointwise.u_n)
    assert np.abs(result.n - n).max() < 0.01


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"bare_reflectance": ()}, "bare_reflectance; is missing"),
        ({"substrate": "pet-drawn"}, "substrate; cannot be combined with traces of the bare substrate"),
        ({"mode": "measured"}, "mode = 'measured'; cannot be combined with traces of the bare substrate"),
        ({"baseline": None}, "baseline; is required with traces of the bare substrate"),
    ],
)
def test_refuses_incompatible_options_of_a_bare_substrate(change: dict[str, Any], line: str) -> None:
    with pytest.raises(SpecError, match=line):
        IndexOptions(**BOTH | change)


def test_refuses_a_bare_substrate_at_other_wavelengths() -> None:
    recording, _ = sheet_and_layer(1)
    other = Channel("other", "wavelength", "nm", NM[1:])
    values = np.full(NM.size - 1, 0.88)
    more = tuple(Channel(f"S{kind}", "", "1", values * scale, axis="other") for kind, scale in (("T", 1.0), ("R", 0.1)))
    resampled = Recording((*recording.channels, other, *more), recording.provenance)
    with pytest.raises(DataError, match="must have the same wavelengths"):
        evaluate(resampled, bare_transmittance=("ST",), bare_reflectance=("SR",))


def coverage(seeds: range) -> float:
    covered = []
    for seed in seeds:
        recording, n = sheet_and_layer(seed, k=10.0 ** np.random.default_rng(seed).uniform(-7.0, -4.5))
        low, high = evaluate(recording).interval95_n.T
        covered.append(float(np.mean((low <= n) & (n <= high))))
    return float(np.mean(covered))


def test_intervals_cover_the_true_index() -> None:
    assert coverage(range(100, 108)) > 0.7


@pytest.mark.evidence
def test_intervals_of_many_layers_cover_the_true_index() -> None:
    covered = coverage(range(200))
    print(f"layer and bare sheet, 200 draws: coverage of 95 % intervals {covered:.3f}")
    assert 0.92 < covered < 0.985
