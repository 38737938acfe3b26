"""The picture of a solid: it covers what a projection says, and what is nearer hides what is behind."""

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


def covered(picture: NDArray[np.float64], extent: tuple[float, float, float, float]) -> float:
    """Area of the picture that is not clear."""
    pixel = (extent[1] - extent[0]) / picture.shape[1]
    return float(np.count_nonzero(picture[..., 3]) * pixel * pixel)


def seen_from(rise_deg: float) -> NDArray[np.float64]:
    """Directions to the right, upwards, towards one who looks along Y from above the front."""
    rise = math.radians(rise_deg)
    towards = np.array([0.0, -math.cos(rise), math.sin(rise)])
    return np.column_stack([[1.0, 0.0, 0.0], np.cross(towards, [1.0, 0.0, 0.0]), towards])


@pytest.mark.parametrize("rise_deg", [10.0, 45.0, 80.0])
def test_a_box_covers_its_projection(rise_deg: float) -> None:
    """Width times (length sin + height cos); the border of one pixel is what may be missing or too much."""
    one = mesh(box(0.0, 3.0, 5.0, 0.0, 2.0))
    picture, extent = rendered(one.vertices @ seen_from(rise_deg), one.triangles)
    rise = math.radians(rise_deg)
    high = 5.0 * math.sin(rise) + 2.0 * math.cos(rise)
    pixel = (extent[1] - extent[0]) / picture.shape[1]
    assert covered(picture, extent) == pytest.approx(3.0 * high, abs=2 * pixel * (3.0 + high))


def test_what_is_nearer_hides_what_is_behind() -> None:
    """From above, a high box beside a low one: every point has the brightness of a top, in whatever order they come."""
    both = mesh(box(0.0, 2.0, 2.0, 0.0, 5.0), box(3.0, 2.0, 2.0, 0.0, 1.0))
    picture, extent = rendered(both.vertices @ np.eye(3), both.triangles)
    backwards, _ = rendered(both.vertices @ np.eye(3), both.triangles[::-1])
    assert np.array_equal(picture, backwards)
    assert covered(picture, extent) == pytest.approx(8.0, abs=0.1)


def test_the_figure_is_drawn_with_seats_and_without() -> None:
    for chosen in (design(), seated()):
        part = part_of(chosen)
        figure = export_figure(Export(chosen, Sensor.of(chosen).body(), 1e-2))
        texts = [text.get_text() for text in figure.findobj(Text)]
        assert any("Paper 860 nm" in text for text in texts)
        assert any("slots" in text for text in texts) == bool(part.cuts)
        assert canvas.encoded(figure, ".png", "solid").startswith(b"\x89PNG")
