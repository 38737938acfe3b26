"""Parts whose lens differs by height: solids, meshes and layers, held to sections that are found by bisection here."""

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
    """A body 1 mm thick with slabs of 0.25 mm."""
    lens = {"lens.shape": "layered", "lens.layer_mm": 0.25}
    return with_values(design(), SPACE | lens | {key.replace("__", "."): value for key, value in values.items()})


def smooth() -> Design:
    return with_values(design(), SPACE | {"lens.shape": "line-focus", "lens.y_focus_mm": FOCUS_Y})


def smooth_z(x: NDArray[np.float64], y: float) -> NDArray[np.float64]:
    """The surface |P − E| − n √((ρ − ρ₀)² + y²) = const, by bisection along z from the vertex's side."""
    low, high = np.full_like(x, -0.5), np.full_like(x, 2.5)
    for _ in range(60):
        z = (low + high) / 2
        ring = F + FOCUS_Y
        rest = np.sqrt(x * x + y * y + (z + S) ** 2) - S + INDEX * (FOCUS_Y - np.hypot(np.hypot(x, F - z) - ring, y))
        low, high = np.where(rest > 0, z, low), np.where(rest > 0, high, z)
    return (low + high) / 2


def layer_z(x: NDArray[np.float64], y: float) -> NDArray[np.float64]:
    """A layer's profile by Euler's midpoint rule in 20,000 steps, from Snell's law in projection."""
    steps = 20_000
    h, z, places = HALF / steps, 0.0, [0.0]

    def slope(x: float, z: float) -> float:
        r, s = math.hypot(x, z + S), math.hypot(x, F - z)
        beta2 = y * y / (r * r + y * y)
        n1, n2 = math.sqrt(1 - beta2), math.sqrt(INDEX**2 - beta2)
        return -(n1 * x / r + n2 * x / s) / (n1 * (z + S) / r - n2 * (F - z) / s)

    for i in range(steps):
        middle = z + 0.5 * h * slope(i * h, z)
        z += h * slope((i + 0.5) * h, middle)
        places.append(z)
    return np.interp(np.abs(x), np.linspace(0.0, HALF, steps + 1), places)


def area_before_base(z: NDArray[np.float64], x: NDArray[np.float64], base: float) -> float:
    return float(np.trapezoid(base - z, x))


X = np.linspace(-HALF, HALF, 8001)


def exact_area(chosen: Design, y: float) -> float:
    """Area of a section: that of the body behind the base, and the lens's before it."""
    body = body_of(chosen)
    base = body.marks["stem-base"][1]
    behind = body.area_mm2() - area_before_base(smooth_z(X, 0.0), X, base)
    z = smooth_z(X, y) if chosen.lens.shape == "line-focus" else layer_z(X, y)
    return behind + area_before_base(z, X, base)


@pytest.mark.parametrize("chosen", [layered(), smooth()], ids=["layered", "line-focus"])
def test_a_mesh_is_closed_and_of_the_exact_volume(chosen: Design) -> None:
    part = part_of(chosen)
    mesh = mesh_of(part, 1e-3)
    seen = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert seen.is_watertight
    heights = (
        [-0.375, -0.125, 0.125, 0.375]
        if chosen.lens.shape == "layered"
        else 0.5 * np.polynomial.legendre.leggauss(8)[0]
    )
    weights = np.full(4, 0.25) if chosen.lens.shape == "layered" else 0.5 * np.polynomial.legendre.leggauss(8)[1]
    exact = HEIGHT * float(weights @ [exact_area(chosen, float(y)) for y in heights])
    assert part.volume_mm3 == pytest.approx(exact, rel=2e-6)
    assert seen.volume == pytest.approx(exact, rel=1e-4)
    if chosen.lens.shape == "line-focus":
        front = mesh.vertices[(np.abs(mesh.vertices[:, 0]) < 1.9) & (mesh.vertices[:, 1] < 1.0)]
        off = [abs(point[1] - smooth_z(point[:1], 0.5 * HEIGHT - point[2])[0]) for point in front[::40]]
        assert max(off) < 1e-3


