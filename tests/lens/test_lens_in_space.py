"""Lenses for skew rays: one with a line focus, and one with a profile for each layer."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError, DesignError, SpecError
from solen.lens import (
    LayeredLens,
    LayeredLensFromFile,
    LayerProfiles,
    LineFocusLens,
    OvalLens,
    layers_text,
    lens_of,
    read_layers,
)
from solen.plane import unit
from solen.refraction import refracted
from solen.spec import Design, with_values

PAPER = {"distance_mm": 1.0, "focus_mm": 20.0, "half_width_mm": 2.0, "design_index": 1.44}
OVAL = OvalLens(**PAPER)
LINE_FOCUS_LENSES = [LineFocusLens(**PAPER, y_focus_mm=focus) for focus in (2.0, 3.0, 10.0, math.inf)]
X = np.linspace(-2.0, 2.0, 81)


def refracted_in_space(lens: LineFocusLens, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Point where the emitter's ray meets the surface, and its direction behind it, by the gradient and Snell's law."""
    z = float(lens.z_at(np.array(x), np.array(y)))
    at, step = np.array([x, y, z]), 1e-5
    normal = np.array([
        (float(lens.residual_mm(*(at + d))) - float(lens.residual_mm(*(at - d)))) / (2 * step)
        for d in step * np.eye(3)
    ])  # fmt: skip
    normal /= np.linalg.norm(normal)
    ray = at + np.array([0.0, 0.0, lens.distance_mm])
    ray /= np.linalg.norm(ray)
    cos, ratio = -ray @ normal, 1.0 / lens.design_index
    return at, ratio * ray + (ratio * cos - math.sqrt(1.0 - ratio**2 * (1.0 - cos**2))) * normal


@pytest.mark.parametrize("lens", LINE_FOCUS_LENSES, ids=lambda lens: lens.y_focus)
def test_every_ray_crosses_the_focal_line(lens: LineFocusLens) -> None:
    for x, y in ((0.3, 0.0), (1.9, 0.5), (-1.2, 1.9), (0.7, -1.4), (2.0, 2.0)):
        at, d = refracted_in_space(lens, x, y)
        assert at[0] + d[0] / d[2] * (lens.focus_mm - at[2]) == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("lens", LINE_FOCUS_LENSES, ids=lambda lens: lens.y_focus)
def test_light_diverges_in_y_as_from_the_virtual_focus(lens: LineFocusLens) -> None:
    """In planes through the focal line, all rays come from one circle, or are perpendicular to the line."""
    for x, y in ((0.3, 0.4), (1.9, 0.5), (-1.2, 1.9)):
        at, d = refracted_in_space(lens, x, y)
        towards = np.array([-at[0], 0.0, lens.focus_mm - at[2]])
        radius = np.linalg.norm(towards)
        slope = d[1] / (d @ towards / radius)
        assert slope == pytest.approx(at[1] / (lens.focus_mm + lens.y_focus_mm - radius), abs=1e-7)


@pytest.mark.parametrize("lens", LINE_FOCUS_LENSES, ids=lambda lens: lens.y_focus)
def test_the_middle_section_is_the_oval(lens: LineFocusLens) -> None:
    assert lens.z_at(X, 0.0 * X) == pytest.approx(OVAL.z_mm(X), abs=1e-12)


def test_a_single_layer_is_the_oval_cylinder() -> None:
    lens = LayeredLens(**PAPER, layer_mm=9.0)
    assert lens.layers == 1
    assert "makes the lens a cylinder" in " ".join(lens.warnings)
    assert "only 2 profiles" in " ".join(LayeredLens(**PAPER, layer_mm=2.0).warnings)
    assert not LayeredLens(**PAPER, layer_mm=1.0).warnings
    assert lens.z_at(X, np.full_like(X, 1.7)) == pytest.approx(OVAL.z_mm(X), abs=1e-9)


