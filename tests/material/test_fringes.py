"""Layers whose faces interfere: films of a plain transfer matrix come back, with intervals that hold the truth."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli.app import lines
from solen.cli.resin import index as _command  # noqa: F401  registers the lines
from solen.errors import DataError, SpecError
from solen.material.cure.exposures import ExposureOptions, exposure_trends
from solen.material.index.coherence import Blur, layer, stacked
from solen.material.index.dispersion_form import DispersionForm
from solen.material.index.interference import fringes_of
from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.material.index.reading import combined, reading
from solen.material.index.stack import Setup, Substrate, forward, on_substrate
from solen.material.result_files import IndexResult
from solen.recording import Provenance, Recording
from solen.report.resin.index import index_figure
from tests.material.film_support import Film, coherent, drawn, recorded

NM = np.linspace(450.0, 900.0, 301)
N = 1.476 + 0.004 / (NM / 1e3) ** 2
SLOPE = -2.0 * 0.004 / (NM / 1e3) ** 3 / 1e3
NOISE, OFFSET = 1e-3, 3e-4


def test_without_blur_the_layer_is_the_coherent_film() -> None:
    piece = layer(N, SLOPE, 1e-6, 25.0, NM, 1.0, Blur(0.0))
    t, r = coherent(N, np.full(NM.size, 1e-6), 25.0, NM)
    assert np.abs(piece.through - t).max() < 1e-5  # the fifth harmonic is left out
    assert np.abs(piece.front - r).max() < 1e-5


def test_with_all_contrast_gone_powers_add() -> None:
    piece = layer(N, SLOPE, 3e-5, 25.0, NM, 1.0, Blur(0.0, 10.0))
    r, t = forward(N, 3e-5, 25.0, NM)
    np.testing.assert_allclose(piece.through, t, atol=1e-12)
    np.testing.assert_allclose(piece.front, r, atol=1e-9)


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_on_a_sheet_with_all_contrast_gone_it_is_the_sum_of_powers(side: Any) -> None:
    setup = Setup(Substrate(1.6, 1e-6, 100.0), side=side, baseline="air")
    piece = layer(N, SLOPE, 3e-5, 25.0, NM, 1.6, Blur(0.0, 10.0))
    read, expected = stacked(piece, (1.6, 1e-6, 100.0), NM, setup), on_substrate(N, 3e-5, 25.0, NM, setup)
    np.testing.assert_allclose(read.T, expected.T, atol=1e-9)
    np.testing.assert_allclose(read.R, expected.R, atol=1e-8)


@pytest.mark.parametrize("even", [True, False])
def test_slit_and_spread_leave_what_brute_force_leaves(even: bool) -> None:
    film = drawn(np.random.default_rng(2), 18.0, 2.0, 0.003, even=even)
    slope = np.gradient(film.n, film.nm)
    blur = Blur(film.slit_nm, 0.0, film.spread) if even else Blur(film.slit_nm, film.spread)
    piece = layer(film.n, slope, film.k, film.thickness_um, film.nm, 1.0, blur)
    assert np.abs(piece.through - film.clean["T"])[3:-3].max() < 3e-4
    assert np.abs(piece.front - film.clean["R"])[3:-3].max() < 3e-4


def part(film: Film, of: slice) -> Film:
    """Some wavelengths of a film: a free index takes a time that grows faster than their number."""
    clean = {kind: values[of] for kind, values in film.clean.items()}
    return replace(film, nm=film.nm[of], clean=clean, n=film.n[of], k=film.k[of])


def options(film: Film, **more: Any) -> IndexOptions:
    names = {"transmittance": ("T0", "T1", "T2"), "reflectance": ("R0", "R1", "R2")}
    stated = {"thickness_um": film.thickness_um * 1.01, "u_thickness_um": film.thickness_um * 0.02, "baseline": "air"}
    return IndexOptions(**names | stated | {"bandwidth_nm": film.slit_nm * 1.04, "u_T": OFFSET, "u_R": OFFSET} | more)


@cache
def paper() -> tuple[Film, Recording]:
    """A layer as the paper's, and how it reads."""
    rng = np.random.default_rng(4)
    film = drawn(rng, 25.0, 2.0, 0.002)
    return film, recorded(film, rng, NOISE, OFFSET)


