"""Layers with interference fringes: the index of simulated films is recovered, with intervals that cover the truth."""

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
from tests.material.film_support import Film, coherent, random_film, record

NM = np.linspace(450.0, 900.0, 301)
N = 1.476 + 0.004 / (NM / 1e3) ** 2
SLOPE = -2.0 * 0.004 / (NM / 1e3) ** 3 / 1e3
NOISE, OFFSET = 1e-3, 3e-4


def test_without_blur_the_layer_is_a_coherent_film() -> None:
    piece = layer(N, SLOPE, 1e-6, 25.0, NM, 1.0, Blur(0.0))
    t, r = coherent(N, np.full(NM.size, 1e-6), 25.0, NM)
    assert np.abs(piece.through - t).max() < 1e-5  # the fifth harmonic is omitted
    assert np.abs(piece.front - r).max() < 1e-5


def test_without_contrast_powers_add() -> None:
    piece = layer(N, SLOPE, 3e-5, 25.0, NM, 1.0, Blur(0.0, 10.0))
    r, t = forward(N, 3e-5, 25.0, NM)
    np.testing.assert_allclose(piece.through, t, atol=1e-12)
    np.testing.assert_allclose(piece.front, r, atol=1e-9)


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_without_contrast_powers_add_on_a_substrate(side: Any) -> None:
    setup = Setup(Substrate(1.6, 1e-6, 100.0), side=side, baseline="air")
    piece = layer(N, SLOPE, 3e-5, 25.0, NM, 1.6, Blur(0.0, 10.0))
    read, expected = stacked(piece, (1.6, 1e-6, 100.0), NM, setup), on_substrate(N, 3e-5, 25.0, NM, setup)
    np.testing.assert_allclose(read.T, expected.T, atol=1e-9)
    np.testing.assert_allclose(read.R, expected.R, atol=1e-8)


@pytest.mark.parametrize("uniform", [True, False])
def test_blur_by_slit_and_thickness_equals_the_numerical_average(uniform: bool) -> None:
    film = random_film(np.random.default_rng(2), 18.0, 2.0, 0.003, uniform=uniform)
    slope = np.gradient(film.n, film.nm)
    blur = Blur(film.slit_nm, 0.0, film.relative_sd) if uniform else Blur(film.slit_nm, film.relative_sd)
    piece = layer(film.n, slope, film.k, film.thickness_um, film.nm, 1.0, blur)
    assert np.abs(piece.through - film.clean["T"])[3:-3].max() < 3e-4
    assert np.abs(piece.front - film.clean["R"])[3:-3].max() < 3e-4


def part(film: Film, selected: slice) -> Film:
    """Return the film at fewer wavelengths: the fit of a free index takes more than proportionally longer with them."""
    clean = {kind: values[selected] for kind, values in film.clean.items()}
    return replace(film, nm=film.nm[selected], clean=clean, n=film.n[selected], k=film.k[selected])


def options(film: Film, **more: Any) -> IndexOptions:
    names = {"transmittance": ("T0", "T1", "T2"), "reflectance": ("R0", "R1", "R2")}
    sample = {"thickness_um": film.thickness_um * 1.01, "u_thickness_um": film.thickness_um * 0.02, "baseline": "air"}
    return IndexOptions(**names | sample | {"bandwidth_nm": film.slit_nm * 1.04, "u_T": OFFSET, "u_R": OFFSET} | more)


@cache
def paper() -> tuple[Film, Recording]:
    """Return a layer like the paper's, and its measurement."""
    rng = np.random.default_rng(4)
    film = random_film(rng, 25.0, 2.0, 0.002)
    return film, record(film, rng, NOISE, OFFSET)


@cache
def result_of_paper() -> LayerIndex:
    film, recording = paper()
    return index_of_layer(recording, options(film))