def test_profiles_refract_their_rays_to_the_focus_in_projection() -> None:
    """Snell's law with √(n² − β²), at slopes from differences of the profiles."""
    lens = LayeredLens(**PAPER, layer_mm=0.25)
    for layer, x in ((0, 0.4), (0, 1.9), (5, -1.3), (11, 2.0)):
        step = 1e-5 if abs(x) < 2.0 else -1e-5
        depths = lens.profile_mm(np.array([layer, layer]), np.array([x, x + step]))
        slope = float(depths[1] - depths[0]) / step
        r = math.hypot(x, depths[0] + 1.0)
        beta = lens.middles_mm[layer] / math.hypot(r, lens.middles_mm[layer])
        inside = refracted(
            unit((x, float(depths[0]) + 1.0)), unit((slope, -1.0)), math.sqrt(1 - beta**2), math.sqrt(1.44**2 - beta**2)
        )
        assert inside is not None
        assert x + inside[0] / inside[1] * (20.0 - float(depths[0])) == pytest.approx(0.0, abs=2e-3)


def test_sizes_of_the_papers_layered_lens() -> None:
    lens = LayeredLens(**PAPER)
    assert lens.layers == 160
    assert lens.edges_mm[[0, -1]].tolist() == [-2.0, 2.0]
    assert lens.deepest_mm == pytest.approx(1.811, abs=1e-3)
    assert lens.edge_depth_at_top_mm == pytest.approx(1.168, abs=6e-3)  # at mid-height of the last layer
    assert lens.widest_ledge_um < 10.5
    assert not lens.warnings


@pytest.mark.parametrize(("layer_mm", "layers", "last_mm"), [(0.03, 133, 0.04), (0.15, 27, 0.1), (0.16, 25, 0.16)])
def test_a_lens_has_the_layers_that_a_printer_makes(layer_mm: float, layers: int, last_mm: float) -> None:
    """A layer is printed if its mid-height is in the body; a note names the last one if it has another height."""
    lens = LayeredLens(**PAPER, layer_mm=layer_mm)
    assert lens.layers == layers
    assert np.diff(lens.edges_mm) == pytest.approx([last_mm, *[layer_mm] * (layers - 1)])
    words = f"a body of 4 mm has {layers - 1} layers of {layer_mm:g} mm and a last layer of {last_mm:g}"
    assert [words in warning for warning in lens.warnings] == [True] * (last_mm != layer_mm)


def test_the_nearest_focus_that_confines_light() -> None:
    lens = LineFocusLens.confining(LineFocusLens(**PAPER))
    largest_dy = [
        abs(refracted_in_space(focused, x, 2.0)[1][1])
        for focused in (lens, LineFocusLens(**PAPER, y_focus_mm=lens.y_focus_mm - 0.01))
        for x in (0.0,)
    ]
    max_dy = math.sqrt(1.0 - 1.0 / 1.44**2)
    assert largest_dy[0] <= max_dy < largest_dy[1]
    assert not lens.warnings
    (warning,) = LineFocusLens(**PAPER, y_focus_mm=lens.y_focus_mm - 0.01).warnings
    assert all(word in warning for word in ("lens.y_focus_mm = 1.908", "leaks", '"body"'))


def test_a_lens_has_the_values_of_its_design() -> None:
    design = with_values(
        Design(name="a", material={"index": 1.44}),
        {"emitter.pattern": "lambertian", "trace.dimension": "extruded", "lens.shape": "line-focus"},
    )
    body = lens_of(design, 1.44)
    assert isinstance(body, LineFocusLens)
    assert body.y_focus_mm == pytest.approx(1.918, abs=2e-3)
    collimated = lens_of(with_values(design, {"lens.y_focus_mm": "collimated"}), 1.44)
    assert isinstance(collimated, LineFocusLens)
    assert math.isinf(collimated.y_focus_mm)
    layered = lens_of(with_values(design, {"lens.shape": "layered", "lens.layer_mm": 0.05}), 1.44)
    assert isinstance(layered, LayeredLens)
    assert layered.layers == 80


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: LineFocusLens(**PAPER, y_focus_mm=1.2), ("line-focus", "|y| = 1.", "increase lens.y_focus_mm")),
        (lambda: LineFocusLens(**PAPER, y_focus_mm=-1.0), ("lens.y_focus_mm", "-1")),
        (lambda: LineFocusLens(**PAPER, thickness_mm=0.0), ("body.thickness_mm", "0")),
        (lambda: LayeredLens(**PAPER, layer_mm=1e-4), ("lens.layer_mm", "0.001")),
        (lambda: LayeredLens(**{**PAPER, "half_width_mm": 2.94}), ("lens.half_width_mm", "2.932")),
        (lambda: LayeredLens(**{**PAPER, "half_width_mm": 2.9}, thickness_mm=40.0), ("layered", "|x| =")),
        (lambda: LineFocusLens.confining(LineFocusLens(**{**PAPER, "design_index": 1.4})), ("body", "collimated")),
    ],
)
def test_refuses_impossible_lenses(make: object, expected: tuple[str, ...]) -> None:
    with pytest.raises(DesignError) as refusal:
        make()  # type: ignore[operator]
    assert all(word in str(refusal.value) for word in expected)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"lens.shape": "layered"}, ("extruded", "2d")),
        ({"lens.y_focus_mm": 2.0}, ("y_focus_mm", "cartesian-oval")),
        ({"lens.layer_mm": 0.05}, ("layer_mm", "cartesian-oval")),
        ({"lens.shape": "line-focus", "lens.y_focus_mm": "nowhere", "trace.dimension": "extruded"}, ("y_focus_mm",)),
    ],
)
def test_refuses_keys_without_effect(values: dict[str, object], expected: tuple[str, ...]) -> None:
    design = with_values(Design(name="a", material={"index": 1.44}), {"emitter.pattern": "lambertian"})
    with pytest.raises(SpecError) as refusal:
        with_values(design, values)
    assert all(word in str(refusal.value) for word in expected)