@cache
def found_of_paper() -> LayerIndex:
    film, recording = paper()
    return index_of_layer(recording, options(film))


def test_the_papers_layer_is_recognised_and_its_index_found() -> None:
    (film, _), found = paper(), found_of_paper()
    assert found.mode == "fringes"
    assert found.interference is not None
    assert not found.interference.by_levels
    assert np.abs(found.n - film.n).max() < 0.003
    assert (np.abs(found.n - film.n) < 3.0 * found.u_n).all()
    assert found.interference.thickness_um == pytest.approx(25.0, abs=3.0 * found.interference.u_thickness_um)
    assert found.interference.u_thickness_um < 0.05
    assert found.interference.thickness_spread_percent == pytest.approx(0.2, abs=0.03)
    assert found.fit is not None
    assert found.fit.model.index(650.0) == pytest.approx(float(np.interp(650.0, film.nm, film.n)), abs=0.003)
    assert "fringes were detected" in found.warnings[0]
    assert found.repeats_lossless_n is None  # a sum of powers of a wave is no index


def test_the_result_is_printed_drawn_and_kept_by_a_resin(tmp_path: Path) -> None:
    found = found_of_paper()
    printed = "\n".join(lines(found))
    assert "by mode fringes" in printed
    assert f"n times thickness {found.interference.optical_thickness_um:.4f}" in printed  # type: ignore[union-attr]
    figure = index_figure(found)
    assert len(figure.axes[0].lines) == 2
    figure.savefig(tmp_path / "a.png")
    result = IndexResult(**{key: value for key, value in found.to_dict().items() if key != "kind"})
    assert result.as_table().mode == "fringes"


def test_exposures_give_no_index_of_layers_with_fringes() -> None:
    film, _ = paper()
    rng = np.random.default_rng(5)
    named = [
        replace(recorded(film, rng, NOISE, OFFSET, repeats=1), provenance=Provenance(file=f"layer {seconds} s.csv"))
        for seconds in (2, 4)
    ]
    found = exposure_trends(named, ExposureOptions(thickness_um=25.0))
    assert np.isnan(found.wavelengths[0].n).all()
    assert any("fringes were detected" in text for text in found.warnings)


@pytest.mark.parametrize("mode", ["measured", "lossless"])
def test_powers_are_not_added_where_faces_interfere(mode: str) -> None:
    film, recording = paper()
    with pytest.raises(DataError, match=r"fringes of ± 0.0.* were detected"):
        index_of_layer(recording, options(film, mode=mode))


def test_fringes_that_are_not_there_are_not_fitted() -> None:
    rng = np.random.default_rng(4)
    film = drawn(rng, 60.0, 5.0, 0.03)
    recording = recorded(film, rng, NOISE, OFFSET)
    assert index_of_layer(recording, options(film)).mode == "measured"
    with pytest.raises(SpecError, match="no fringes are detected"):
        index_of_layer(recording, options(film, mode="fringes"))


@pytest.mark.parametrize("seed", range(6))
def test_noise_and_absorption_bands_are_no_fringes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    band = 1.0 - 0.02 * np.exp(-(((NM - rng.uniform(500, 850)) / rng.uniform(3, 40)) ** 2))
    r, t = forward(N, 1e-6, 25.0, NM)
    assert fringes_of(NM, {"T": t * band + rng.normal(0, 1e-3, NM.size), "R": r + rng.normal(0, 1e-3, NM.size)}) == []
    assert fringes_of(NM, {"T": t, "R": r}) == []
    assert fringes_of(NM, {"T": t * band + rng.normal(0, 1e-3, NM.size)}) == []


def test_transmittance_alone_gives_an_index_by_the_contrast() -> None:
    rng = np.random.default_rng(9)
    film = drawn(rng, 15.0, 1.0, 0.001)
    given = options(film, reflectance=(), u_R=None)
    found = index_of_layer(recorded(film, rng, NOISE, OFFSET), given)
    assert found.mode == "fringes"
    assert (np.abs(found.n - film.n) < 3.0 * found.u_n).all()
    assert np.median(found.u_n) < 0.02
    assert any("R was not measured" in text for text in found.warnings)