def test_fringes_of_the_papers_layer_are_detected_and_yield_its_index() -> None:
    (film, _), result = paper(), result_of_paper()
    assert result.mode == "fringes"
    assert result.interference is not None
    assert not result.interference.by_levels
    assert np.abs(result.n - film.n).max() < 0.003
    assert (np.abs(result.n - film.n) < 3.0 * result.u_n).all()
    assert result.interference.thickness_um == pytest.approx(25.0, abs=3.0 * result.interference.u_thickness_um)
    assert result.interference.u_thickness_um < 0.05
    assert result.interference.thickness_spread_percent == pytest.approx(0.2, abs=0.03)
    assert result.fit is not None
    assert result.fit.model.index(650.0) == pytest.approx(float(np.interp(650.0, film.nm, film.n)), abs=0.003)
    assert "fringes were detected" in result.warnings[0]
    assert result.repeats_lossless_n is None  # with interference, powers do not add


def test_the_result_is_printed_drawn_and_accepted_by_a_resin(tmp_path: Path) -> None:
    result = result_of_paper()
    assert result.interference is not None
    printed = "\n".join(lines(result))
    assert "by mode fringes" in printed
    assert f"n times thickness {result.interference.optical_thickness_um:.4f}" in printed
    figure = index_figure(result)
    assert len(figure.axes[0].lines) == 2
    figure.savefig(tmp_path / "a.png")
    file = IndexResult(**{key: value for key, value in result.to_dict().items() if key != "kind"})
    assert file.as_table().mode == "fringes"


def test_exposures_yield_no_index_of_layers_with_fringes() -> None:
    film, _ = paper()
    rng = np.random.default_rng(5)
    recordings = [
        replace(record(film, rng, NOISE, OFFSET, repeats=1), provenance=Provenance(file=f"layer {seconds} s.csv"))
        for seconds in (2, 4)
    ]
    trends = exposure_trends(recordings, ExposureOptions(thickness_um=25.0))
    assert np.isnan(trends.wavelengths[0].n).all()
    assert any("fringes were detected" in text for text in trends.warnings)


@pytest.mark.parametrize("mode", ["measured", "lossless"])
def test_refuses_to_add_powers_of_layers_with_fringes(mode: str) -> None:
    film, recording = paper()
    with pytest.raises(DataError, match=r"fringes of ± 0.0.* were detected"):
        index_of_layer(recording, options(film, mode=mode))


def test_refuses_to_fit_fringes_that_were_not_detected() -> None:
    rng = np.random.default_rng(4)
    film = random_film(rng, 60.0, 5.0, 0.03)
    recording = record(film, rng, NOISE, OFFSET)
    assert index_of_layer(recording, options(film)).mode == "measured"
    with pytest.raises(SpecError, match="mode = 'fringes'; requires fringes"):
        index_of_layer(recording, options(film, mode="fringes"))


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_absorption_bands_are_not_detected_as_fringes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    band = 1.0 - 0.02 * np.exp(-(((NM - rng.uniform(500, 850)) / rng.uniform(3, 40)) ** 2))
    r, t = forward(N, 1e-6, 25.0, NM)
    assert fringes_of(NM, {"T": t * band + rng.normal(0, 1e-3, NM.size), "R": r + rng.normal(0, 1e-3, NM.size)}) == []
    assert fringes_of(NM, {"T": t * band + rng.normal(0, 1e-3, NM.size)}) == []


def test_spectra_without_noise_and_fringes_have_no_fringes() -> None:
    r, t = forward(N, 1e-6, 25.0, NM)
    assert fringes_of(NM, {"T": t, "R": r}) == []


def test_transmittance_alone_yields_an_index_from_the_contrast() -> None:
    rng = np.random.default_rng(9)
    film = random_film(rng, 15.0, 1.0, 0.001)
    result = index_of_layer(record(film, rng, NOISE, OFFSET), options(film, reflectance=(), u_R=None))
    assert result.mode == "fringes"
    assert (np.abs(result.n - film.n) < 3.0 * result.u_n).all()
    assert np.median(result.u_n) < 0.02
    assert any("R was not measured" in text for text in result.warnings)


