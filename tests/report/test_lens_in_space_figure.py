"""The figure of a lens that is not a cylinder shows its face, and profiles at several heights."""

import numpy as np

from solen.lens import LayeredLens
from solen.report.design.lens import profile_figure


def test_draws_face_and_profiles() -> None:
    lens = LayeredLens(1.0, 20.0, 2.0, 1.44, thickness_mm=4.0)
    solid, profiles = profile_figure(lens).axes
    assert (solid.name, solid.get_zlabel()) == ("3d", "z (mm)")  # type: ignore[attr-defined]  # of three dimensions
    middle, *_, top = profiles.get_lines()
    x, z = np.asarray(middle.get_data())
    assert np.abs(z - lens.middle.z_mm(x)).max() < 1e-3
    assert float(np.max(np.asarray(top.get_data())[1])) == lens.edge_depth_at_top_mm