@pytest.mark.parametrize("chosen", [layered(), smooth()], ids=["layered", "line-focus"])
def test_layers_show_the_exact_area_of_their_section(chosen: Design) -> None:
    slicing = Slicing(layer_um=125.0 if chosen.lens.shape == "layered" else 100.0)
    job = Job(solid_of(part_of(chosen), np.eye(3)), printer_of("generic"), slicing)
    layers = list(job.layers())
    assert len(layers) == round(1e3 * HEIGHT / slicing.layer_um)
    for layer in layers[:: len(layers) // 2]:
        y = 0.5 * HEIGHT - 0.5 * (layer.from_mm + layer.to_mm)
        if chosen.lens.layer_mm is not None:  # the middle of the slab that it lies in
            y = (math.floor(y / 0.25) + 0.5) * 0.25
        assert layer.area_mm2 == pytest.approx(exact_area(chosen, y), rel=1e-4)
    assert layers[0].area_mm2 == pytest.approx(layers[-1].area_mm2, rel=1e-6)


@pytest.mark.parametrize(("chosen", "solids"), [(layered(), 4), (smooth(), 1)], ids=["layered", "line-focus"])
def test_step_read_back(chosen: Design, solids: int, tmp_path: Path) -> None:
    pytest.importorskip("OCP", reason="needs the extra cad")
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.TopAbs import TopAbs_SOLID

    from tests.fabricate.test_step_files import pieces, read, volume

    chosen = with_values(chosen, {"lens.half_width_mm": 1.0, "fabricate.mark": True})
    part = part_of(chosen)
    shape = read(as_step(part, label_of(chosen, "")), tmp_path)
    assert BRepCheck_Analyzer(shape).IsValid()
    assert len(pieces(shape, TopAbs_SOLID)) == solids
    assert volume(shape) == pytest.approx(part.volume_mm3, rel=1e-6)


def test_layers_count_from_the_plate() -> None:
    """Where the last layer is higher, it is the one farthest from the plate, y = −thickness / 2."""
    part = part_of(layered(lens__layer_mm=0.3))
    assert [prism.height_mm for prism in part.prisms] == pytest.approx([0.3, 0.3, 0.4])


def test_a_drawing_is_refused_and_says_what_to_take(tmp_path: Path) -> None:
    for kind in ("dxf", "svg", "comsol"):
        with pytest.raises(DesignError) as refusal:
            FORMATS[kind].write(Export(layered(), body_of(layered())))
        assert all(word in str(refusal.value) for word in ("layered", "--step", "cartesian-oval"))
    with pytest.raises(DesignError, match="slots"):
        part_of(with_values(layered(), SEATED))
    made = export(layered(), tmp_path, ["stl"])
    assert made.result.pieces == 1
    assert made.result.area_mm2 == pytest.approx(body_of(layered()).area_mm2())


def test_the_lens_takes_the_printers_layers_where_it_states_none(tmp_path: Path) -> None:
    free = with_values(layered(), {"lens.layer_mm": None})
    assert cut_for(free, 25.0) is free
    assert cut_for(free, 50.0).lens.layer_mm == 0.05
    assert cut_for(layered(), 50.0).lens.layer_mm == 0.25
    made = export(free, tmp_path, slicing=Slicing(layer_um=100.0))
    assert "note: the lens has 10 profiles" in " ".join(made.result.warnings)
    with zipfile.ZipFile(made.files["layers"]) as archive:
        shown = json.loads(archive.read("job.json"))["layers"]
    assert len({layer["area_mm2"] for layer in shown}) == 5  # of ten, two by two alike


@pytest.mark.parametrize(
    ("slicing", "words"),
    [
        (Slicing(layer_um=100.0), ("4 profiles", "100 µm")),
        (Slicing(layer_um=100.0, orientation="on-edge"), ("do not use", "flat")),
        (Slicing(layer_um=100.0, rotate_deg=(180.0, 0.0, 0.0)), ("do not use", "flat")),
    ],
)
def test_the_sheet_says_how_it_must_lie(slicing: Slicing, words: tuple[str, ...]) -> None:
    made = printable_design(layered(), part_of(layered()), Path("a.toml"), slicing)
    shown = layered_print(Job(made.solid, printer_of("anycubic-photon-mono-m5s"), slicing), made, "a.stl", None)
    assert all(word in " ".join(shown.warnings) for word in words)
    assert "parallel to the plate" in as_sheet(shown.settings, shown.warnings)