def trial(seed: int) -> tuple[float, float, bool, str]:
    """Return the coverage of the intervals, the error, whether the fringes are strong, and the mode of one film."""
    rng = np.random.default_rng(seed)
    thickness, slit = rng.uniform(10.0, 80.0), float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
    relative_sd = rng.uniform(0.0, 0.03) * rng.choice([0.1, 1.0])
    film = random_film(
        rng, thickness, slit, relative_sd, step_nm=float(rng.choice([0.5, 1.0])), uniform=bool(rng.integers(2))
    )
    measured_um = thickness * rng.normal(1.0, 0.02)
    bandwidth_nm = slit * rng.normal(1.0, 0.05)
    sample = options(film, thickness_um=measured_um, u_thickness_um=0.02 * measured_um, bandwidth_nm=bandwidth_nm)
    result = index_of_layer(record(film, rng, NOISE, OFFSET), sample)
    amplitude = np.diff(np.percentile(film.clean["T"] - film.clean["T"].mean(), [1, 99]))[0] / 2.0
    error = float(np.nanmedian(np.abs(result.n - film.n)))
    return coverage(result, film), error, bool(result.mode == "fringes" and amplitude > 10.0 * NOISE), result.mode


def coverage(result: LayerIndex, film: Film) -> float:
    low, high = result.interval95_n.T
    return float(np.mean((low <= film.n) & (film.n <= high)))


@pytest.mark.parametrize("seed", [20])
def test_the_index_of_a_film_is_within_its_interval(seed: int) -> None:
    covered, error, _, _ = trial(seed)
    assert covered > 0.85
    assert error < 0.004


@pytest.mark.parametrize("seed", [47, 58])
def test_fringes_at_long_wavelengths_only_are_detected(seed: int) -> None:
    """A slit of at least 3 nm, and 30 to 60 µm: fringes remain in two of the twelve sections of the spectrum."""
    covered, error, _, mode = trial(seed)
    assert mode == "fringes"
    assert covered > 0.92
    assert error < 0.001


def test_scatter_of_few_repeats_is_pooled_with_that_of_neighbouring_wavelengths() -> None:
    """Three repeats with a known offset: 95 % intervals of the mean at each wavelength cover the truth in 95 %."""
    rng, covered = np.random.default_rng(1), []
    for _ in range(40):
        spectrum = reading(0.9 + rng.normal(0.0, NOISE, (3, 400)) + rng.normal(0.0, OFFSET), OFFSET, name="T")
        half = combined(spectrum.contributions(1.0), 400).bound(0.95)
        covered.append(np.mean(np.abs(spectrum.value - 0.9) <= half))
    assert 0.93 < np.mean(covered) < 0.98


@cache
def resonant(seed: int) -> tuple[Film, Recording]:
    rng = np.random.default_rng(seed)
    film = random_film(rng, rng.uniform(18.0, 35.0), rng.uniform(0.7, 2.0), 0.002, resonance=0.004)
    return film, record(film, rng, NOISE, OFFSET)


@pytest.mark.parametrize("seed", [8])
def test_an_index_without_cauchy_formula_is_fitted_by_a_smooth_curve(seed: int) -> None:
    film, rng = part(resonant(seed)[0], slice(150, 350)), np.random.default_rng(7)
    result = index_of_layer(record(film, rng, NOISE, OFFSET), options(film))
    assert result.interference is not None
    assert result.interference.dispersion == "free"
    assert np.max(np.abs(result.n - film.n)) < 0.005
    assert coverage(result, film) > 0.85
    assert any("smooth curve" in text for text in result.warnings)


def test_the_form_of_the_index_can_be_chosen() -> None:
    rng = np.random.default_rng(4)
    film = part(random_film(rng, 25.0, 2.0, 0.002, pole_nm=150.0), slice(200, None))
    recording = record(film, rng, NOISE, OFFSET)
    for kind in ("cauchy", "sellmeier", "free"):
        result = index_of_layer(recording, options(film, dispersion=kind))
        assert result.interference is not None
        assert not result.interference.by_levels
        assert result.interference.dispersion == kind
        assert np.median(np.abs(result.n - film.n)) < 0.002
        assert coverage(result, film) > 0.9
    chosen = result_of_paper().interference
    assert chosen is not None
    assert chosen.dispersion == "cauchy"


