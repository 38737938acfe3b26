"""The sample micrograph, which ``python -m tools.samples`` writes.

It shows a lens of the 860 nm design at 6 µm per pixel, with a bump of 20 µm at x = 0.8 mm and a dimple of 15 µm at
x = −0.6 mm, rotated by 4°, in uneven illumination and with dust. The image model is that of the tests: pixel coverage,
blur by the Airy disc, noise.
"""

import io

import numpy as np
import tifffile
from numpy.typing import NDArray

from tests.metrology.render.camera import Camera
from tests.metrology.render.micrograph import Scene, reflected
from tests.metrology.render.optics import airy
from tests.metrology.render.scenery import dust, fibres, gradient
from tests.metrology.render.shape import Placing, bump, outline_mm, shipped

NAME = "lens-simulated.ome.tif"
UM_PER_PX, ROTATION_DEG = 6.0, 4.0
BUMP_UM, BUMP_X_MM = 20.0, 0.8
DIMPLE_UM, DIMPLE_X_MM = -15.0, -0.6
WIDTH_MM = 0.08
SIZE_PX = (360, 740)


def printed(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lens surface with its bump and its dimple."""
    return bump(DIMPLE_X_MM, DIMPLE_UM, WIDTH_MM)(bump(BUMP_X_MM, BUMP_UM, WIDTH_MM)(points))


def micrograph() -> bytes:
    """Return an OME-TIFF file, 8 bits, with the scale, and the word "simulated" in its description."""
    placing = Placing(UM_PER_PX, (365.0, 345.0), ROTATION_DEG)
    scenery = [gradient(0.25, 30.0), dust(10, 2.5, -0.7), fibres(1, 90.0, 2.5, -0.5)]
    levels = reflected(outline_mm(shipped(), printed), placing, step=0.5, optics=airy(3.5))
    image = Scene(SIZE_PX, levels, scenery=scenery, camera=Camera(noise=0.008), sub=3).taken(23)
    return _ome_tiff((image // 2) * 2)  # the last bit is noise, and half of the file size


def _ome_tiff(levels: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    metadata = {
        "axes": "YX",
        "Name": "simulated",
        "Description": "simulated: a lens of the 860 nm design with a bump and a hollow",
        "PhysicalSizeX": UM_PER_PX,
        "PhysicalSizeXUnit": "µm",
        "PhysicalSizeY": UM_PER_PX,
        "PhysicalSizeYUnit": "µm",
        "UUID": "urn:uuid:00000000-0000-0000-0000-000000000000",
    }
    tifffile.imwrite(file, levels, ome=True, metadata=metadata, compression="zlib", predictor=True, software="solen")
    return file.getvalue()
