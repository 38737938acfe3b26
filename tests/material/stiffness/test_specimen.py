"""Dimensions of specimens from options and files, and the effect of bonded ends."""

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
    specimen = specimen_of(Dimensions(cube_mm=10, u_geometry_mm=0.05))
    assert (specimen.length_mm, specimen.area_mm2) == (10, 100)
    assert specimen.shape_factor == pytest.approx(0.25)
    assert specimen.u_length == pytest.approx(0.005)
    assert specimen.u_area == pytest.approx(0.005 * math.sqrt(2))
    assert specimen.source == "--cube-mm 10"


def test_cross_sections() -> None:
    strip = specimen_of(Dimensions(strip_width_mm=6, thickness_mm=3, length_mm=33, u_geometry_mm=0.01))
    assert strip.area_mm2 == 18
    assert strip.shape_factor == pytest.approx(18 / (18 * 33))
    assert strip.u_area == pytest.approx(math.hypot(0.01 / 6, 0.01 / 3))
    rod = specimen_of(Dimensions(diameter_mm=4, length_mm=8, u_geometry_mm=0.01))
    assert rod.area_mm2 == pytest.approx(math.pi * 4)
    assert rod.shape_factor == pytest.approx(4 / (4 * 8))
    assert rod.u_area == pytest.approx(0.005)
    assert specimen_of(Dimensions(area_mm2=25)).shape_factor is None


def test_dimensions_that_are_not_specified_are_taken_from_the_file() -> None:
    metadata = {
        "Probenbreite b0": "11,4 mm",
        "Probendicke a0": "0.2 mm",
        "Einspannlänge": "832.756 mm",
        "Messlänge": "?",
    }
    specimen = specimen_of(Dimensions(), metadata)
    assert specimen.area_mm2 == pytest.approx(2.28)
    assert specimen.length_mm == 832.756
    assert specimen.source == "Einspannlänge in the file, Probenbreite b0 in the file, Probendicke a0 in the file"
    specified = specimen_of(Dimensions(area_mm2=3, length_mm=80), metadata)
    assert specified.area_mm2 == pytest.approx(3)
    assert specified.length_mm == 80
    assert specified.length_by_user
    assert not specimen.length_by_user


def test_headings_with_units() -> None:
    specimen = specimen_of(Dimensions(), {"Specimen Length (cm)": "3.3", "Specimen Cross-section (cm^2)": "0.18"})
    assert specimen.length_mm == pytest.approx(33)
    assert specimen.area_mm2 == pytest.approx(18)


@pytest.mark.parametrize(
    ("text", "heading", "value"),
    [
        *(("11.4 mm", "", 11.4), ("1,14 cm", "", 11.4), ("11.4", "Width (mm)", 11.4), ("11.4", "", 11.4)),
        *(("1 N", "", None), ("nicht bekannt", "", None), ("", "", None), ("3 4", "", None)),
    ],
)
def test_length_in_a_string(text: str, heading: str, value: float | None) -> None:
    assert number_in(text, "mm", heading) == (None if value is None else pytest.approx(value))


@pytest.mark.parametrize(
    ("dimensions", "line"),
    [
        ({"length_mm": 0.0}, "length_mm = 0.0; must be greater than 0"),
        ({"cube_mm": -10.0}, "cube_mm = -10.0; must be greater than 0"),
        ({"area_mm2": math.nan}, "area_mm2 = nan; must be"),
        ({"strip_width_mm": 5.0}, "thickness_mm; is required with --strip-width-mm"),
        ({"area_mm2": 5.0, "diameter_mm": 2.0}, "is specified by --area-mm2 and --diameter-mm"),
        ({"cube_mm": 10.0, "length_mm": 9.0}, "length_mm; cannot be combined with --cube-mm"),
        ({"cube_mm": 10.0, "u_geometry_mm": -1.0}, "u_geometry_mm = -1.0; must be at least 0"),
    ],
)
def test_refuses_invalid_dimensions(dimensions: dict[str, float], line: str) -> None:
    with pytest.raises(SpecError, match=line):
        Dimensions(**dimensions)


def test_refuses_a_length_of_zero_in_a_file() -> None:
    with pytest.raises(DataError, match="Einspannlänge = '0 mm'; must be above 0"):
        specimen_of(Dimensions(), {"Einspannlänge": "0 mm"})


