"""Forward model of a layer on a substrate, compared with ray sums, averaged waves and the tracer."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solen.errors import DataError
from solen.material.index.stack import (
    Baseline,
    Powers,
    Setup,
    Side,
    Substrate,
    incoherent,
    interface_reflectance,
    internal_transmittance,
    on_substrate,
)

PET = Substrate(1.57, 1.4e-6, 100.0)
LAYER_UM, NM = 25.0, 589.3

indices = st.floats(1.0, 2.2)
losses = st.floats(0.0, 2e-4)


def ray_sum(n: tuple[float, ...], k: tuple[float, ...], h_um: tuple[float, ...]) -> tuple[float, float]:
    """Return R and T of layers in air by following every ray through every split until no power is left."""
    through = [float(internal_transmittance(loss, h, NM)) for loss, h in zip(k, h_um, strict=True)]
    media = [(1.0, 0.0), *zip(n, k, strict=True), (1.0, 0.0)]
    face = [float(interface_reflectance(*a, *b)) for a, b in itertools.pairwise(media)]
    powers = {(0, 1): 1.0}  # (next face, direction of ±1): power
    reflected = transmitted = 0.0
    while powers:
        arriving: dict[tuple[int, int], float] = {}
        for (index, direction), power in powers.items():
            for fraction, heading in ((face[index], -direction), (1 - face[index], direction)):
                following = index + heading
                if following < 0:
                    reflected += power * fraction
                elif following == len(face):
                    transmitted += power * fraction
                elif power * fraction > 1e-18:
                    remaining = power * fraction * through[index if heading > 0 else following]
                    arriving[following, heading] = arriving.get((following, heading), 0.0) + remaining
        powers = arriving
    return reflected, transmitted


def averaged_waves(n: tuple[float, float], k: tuple[float, float], h_um: tuple[float, float]) -> tuple[float, float]:
    """Return R and T of two layers in air from their characteristic matrices, averaged over both phases."""
    steps = 48  # equidistant phases: the average of an analytic periodic function converges like 0.05^48
    phases = np.arange(steps) * np.pi / steps
    matrix = np.broadcast_to(np.eye(2, dtype=complex), (steps, steps, 2, 2))
    for index, loss, h, axis in zip(n, k, h_um, (0, 1), strict=True):
        m = index - 1j * loss
        decay = 2 * np.pi * loss * h * 1e3 / NM
        delta = np.expand_dims(phases, 1 - axis) - 1j * decay
        delta = np.broadcast_to(delta, (steps, steps))
        rows = [[np.cos(delta), 1j * np.sin(delta) / m], [1j * m * np.sin(delta), np.cos(delta)]]
        matrix = matrix @ np.moveaxis(np.array(rows), (0, 1), (2, 3))
    b, c = matrix[..., 0, 0] + matrix[..., 0, 1], matrix[..., 1, 0] + matrix[..., 1, 1]
    r, t = (b - c) / (b + c), 2 / (b + c)
    return float((abs(r) ** 2).mean()), float((abs(t) ** 2).mean())


@given(n=st.tuples(indices, indices), k=st.tuples(losses, losses))
def test_the_closed_form_equals_the_sum_of_all_rays(n: tuple[float, float], k: tuple[float, float]) -> None:
    thick = (25.0, 100.0)
    stack = incoherent(n, k, thick, NM)
    assert (stack.front, stack.through) == pytest.approx(ray_sum(n, k, thick), abs=1e-14)  # rounding of some 100 sums
    assert stack.back == pytest.approx(ray_sum(n[::-1], k[::-1], thick[::-1])[0], abs=1e-14)


def test_three_layers_equal_the_sum_of_all_rays() -> None:
    n, k, thick = (1.45, 1.57, 1.4), (1e-5, 2e-6, 5e-5), (25.0, 100.0, 40.0)
    stack = incoherent(n, k, thick, NM)
    assert (stack.front, stack.through) == pytest.approx(ray_sum(n, k, thick), abs=1e-14)


@pytest.mark.parametrize("n", [1.35, 1.49, 1.62])
@pytest.mark.parametrize("k", [0.0, 5e-5])
def test_waves_averaged_over_their_phases_add_incoherently(n: float, k: float) -> None:
    """A spectrophotometer with a wide slit averages over all phases except those between paths of equal length.

    Such paths (one round trip in the layer, then one in the sheet, or the reverse) interfere at any thickness. Their
    power is proportional to three face reflectances, 1e-5, which corresponds to 1e-4 in n.
    """
    stack = incoherent((n, 1.57), (k, 1.4e-6), (25.0, 100.0), NM)
    assert (stack.front, stack.through) == pytest.approx(
        averaged_waves((n, 1.57), (k, 1.4e-6), (25.0, 100.0)), abs=2e-5
    )


@given(n=st.tuples(indices, indices), k=st.tuples(losses, losses))
def test_any_stack_is_reciprocal_and_conserves_power(n: tuple[float, float], k: tuple[float, float]) -> None:
    forward = incoherent(n, k, (25.0, 100.0), NM)
    reverse = incoherent(n[::-1], k[::-1], (100.0, 25.0), NM)
    assert forward.through == pytest.approx(reverse.through, abs=1e-15)
    assert (forward.front, forward.back) == pytest.approx((reverse.back, reverse.front), abs=1e-15)
    assert forward.front + forward.through <= 1 + 1e-15
    clear = incoherent(n, (0.0, 0.0), (25.0, 100.0), NM)
    assert clear.front + clear.through == pytest.approx(1, abs=1e-14)


@given(n=indices, k=losses)
def test_a_substrate_of_air_is_a_free_standing_slab(n: float, k: float) -> None:
    """Compared with T = (1 − F)² τ / (1 − F² τ²) and R = F (1 + τT), the sum over the passes of one slab."""
    face, tau = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), np.exp(-4 * np.pi * k * LAYER_UM * 1e3 / NM)
    through = (1 - face) ** 2 * tau / (1 - (face * tau) ** 2)
    stack = on_substrate(n, k, LAYER_UM, NM, Setup(Substrate(1.0, 0.0, 100.0)))
    assert stack == pytest.approx((through, face * (1 + tau * through)), abs=1e-14)


def test_a_layer_of_the_substrates_material_is_a_thicker_substrate() -> None:
    stack = incoherent((1.57, 1.57), (1e-5, 1e-5), (25.0, 100.0), NM)
    thicker: Powers = incoherent([1.57], [1e-5], [125.0], NM)
    assert tuple(map(float, stack)) == pytest.approx(tuple(map(float, thicker)), abs=1e-15)
    assert float(on_substrate(1.57, 0.0, 25.0, NM, Setup(PET)).T) == pytest.approx(1.0, abs=1e-12)


def test_a_clear_resin_on_pet_transmits_more_than_the_bare_sheet() -> None:
    """Relative to the bare sheet, T exceeds 1 for every index of a printing resin: the layer reduces reflection."""
    read = on_substrate(np.array([1.42, 1.45, 1.49, 1.52, 1.55]), 0.0, LAYER_UM, NM, Setup(PET)).T
    assert (np.diff(read) < 0).all()
    assert read == pytest.approx([1.0167, 1.0140, 1.0098, 1.0063, 1.0026], abs=1e-4)


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_the_tracer_agrees_with_the_stack(side: Side) -> None:
    """Two media in contact, one ray at normal incidence, Fresnel losses at every face.

    The tracer neglects k at the faces, an error of the order of k², 1e-10.
    """
    from solen.curve import Segment
    from solen.scene import Interface, Monitor, Rays, Region, Scene
    from solen.trace import Limits, trace

    n, k, sheet = 1.47, 2e-5, Substrate(1.57, 1e-5, 100.0)
    layers = [(n, k, LAYER_UM), (1.57, 1e-5, 100.0)]
    if side == "substrate":
        layers.reverse()
    per_mm = [4 * np.pi * loss / (NM * 1e-6) for _, loss, _ in layers]
    names = ["air", "first", "second", "air"]
    heights = np.cumsum([0.0, *(h * 1e-3 for *_, h in layers)])
    faces = [
        Interface(f"face-{i}", Segment((-5.0, z), (5.0, z)), names[i + 1], names[i]) for i, z in enumerate(heights)
    ]
    media = [Region("air", 1.0)]
    media += [Region(name, index, a) for name, (index, *_), a in zip(names[1:3], layers, per_mm, strict=True)]
    behind, before = (Monitor(name, (-5.0, z), (5.0, z)) for name, z in (("behind", 1.0), ("before", -0.5)))
    ray = Rays(((0.0, -1.0),), ((0.0, 1.0),))
    fine = Limits(min_weight=1e-15, max_hits=1000)
    result = trace(Scene(tuple(media), tuple(faces), (ray,), (behind, before), open_media=True), "power", limits=fine)
    read = on_substrate(n, k, LAYER_UM, NM, Setup(sheet, side=side, baseline="air"))
    assert result.monitors["behind"].power == pytest.approx(float(read.T), abs=1e-9)
    assert result.ledger.escaped == pytest.approx(float(read.T + read.R), abs=1e-9)


@pytest.mark.parametrize("baseline", ["air", "substrate"])
@pytest.mark.parametrize("baseline_r", ["air", "substrate"])
def test_a_reading_is_the_ratio_to_its_baseline(baseline: Baseline, baseline_r: Baseline) -> None:
    sheet = incoherent([1.57], [1.4e-6], [100.0], NM)
    stack = incoherent((1.47, 1.57), (1e-5, 1.4e-6), (25.0, 100.0), NM)
    read = on_substrate(1.47, 1e-5, LAYER_UM, NM, Setup(PET, baseline=baseline, baseline_r=baseline_r))
    t, r = {"air": 1.0, "substrate": sheet.through}[baseline], {"air": 1.0, "substrate": sheet.front}[baseline_r]
    assert float(read.T) == pytest.approx(float(stack.through / t), abs=1e-15)
    assert float(read.R) == pytest.approx(float(stack.front / r), abs=1e-15)


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ((1.57, 0.0, 0.0), "substrate thickness = 0.0; must be above 0 µm"),
        ((0.9, 0.0, 100.0), "substrate n = 0.9; must be at least 1"),
        ((1.57, -1e-6, 100.0), "substrate k = -1e-06; must be at least 0"),
        ((1.57, 0.0, 100.0, -0.1), "substrate u_n = -0.1; must be at least 0"),
    ],
)
def test_refuses_an_invalid_substrate(values: tuple[float, ...], line: str) -> None:
    with pytest.raises(DataError) as error:
        Substrate(*values)
    assert str(error.value) == line