def trial(seed: int) -> tuple[float, float, bool, str]:
    """Share of the wavelengths whose interval holds the truth, error, whether the fringes are strong, and the mode."""
    rng = np.random.default_rng(seed)
    thickness, slit = rng.uniform(10.0, 80.0), float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
    spread = rng.uniform(0.0, 0.03) * rng.choice([0.1, 1.0])
    film = drawn(rng, thickness, slit, spread, step_nm=float(rng.choice([0.5, 1.0])), even=bool(rng.integers(2)))
    stated = thickness * rng.normal(1.0, 0.02)
    given = options(film, thickness_um=stated, u_thickness_um=0.02 * stated, bandwidth_nm=slit * rng.normal(1.0, 0.05))
    found = index_of_layer(recorded(film, rng, NOISE, OFFSET), given)
    low, high = found.interval95_n.T
    wave = np.diff(np.percentile(film.clean["T"] - film.clean["T"].mean(), [1, 99]))[0] / 2.0
    off = float(np.nanmedian(np.abs(found.n - film.n)))
    covered = float(np.mean((low <= film.n) & (film.n <= high)))
    return covered, off, bool(found.mode == "fringes" and wave > 10.0 * NOISE), found.mode


@pytest.mark.parametrize("seed", [20])
def test_a_films_index_is_within_its_interval(seed: int) -> None:
    covered, off, _, _ = trial(seed)
    assert covered > 0.85
    assert off < 0.004


@pytest.mark.parametrize("seed", [47, 58])
def test_fringes_at_the_long_wavelengths_alone_are_detected(seed: int) -> None:
    """A slit of 3 nm and more, and 30 to 60 µm: what is left of them is in two of twelve parts of the spectrum."""
    covered, off, _, mode = trial(seed)
    assert mode == "fringes"
    assert covered > 0.92
    assert off < 0.001


def test_scatter_of_few_repeats_is_taken_together_with_that_of_neighbours() -> None:
    """Three repeats: pointwise intervals of the mean hold the truth as often as they say, with a known offset."""
    rng, covered = np.random.default_rng(1), []
    for _ in range(40):
        found = reading(0.9 + rng.normal(0.0, NOISE, (3, 400)) + rng.normal(0.0, OFFSET), OFFSET, name="T")
        half = combined(found.shares(1.0), 400).bound(0.95)
        covered.append(np.mean(np.abs(found.value - 0.9) <= half))
    assert 0.93 < np.mean(covered) < 0.98


@cache
def resonant(seed: int) -> tuple[Film, Recording]:
    rng = np.random.default_rng(seed)
    film = drawn(rng, rng.uniform(18.0, 35.0), rng.uniform(0.7, 2.0), 0.002, resonance=0.004)
    return film, recorded(film, rng, NOISE, OFFSET)


def held(found: LayerIndex, film: Film) -> float:
    low, high = found.interval95_n.T
    return float(np.mean((low <= film.n) & (film.n <= high)))


@pytest.mark.parametrize("seed", [8])
def test_an_index_that_no_cauchy_formula_has_is_recognised_and_free(seed: int) -> None:
    film, rng = part(resonant(seed)[0], slice(100, None)), np.random.default_rng(7)
    found = index_of_layer(recorded(film, rng, NOISE, OFFSET), options(film))
    assert found.interference is not None
    assert found.interference.dispersion == "free"
    assert np.max(np.abs(found.n - film.n)) < 0.005
    assert held(found, film) > 0.85
    assert any("smooth curve" in text for text in found.warnings)