def test_limits_of_the_bonded_ratio() -> None:
    assert bonded_ratio(0.001) == pytest.approx(1, abs=0.001)
    assert bonded_ratio(0.25) == 1.232
    assert bonded_ratio(5.0) is None


@pytest.mark.parametrize(("height", "shape_factor"), [(1.0, 0.25), (2.0, 0.125), (0.5, 0.5)])
def test_the_bonded_ratio_agrees_with_finite_elements(height: float, shape_factor: float) -> None:
    """An eighth of a block on two meshes, extrapolated."""
    coarse, fine = apparent_modulus(4, height, bonded=True), apparent_modulus(8, height, bonded=True)
    assert bonded_ratio(shape_factor) == pytest.approx(2 * fine - coarse, rel=0.005)  # the error decreases as 1/n


def test_with_sliding_ends_the_modulus_is_that_of_the_material() -> None:
    assert apparent_modulus(3, 1.0, bonded=False) == pytest.approx(1, rel=1e-6)


@cache
def apparent_modulus(cells: int, height: float, *, bonded: bool) -> float:
    """Return stress over strain of a compressed block with Young's modulus 1 and Poisson's ratio 0.49999.

    The volumetric strain is averaged over each eight-node brick (B-bar, Hughes 1980) to prevent volumetric locking.
    """
    corners = np.array(list(product((0, 1), repeat=3)))
    strain_matrices = _strain_matrices(2 * corners - 1, np.array([1, 1, height]) / cells)
    mu, lame = 1 / (2 * 1.49999), 0.49999 / (1.49999 * 0.00002)
    stiffness = np.diag([2 * mu] * 3 + [mu] * 3)
    stiffness[:3, :3] += lame
    element = sum(b.T @ stiffness @ b for b in strain_matrices) * height / cells**3 / 8
    nodes = np.arange((cells + 1) ** 3).reshape((cells + 1,) * 3)
    starts = np.array(list(product(range(cells), repeat=3)))
    connected = nodes[tuple((starts[:, None, :] + corners[None]).transpose(2, 0, 1))]
    components = (3 * connected[:, :, None] + np.arange(3)).reshape(len(starts), 24)
    rows, columns = np.repeat(components, 24, axis=1).ravel(), np.tile(components, (1, 24)).ravel()
    matrix = csc_matrix((np.tile(element.ravel(), len(starts)), (rows, columns)))
    top = nodes[:, :, -1].ravel()
    fixed = np.concatenate(
        [3 * nodes[0].ravel(), 3 * nodes[:, 0].ravel() + 1, 3 * nodes[:, :, 0].ravel() + 2, 3 * top + 2]
    )
    if bonded:
        fixed = np.concatenate([fixed, 3 * top, 3 * top + 1])
    displacement = np.zeros(3 * nodes.size)
    displacement[3 * top + 2] = -0.01 * height
    free = np.setdiff1d(np.arange(3 * nodes.size), fixed)
    displacement[free] = spsolve(matrix[free][:, free], -(matrix[free] @ displacement))
    return float(-(matrix @ displacement)[3 * top + 2].sum() / 0.01)


def _strain_matrices(signs: np.ndarray, size: np.ndarray) -> list[np.ndarray]:
    """Return the matrices from 24 displacements to strain (xx, yy, zz, xy, yz, xz) at the eight integration points."""
    gradients = []
    for point in signs / np.sqrt(3):
        shape = (1 + signs * point) / 2
        others = np.stack([shape[:, [1, 2]].prod(1), shape[:, [0, 2]].prod(1), shape[:, [0, 1]].prod(1)], axis=1)
        gradients.append(signs / 2 * others * 2 / size)
    mean = np.mean(gradients, axis=0)
    matrices = []
    for gradient in gradients:
        b = np.zeros((6, 24))
        for direction in range(3):
            b[direction, direction::3] = gradient[:, direction]
            b[:3, direction::3] += (mean[:, direction] - gradient[:, direction]) / 3
        for row, (first, second) in enumerate([(0, 1), (1, 2), (0, 2)], start=3):
            b[row, first::3] = gradient[:, second]
            b[row, second::3] = gradient[:, first]
        matrices.append(b)
    return matrices