def test_refuses_a_form_that_does_not_describe_the_index() -> None:
    rng = np.random.default_rng(0)
    film = random_film(rng, rng.uniform(12.0, 60.0), rng.uniform(0.7, 3.0), rng.uniform(0.0, 0.01))
    recording = record(film, rng, NOISE, OFFSET)
    with pytest.raises(DataError, match=r"dispersion = 'sellmeier'; .*fringes remain in .* cauchy"):
        index_of_layer(recording, options(film, dispersion="sellmeier"))


def test_refuses_a_form_without_enough_wavelengths_or_without_fringes() -> None:
    rng = np.random.default_rng(0)
    thin = random_film(rng, 10.0, 1.0, 0.001)
    few = part(thin, slice(150))
    with pytest.raises(DataError, match="requires at least 20 fringes"):
        index_of_layer(record(few, rng, NOISE, OFFSET), options(few, dispersion="free"))
    r, t = forward(N, 1e-6, 25.0, NM)
    incoherent = Film(NM, {"T": t, "R": r}, N, 1e-6 * N, 25.0, 10.0, 0.0)
    with pytest.raises(SpecError, match="dispersion = 'free'; requires fringes"):
        index_of_layer(record(incoherent, rng, NOISE, OFFSET), options(incoherent, dispersion="free"))


def test_one_pole_matches_centre_and_slope_of_the_three_terms() -> None:
    u = np.linspace(-1.0, 1.0, 201)
    n, slope = DispersionForm.of("sellmeier", u, np.ones_like(u)).index(1.5, 0.02, 0.0, np.zeros(0))
    assert n[u.size // 2] == pytest.approx(1.5, abs=1e-12)
    assert slope == pytest.approx(np.gradient(n, u), abs=2e-5)
    reciprocal = 1.0 / (n**2 - 1.0)  # for one pole linear in 1/λ²
    assert np.abs(np.diff(reciprocal, 2)).max() < 1e-12


def test_curves_of_a_free_index_are_orthogonal_to_the_three_terms() -> None:
    u = np.linspace(-1.0, 1.0, 301) ** 3
    free = DispersionForm.of("free", u, np.ones_like(u), 9)
    assert free.count == 6
    terms = np.stack([np.ones_like(u), u, u**2], axis=1)
    assert np.abs(terms.T @ free.curves).max() < 1e-9
    assert np.mean(free.curves**2, axis=0) == pytest.approx(np.ones(6))


@pytest.mark.evidence
def test_intervals_of_many_films_without_cauchy_formula_cover_the_truth() -> None:
    trials = [(index_of_layer(recording, options(film)), film) for film, recording in map(resonant, range(40))]
    covered = [coverage(result, film) for result, film in trials]
    free = sum(result.interference is not None and result.interference.dispersion == "free" for result, _ in trials)
    print(f"40 films with a resonance: coverage {np.mean(covered):.3f}, {free} with a free index, others by levels")
    assert np.mean(covered) > 0.92


@pytest.mark.evidence
def test_intervals_of_many_films_cover_the_truth() -> None:
    trials = [trial(seed) for seed in range(200)]
    covered, errors = (np.array([result[column] for result in trials]) for column in (0, 1))
    strong = np.array([result[2] for result in trials])
    print(f"{len(trials)} films: coverage {covered.mean():.3f}, {int(strong.sum())} with strong fringes")
    print(f"  strong: coverage {covered[strong].mean():.3f}, median |dn| {np.median(errors[strong]):.5f}")
    print(f"  others: coverage {covered[~strong].mean():.3f}, median |dn| {np.median(errors[~strong]):.5f}")
    assert 0.92 < covered.mean() < 0.985
    assert np.median(errors[strong]) < 0.002