def test_the_form_of_the_index_can_be_chosen() -> None:
    rng = np.random.default_rng(4)
    film = part(drawn(rng, 25.0, 2.0, 0.002, pole_nm=150.0), slice(150, None))
    recording = recorded(film, rng, NOISE, OFFSET)
    for kind in ("cauchy", "sellmeier", "free"):
        found = index_of_layer(recording, options(film, dispersion=kind))
        assert found.interference is not None
        assert not found.interference.by_levels
        assert found.interference.dispersion == kind
        assert np.median(np.abs(found.n - film.n)) < 0.002
        assert held(found, film) > 0.9
    chosen = found_of_paper().interference
    assert chosen is not None
    assert chosen.dispersion == "cauchy"


def test_a_form_that_does_not_describe_the_index_is_named_not_the_film() -> None:
    rng = np.random.default_rng(0)
    film = drawn(rng, rng.uniform(12.0, 60.0), rng.uniform(0.7, 3.0), rng.uniform(0.0, 0.01))
    recording = recorded(film, rng, NOISE, OFFSET)
    with pytest.raises(
        DataError, match=r"'sellmeier'; does not describe n here: fringes remain in its residuals .* use cauchy"
    ):
        index_of_layer(recording, options(film, dispersion="sellmeier"))


def test_a_form_that_has_no_effect_or_no_fringes_is_refused() -> None:
    rng = np.random.default_rng(0)
    thin = drawn(rng, 10.0, 1.0, 0.001)
    few = part(thin, slice(150))
    with pytest.raises(DataError, match="needs 20"):
        index_of_layer(recorded(few, rng, NOISE, OFFSET), options(few, dispersion="free"))
    r, t = forward(N, 1e-6, 25.0, NM)
    none = Film(NM, {"T": t, "R": r}, N, 1e-6 * N, 25.0, 10.0, 0.0)
    with pytest.raises(SpecError, match="no fringes are detected"):
        index_of_layer(recorded(none, rng, NOISE, OFFSET), options(none, dispersion="free"))


def test_one_pole_has_the_middle_and_the_rise_of_its_three_terms() -> None:
    u = np.linspace(-1.0, 1.0, 201)
    n, slope = DispersionForm.of("sellmeier", u, np.ones_like(u)).index(1.5, 0.02, 0.0, np.zeros(0))
    middle = u.size // 2
    assert n[middle] == pytest.approx(1.5, abs=1e-12)
    assert slope == pytest.approx(np.gradient(n, u), abs=2e-5)
    square = 1.0 / (n**2 - 1.0)  # of one pole a straight line along 1/λ²
    assert np.abs(np.diff(square, 2)).max() < 1e-12


def test_curves_of_a_free_index_are_none_of_the_three_terms() -> None:
    u = np.linspace(-1.0, 1.0, 301) ** 3
    free = DispersionForm.of("free", u, np.ones_like(u), 9)
    assert free.curves == 6
    terms = np.stack([np.ones_like(u), u, u**2], axis=1)
    assert np.abs(terms.T @ free.waves).max() < 1e-9
    assert np.mean(free.waves**2, axis=0) == pytest.approx(np.ones(6))


@pytest.mark.evidence
def test_intervals_of_many_films_that_no_cauchy_formula_has_hold_the_truth() -> None:
    trials = [(index_of_layer(recording, options(film)), film) for film, recording in map(resonant, range(40))]
    covered = [held(found, film) for found, film in trials]
    free = sum(found.interference is not None and found.interference.dispersion == "free" for found, _ in trials)
    print(f"40 films with a resonance: coverage {np.mean(covered):.3f}, {free} with a free index, others by levels")
    assert np.mean(covered) > 0.92


@pytest.mark.evidence
def test_intervals_of_many_films_hold_the_truth() -> None:
    trials = [trial(seed) for seed in range(200)]
    covered, off = (np.array([one[column] for one in trials]) for column in (0, 1))
    strong = np.array([one[2] for one in trials])
    print(f"{len(trials)} films: coverage {covered.mean():.3f}, {int(strong.sum())} with strong fringes")
    print(f"  strong: coverage {covered[strong].mean():.3f}, median |dn| {np.median(off[strong]):.5f}")
    print(f"  others: coverage {covered[~strong].mean():.3f}, median |dn| {np.median(off[~strong]):.5f}")
    assert 0.92 < covered.mean() < 0.985
    assert np.median(off[strong]) < 0.002
