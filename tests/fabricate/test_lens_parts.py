"""Parts with lenses that vary with height: solids, meshes and layers agree with independently computed sections."""

import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from solen.errors import DesignError
from solen.fabricate import FORMATS, Export, as_step, cut_for, label_of, mesh_of
from solen.fabricate.layers import Job, Slicing, as_sheet, layered_print, printable_design, solid_of
from solen.parts import printer_of
from solen.pipeline.design.export import export
from solen.spec import Design, with_values
from tests.fabricate.solid_support import HALF, SEATED, F, S, body_of, design, part_of

INDEX, HEIGHT, FOCUS_Y = 1.44, 1.0, 3.0
SPACE = {"emitter.pattern": "lambertian", "trace.dimension": "extruded", "body.thickness_mm": HEIGHT}


def layered(**values: Any) -> Design:
    """Return a design 1 mm thick with a lens of slabs of 0.25 mm."""
    lens = {"lens.shape": "layered", "lens.layer_mm": 0.25}
    return with_values(design(), SPACE | lens | {key.replace("__", "."): value for key, value in values.items()})


def line_focus() -> Design:
    return with_values(design(), SPACE | {"lens.shape": "line-focus", "lens.y_focus_mm": FOCUS_Y})


def line_focus_z(x: NDArray[np.float64], y: float) -> NDArray[np.float64]:
    """Return the surface |P − E| − n √((ρ − ρ₀)² + y²) = const, by bisection along z."""
    low, high = np.full_like(x, -0.5), np.full_like(x, 2.5)
    for _ in range(60):
        z = (low + high) / 2
        ring = F + FOCUS_Y
        image_mm = np.hypot(np.hypot(x, F - z) - ring, y)
        difference = np.sqrt(x * x + y * y + (z + S) ** 2) - S + INDEX * (FOCUS_Y - image_mm)
        low, high = np.where(difference > 0, z, low), np.where(difference > 0, high, z)
    return (low + high) / 2


def layer_z(x: NDArray[np.float64], y: float) -> NDArray[np.float64]:
    """Return the profile of a layer from Snell's law in projection, by the midpoint method in 20,000 steps."""
    steps = 20_000
    h, z, profile = HALF / steps, 0.0, [0.0]

    def slope(x: float, z: float) -> float:
        r, s = math.hypot(x, z + S), math.hypot(x, F - z)
        beta2 = y * y / (r * r + y * y)
        n1, n2 = math.sqrt(1 - beta2), math.sqrt(INDEX**2 - beta2)
        return -(n1 * x / r + n2 * x / s) / (n1 * (z + S) / r - n2 * (F - z) / s)

    for i in range(steps):
        middle = z + 0.5 * h * slope(i * h, z)
        z += h * slope((i + 0.5) * h, middle)
        profile.append(z)
    return np.interp(np.abs(x), np.linspace(0.0, HALF, steps + 1), profile)


def area_before_base(z: NDArray[np.float64], x: NDArray[np.float64], base: float) -> float:
    return float(np.trapezoid(base - z, x))


X = np.linspace(-HALF, HALF, 8001)


def exact_area(lens_design: Design, y: float) -> float:
    """Return the area of a section: that of the body behind the lens, and that of the lens."""
    body = body_of(lens_design)
    base = body.marks["stem-base"][1]
    behind = body.area_mm2() - area_before_base(line_focus_z(X, 0.0), X, base)
    z = line_focus_z(X, y) if lens_design.lens.shape == "line-focus" else layer_z(X, y)
    return behind + area_before_base(z, X, base)


both_lenses = pytest.mark.parametrize("lens_design", [layered(), line_focus()], ids=["layered", "line-focus"])


@both_lenses
def test_meshes_are_closed_and_have_the_exact_volume(lens_design: Design) -> None:
    part = part_of(lens_design)
    mesh = mesh_of(part, 1e-3)
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert solid.is_watertight
    heights, weights = 0.5 * np.array(np.polynomial.legendre.leggauss(8))
    if lens_design.lens.shape == "layered":
        heights, weights = np.array([-0.375, -0.125, 0.125, 0.375]), np.full(4, 0.25)
    exact = HEIGHT * float(weights @ [exact_area(lens_design, y) for y in heights.tolist()])
    assert part.volume_mm3 == pytest.approx(exact, rel=2e-6)
    assert solid.volume == pytest.approx(exact, rel=1e-4)
    if lens_design.lens.shape == "line-focus":
        front = mesh.vertices[(np.abs(mesh.vertices[:, 0]) < 1.9) & (mesh.vertices[:, 1] < 1.0)]
        errors = [abs(point[1] - line_focus_z(point[:1], 0.5 * HEIGHT - point[2])[0]) for point in front[::40]]
        assert max(errors) < 1e-3


