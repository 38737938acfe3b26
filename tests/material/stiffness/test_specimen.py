"""Dimensions of specimens, by options and by files, and what held ends do."""

import math
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve

from solen.errors import DataError, SpecError
from solen.material.stiffness import Dimensions, bonded_ratio, specimen_of
from solen.material.stiffness.specimen import number_in


def test_a_cube() -> None:
    found = specimen_of(Dimensions(cube_mm=10, u_geometry_mm=0.05))
    assert (found.length_mm, found.area_mm2) == (10, 100)
    assert found.shape_factor == pytest.approx(0.25)
    assert found.u_length == pytest.approx(0.005)
    assert found.u_area == pytest.approx(0.005 * math.sqrt(2))
    assert found.source == "--cube-mm 10"


def test_sections() -> None:
    strip = specimen_of(Dimensions(strip_width_mm=6, thickness_mm=3, length_mm=33, u_geometry_mm=0.01))
    assert strip.area_mm2 == 18
    assert strip.shape_factor == pytest.approx(18 / (18 * 33))
    assert strip.u_area == pytest.approx(math.hypot(0.01 / 6, 0.01 / 3))
    rod = specimen_of(Dimensions(diameter_mm=4, length_mm=8, u_geometry_mm=0.01))
    assert rod.area_mm2 == pytest.approx(math.pi * 4)
    assert rod.shape_factor == pytest.approx(4 / (4 * 8))
    assert rod.u_area == pytest.approx(0.005)
    assert specimen_of(Dimensions(area_mm2=25)).shape_factor is None


def test_a_file_states_what_the_user_does_not() -> None:
    metadata = {
        "Probenbreite b0": "11,4 mm",
        "Probendicke a0": "0.2 mm",
        "Einspannlänge": "832.756 mm",
        "Messlänge": "?",
    }
    found = specimen_of(Dimensions(), metadata)
    assert found.area_mm2 == pytest.approx(2.28)
    assert found.length_mm == 832.756
    assert found.source == "Einspannlänge of the file, Probenbreite b0 of the file, Probendicke a0 of the file"
    ours = specimen_of(Dimensions(area_mm2=3, length_mm=80), metadata)
    assert ours.area_mm2 == pytest.approx(3)
    assert ours.length_mm == 80
    assert ours.length_by_user
    assert not found.length_by_user


def test_headings_with_units() -> None:
    found = specimen_of(Dimensions(), {"Specimen Length (cm)": "3.3", "Specimen Cross-section (cm^2)": "0.18"})
    assert found.length_mm == pytest.approx(33)
    assert found.area_mm2 == pytest.approx(18)


@pytest.mark.parametrize(
    ("text", "heading", "value"),
    [
        *(("11.4 mm", "", 11.4), ("1,14 cm", "", 11.4), ("11.4", "Width (mm)", 11.4), ("11.4", "", 11.4)),
        *(("1 N", "", None), ("nicht bekannt", "", None), ("", "", None), ("3 4", "", None)),
    ],
)
def test_a_number_in_a_text(text: str, heading: str, value: float | None) -> None:
    assert number_in(text, "mm", heading) == (None if value is None else pytest.approx(value))


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        ({"length_mm": 0.0}, "length_mm = 0.0; must be greater than 0"),
        ({"cube_mm": -10.0}, "cube_mm = -10.0; must be greater than 0"),
        ({"area_mm2": math.nan}, "area_mm2 = nan; must be"),
        ({"strip_width_mm": 5.0}, "requires both --strip-width-mm and --thickness-mm"),
        ({"area_mm2": 5.0, "diameter_mm": 2.0}, "more than one way"),
        ({"cube_mm": 10.0, "length_mm": 9.0}, "a cube's length is its side"),
        ({"cube_mm": 10.0, "u_geometry_mm": -1.0}, "u_geometry_mm = -1.0; must be at least 0"),
    ],
)
def test_impossible_dimensions_are_refused(stated: dict[str, float], told: str) -> None:
    with pytest.raises(SpecError, match=told.replace("(", r"\(")):
        Dimensions(**stated)