def layers_file(folder: Path, **changes: object) -> Path:
    """File of the layers of a lens, with some keys changed."""
    lens = LayeredLens(**PAPER, layer_mm=0.5)
    text = layers_text(LayerProfiles("a print", 2.0, lens.edges_mm, lens.profiles[0] + 0.01, simulated=True))
    path = folder / "layers.json"
    path.write_text(json.dumps(json.loads(text) | changes))
    return path


def test_profiles_from_a_file_replace_the_designed_ones(tmp_path: Path) -> None:
    values = {"emitter.pattern": "lambertian", "trace.dimension": "extruded", "lens.shape": "layered"}
    design = with_values(
        Design(name="a", material={"index": 1.44}), values | {"lens.profile": str(layers_file(tmp_path))}
    )
    lens, designed = lens_of(design, 1.44), LayeredLens(**PAPER, layer_mm=0.5)
    assert isinstance(lens, LayeredLensFromFile)
    assert lens.simulated
    y = np.full_like(X, 1.2)
    assert lens.z_at(X, y) == pytest.approx(designed.z_at(X, y) + 0.01, abs=1e-8)
    assert lens.slope_at(X, y) == pytest.approx(designed.slope_at(X, y), abs=1e-5)
    assert (lens.nearest_mm, lens.face.min_z) == pytest.approx((0.01, 0.01))
    assert read_layers(layers_file(tmp_path)).edges_mm == pytest.approx(designed.edges_mm)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"solen": "something else"}, ("layers of a lens", "print predict")),
        ({"schema": 9}, ("schema", "9")),
        ({"edges_mm": [-2.0, 2.0]}, ("edges_mm = 2", "8 rows")),
        ({"z_mm": [[0.0, 1.0], [0.0]]}, ("z_mm", "rows")),
        ({"half_width_mm": 1.0}, ("lens.half_width_mm", "1 mm")),
        ({"colour": "red"}, ("colour",)),
    ],
)
def test_refuses_invalid_layer_files(changes: dict[str, object], expected: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(DataError) as refusal:
        LayeredLensFromFile(**PAPER, layer_mm=0.5, file=read_layers(layers_file(tmp_path, **changes)))
    assert all(word in str(refusal.value) for word in expected)


def test_lenses_with_different_profiles_are_unequal(tmp_path: Path) -> None:
    """Bodies are cached by their lens: one print must not be traced in place of another."""
    profiles = read_layers(layers_file(tmp_path))
    lens = LayeredLensFromFile(**PAPER, layer_mm=0.5, file=profiles)
    assert lens == LayeredLensFromFile(**PAPER, layer_mm=0.5, file=profiles)
    assert lens != LayeredLensFromFile(**PAPER, layer_mm=0.5, file=read_layers(layers_file(tmp_path)))
    assert lens != LayeredLens(**PAPER, layer_mm=0.5)
