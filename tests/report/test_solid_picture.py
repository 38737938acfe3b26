"""The image of a solid: it covers its projection, and nearer faces hide those behind."""

import math

import numpy as np
import pytest
from matplotlib.text import Text
from numpy.typing import NDArray

from solen.curve import Segment
from solen.fabricate import Export, Mesh, Part, Prism, mesh_of
from solen.geometry import Face
from solen.report import canvas
from solen.report.print.fabricate import export_figure, rendered
from solen.sensor import Sensor
from tests.fabricate.solid_support import design, part_of, seated


def box(x: float, width: float, length: float, low: float, high: float) -> Prism:
    corners = [(x, 0.0), (x + width, 0.0), (x + width, length), (x, length)]
    sides = zip(corners, [*corners[1:], corners[0]], strict=True)
    return Prism(f"box at {x}", (tuple(Face(f"side-{i}", Segment(a, b)) for i, (a, b) in enumerate(sides)),), low, high)


def mesh(*prisms: Prism) -> Mesh:
    return mesh_of(Part("boxes", prisms), 1e-3)


def covered(image: NDArray[np.float64], extent: tuple[float, float, float, float]) -> float:
    """Area of the image that is not transparent."""
    pixel = (extent[1] - extent[0]) / image.shape[1]
    return float(np.count_nonzero(image[..., 3]) * pixel * pixel)


def seen_from(rise_deg: float) -> NDArray[np.float64]:
    """Directions to the right, upwards and towards an observer who looks along Y from above."""
    rise = math.radians(rise_deg)
    towards = np.array([0.0, -math.cos(rise), math.sin(rise)])
    return np.column_stack([[1.0, 0.0, 0.0], np.cross(towards, [1.0, 0.0, 0.0]), towards])


@pytest.mark.parametrize("rise_deg", [10.0, 45.0, 80.0])
def test_box_covers_its_projection(rise_deg: float) -> None:
    """The area is width · (length sin + height cos), to within a border of one pixel."""
    solid = mesh(box(0.0, 3.0, 5.0, 0.0, 2.0))
    image, extent = rendered(solid.vertices @ seen_from(rise_deg), solid.triangles)
    rise = math.radians(rise_deg)
    high = 5.0 * math.sin(rise) + 2.0 * math.cos(rise)
    pixel = (extent[1] - extent[0]) / image.shape[1]
    assert covered(image, extent) == pytest.approx(3.0 * high, abs=2 * pixel * (3.0 + high))


def test_nearer_faces_hide_those_behind() -> None:
    """From above, the image of a high box next to a low one does not depend on the order of the triangles."""
    boxes = mesh(box(0.0, 2.0, 2.0, 0.0, 5.0), box(3.0, 2.0, 2.0, 0.0, 1.0))
    image, extent = rendered(boxes.vertices @ np.eye(3), boxes.triangles)
    reversed_order, _ = rendered(boxes.vertices @ np.eye(3), boxes.triangles[::-1])
    assert np.array_equal(image, reversed_order)
    assert covered(image, extent) == pytest.approx(8.0, abs=0.1)


def test_draws_figure_with_and_without_seats() -> None:
    for variant in (design(), seated()):
        part = part_of(variant)
        figure = export_figure(Export(variant, Sensor.of(variant).body(), 1e-2))
        texts = [text.get_text() for text in figure.findobj(Text)]
        assert any("Paper 860 nm" in text for text in texts)
        assert any("slots" in text for text in texts) == bool(part.cuts)
        assert canvas.encoded(figure, ".png", "solid").startswith(b"\x89PNG")