def test_a_file_with_a_length_of_zero_is_refused() -> None:
    with pytest.raises(DataError, match="Einspannlänge = '0 mm'; must be above 0"):
        specimen_of(Dimensions(), {"Einspannlänge": "0 mm"})


def test_held_ends_of_limits() -> None:
    assert bonded_ratio(0.001) == pytest.approx(1, abs=0.001)
    assert bonded_ratio(0.25) == 1.232
    assert bonded_ratio(5.0) is None


@pytest.mark.parametrize(("height", "shape_factor"), [(1.0, 0.25), (2.0, 0.125), (0.5, 0.5)])
def test_held_ends_by_finite_elements(height: float, shape_factor: float) -> None:
    """The table against elements of our own on an eighth of a block, two meshes extrapolated."""
    coarse, fine = apparent_modulus(4, height, held=True), apparent_modulus(8, height, held=True)
    assert bonded_ratio(shape_factor) == pytest.approx(2 * fine - coarse, rel=0.005)  # the error falls as 1/n


def test_sliding_ends_show_the_material() -> None:
    assert apparent_modulus(3, 1.0, held=False) == pytest.approx(1, rel=1e-6)


@cache
def apparent_modulus(cells: int, height: float, *, held: bool) -> float:
    """Stress over strain of a compressed block, Young's modulus 1, Poisson's ratio 0.49999, eight-node bricks.

    The volume's strain is averaged over each brick (B-bar; Hughes 1980), or they would lock.
    """
    corners = np.array(list(product((0, 1), repeat=3)))
    strain_of = _strain_matrices(2 * corners - 1, np.array([1, 1, height]) / cells)
    shear, first = 1 / (2 * 1.49999), 0.49999 / (1.49999 * 0.00002)
    stiff = np.diag([2 * shear] * 3 + [shear] * 3)
    stiff[:3, :3] += first
    element = sum(b.T @ stiff @ b for b in strain_of) * height / cells**3 / 8
    nodes = np.arange((cells + 1) ** 3).reshape((cells + 1,) * 3)
    starts = np.array(list(product(range(cells), repeat=3)))
    connected = nodes[tuple((starts[:, None, :] + corners[None]).transpose(2, 0, 1))]
    freedoms = (3 * connected[:, :, None] + np.arange(3)).reshape(len(starts), 24)
    rows, columns = np.repeat(freedoms, 24, axis=1).ravel(), np.tile(freedoms, (1, 24)).ravel()
    matrix = csc_matrix((np.tile(element.ravel(), len(starts)), (rows, columns)))
    top = nodes[:, :, -1].ravel()
    fixed = np.concatenate(
        [3 * nodes[0].ravel(), 3 * nodes[:, 0].ravel() + 1, 3 * nodes[:, :, 0].ravel() + 2, 3 * top + 2]
    )
    if held:
        fixed = np.concatenate([fixed, 3 * top, 3 * top + 1])
    moved = np.zeros(3 * nodes.size)
    moved[3 * top + 2] = -0.01 * height
    free = np.setdiff1d(np.arange(3 * nodes.size), fixed)
    moved[free] = spsolve(matrix[free][:, free], -(matrix[free] @ moved))
    return float(-(matrix @ moved)[3 * top + 2].sum() / 0.01)


def _strain_matrices(signs: np.ndarray, size: np.ndarray) -> list[np.ndarray]:
    """Strain (xx, yy, zz, xy, yz, xz) by the 24 displacements, at the eight points of integration."""
    gradients = []
    for point in signs / np.sqrt(3):
        shape = (1 + signs * point) / 2
        others = np.stack([shape[:, [1, 2]].prod(1), shape[:, [0, 2]].prod(1), shape[:, [0, 1]].prod(1)], axis=1)
        gradients.append(signs / 2 * others * 2 / size)
    mean = np.mean(gradients, axis=0)
    found = []
    for gradient in gradients:
        b = np.zeros((6, 24))
        for direction in range(3):
            b[direction, direction::3] = gradient[:, direction]
            b[:3, direction::3] += (mean[:, direction] - gradient[:, direction]) / 3
        for row, (one, other) in enumerate([(0, 1), (1, 2), (0, 2)], start=3):
            b[row, one::3] = gradient[:, other]
            b[row, other::3] = gradient[:, one]
        found.append(b)
    return found