@both_lenses
def test_layers_have_the_exact_area_of_their_section(lens_design: Design) -> None:
    slicing = Slicing(layer_um=125.0 if lens_design.lens.shape == "layered" else 100.0)
    job = Job(solid_of(part_of(lens_design), np.eye(3)), printer_of("generic"), slicing)
    layers = list(job.layers())
    assert len(layers) == round(1e3 * HEIGHT / slicing.layer_um)
    for layer in layers[:: len(layers) // 2]:
        y = 0.5 * HEIGHT - 0.5 * (layer.from_mm + layer.to_mm)
        if lens_design.lens.layer_mm is not None:  # the middle of its slab
            y = (math.floor(y / 0.25) + 0.5) * 0.25
        assert layer.area_mm2 == pytest.approx(exact_area(lens_design, y), rel=1e-4)
    assert layers[0].area_mm2 == pytest.approx(layers[-1].area_mm2, rel=1e-6)


@pytest.mark.parametrize(("lens_design", "solids"), [(layered(), 4), (line_focus(), 1)], ids=["layered", "line-focus"])
def test_step_files_have_the_volume(lens_design: Design, solids: int, tmp_path: Path) -> None:
    pytest.importorskip("OCP", reason="needs the extra cad")
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.TopAbs import TopAbs_SOLID

    from tests.fabricate.test_step_files import pieces, read, volume

    marked = with_values(lens_design, {"lens.half_width_mm": 1.0, "fabricate.mark": True})
    part = part_of(marked)
    shape = read(as_step(part, label_of(marked, "")), tmp_path)
    assert BRepCheck_Analyzer(shape).IsValid()
    assert len(pieces(shape, TopAbs_SOLID)) == solids
    assert volume(shape) == pytest.approx(part.volume_mm3, rel=1e-6)


def test_the_last_slab_may_be_higher() -> None:
    """Slabs are counted from the plate, so the higher one is that at y = −thickness / 2."""
    part = part_of(layered(lens__layer_mm=0.3))
    assert [prism.height_mm for prism in part.prisms] == pytest.approx([0.3, 0.3, 0.4])


@pytest.mark.parametrize("kind", ["dxf", "svg", "comsol"])
def test_refuses_drawings_and_names_the_alternatives(kind: str) -> None:
    with pytest.raises(DesignError) as error:
        FORMATS[kind].write(Export(layered(), body_of(layered())))
    assert all(word in str(error.value) for word in ("layered", "--step", "cartesian-oval"))


def test_refuses_slots() -> None:
    with pytest.raises(DesignError, match="slots"):
        part_of(with_values(layered(), SEATED))


def test_an_stl_file_is_one_piece(tmp_path: Path) -> None:
    result = export(layered(), tmp_path, ["stl"]).result
    assert result.pieces == 1
    assert result.area_mm2 == pytest.approx(body_of(layered()).area_mm2())


def test_default_slabs_are_the_layers_of_the_printer(tmp_path: Path) -> None:
    default = with_values(layered(), {"lens.layer_mm": None})
    assert cut_for(default, 25.0) is default
    assert cut_for(default, 50.0).lens.layer_mm == 0.05
    assert cut_for(layered(), 50.0).lens.layer_mm == 0.25
    outcome = export(default, tmp_path, slicing=Slicing(layer_um=100.0))
    assert "10 profiles" in " ".join(outcome.result.warnings)
    with zipfile.ZipFile(outcome.files["layers"]) as archive:
        layers = json.loads(archive.read("job.json"))["layers"]
    assert len({layer["area_mm2"] for layer in layers}) == 5  # the ten layers are symmetric


@pytest.mark.parametrize(
    ("slicing", "words"),
    [
        (Slicing(layer_um=100.0), ("4 profiles", "100 µm")),
        (Slicing(layer_um=100.0, orientation="on-edge"), ("do not use", "flat")),
        (Slicing(layer_um=100.0, rotate_deg=(180.0, 0.0, 0.0)), ("do not use", "flat")),
    ],
)
def test_the_sheet_requires_layers_parallel_to_the_slabs(slicing: Slicing, words: tuple[str, ...]) -> None:
    part = printable_design(layered(), part_of(layered()), Path("a.toml"), slicing)
    result = layered_print(Job(part.solid, printer_of("anycubic-photon-mono-m5s"), slicing), part, "a.stl", None)
    assert all(word in " ".join(result.warnings) for word in words)
    assert "parallel to the plate" in as_sheet(result.settings, result.warnings)
