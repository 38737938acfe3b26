"""The edge fit on images rendered with areas, blur kernels and noise that its model does not assume."""

import numpy as np
import pytest

from tests.metrology.edge_support import lens_edge
from tests.metrology.render.optics import Optics, airy, defocus, gaussian, sharp, smear

KERNELS: dict[str, Optics] = {
    "gaussian 2 px": gaussian(2.0),
    "gaussian 1 px": gaussian(1.0),
    "no blur": sharp(),
    "airy 5 px": airy(5.0),
    "disc 4 px": defocus(4.0),
    "smear 4 px": smear(4.0, 20.0),
}


@pytest.mark.parametrize("kernel", ["gaussian 2 px", "no blur", "airy 5 px", "disc 4 px"])
def test_edge_position_of_rendered_lens(kernel: str) -> None:
    """With noise of 3 % of full scale and a step of 60 %, the bias is below 0.05 px and the RMS error below 0.1 px."""
    measured = lens_edge(KERNELS[kernel], seed=3, sub=1)
    assert measured.edge.kept.mean() > 0.98
    assert abs(measured.error_px.mean()) < 0.05
    assert np.sqrt(np.mean(measured.error_px**2)) < 0.1


@pytest.mark.evidence
@pytest.mark.parametrize("um_per_px", [5.0, 2.0])
@pytest.mark.parametrize("kernel", KERNELS)
def test_edge_positions_of_many_images(kernel: str, um_per_px: float) -> None:
    images, sub = (20, 2) if um_per_px == 5.0 else (5, 1)
    edges = [lens_edge(KERNELS[kernel], seed, um_per_px=um_per_px, sub=sub) for seed in range(images)]
    errors, over_u = (np.concatenate(parts) for parts in zip(*((f.error_px, f.over_u) for f in edges), strict=True))
    within = [np.mean(np.abs(over_u) < k) for k in (1.0, 1.96)]
    rms = np.sqrt(np.mean(errors**2))
    print(
        f"{kernel}, {um_per_px:g} µm/px: {len(errors)} points, bias {errors.mean():+.4f} px, RMS {rms:.4f} px, "
        f"within u {within[0]:.3f}, within 1.96 u {within[1]:.3f}"
    )
    assert abs(errors.mean()) < 0.05
    assert rms < 0.1
