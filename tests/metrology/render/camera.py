"""The camera: pixel integration, shot and read noise, clipping, and image files."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray


def integrated(fine: FloatArray, sub: int) -> FloatArray:
    """Return the mean over the ``sub`` by ``sub`` sub-pixels of each pixel."""
    rows, columns = fine.shape[0] // sub, fine.shape[1] // sub
    return np.asarray(fine.reshape(rows, sub, columns, sub).mean(axis=(1, 3)))


@dataclass(frozen=True)
class Camera:
    """Noise at full scale, relative to it; the fraction ``shot_fraction`` of its variance is proportional to the light.

    ``bits`` is the bit depth, 0 for floating point.
    """

    noise: float = 0.03
    shot_fraction: float = 0.5
    bits: int = 8

    def levels(self, light: FloatArray, rng: np.random.Generator) -> NDArray[Any]:
        """Return the grey levels of light from 0 to 1."""
        variance = self.noise**2 * (1.0 - self.shot_fraction + self.shot_fraction * np.clip(light, 0.0, None))
        signal = light + np.sqrt(variance) * rng.standard_normal(light.shape)
        if self.bits == 0:
            return signal.astype(np.float32)
        top = 2**self.bits - 1
        dtype = np.uint8 if self.bits <= 8 else np.uint16
        return np.asarray(np.clip(np.rint(top * signal), 0, top).astype(dtype))


def coloured(levels: NDArray[Any], tint: tuple[float, float, float] = (1.0, 0.92, 0.78)) -> NDArray[Any]:
    """Return a colour image (rows, columns, 3) of grey levels under tinted light."""
    return np.stack([np.rint(levels * transmission).astype(levels.dtype) for transmission in tint], axis=-1)


def png(levels: NDArray[Any], um_per_px: float | None = None) -> bytes:
    """Return a PNG file, with the scale, if specified, as pixels per metre."""
    options = {} if um_per_px is None else {"dpi": (25400 / um_per_px, 25400 / um_per_px)}
    return _pillow(levels, "PNG", **options)


def jpeg(levels: NDArray[Any], quality: int = 85) -> bytes:
    """Return a JPEG file without a scale."""
    return _pillow(levels, "JPEG", quality=quality)


def tiff(levels: NDArray[Any], um_per_px: float | None = None, **options: Any) -> bytes:
    """Return a TIFF file, with the scale, if specified, as pixels per cm."""
    import tifffile

    file = io.BytesIO()
    if um_per_px is not None:
        options |= {"resolution": (1e4 / um_per_px, 1e4 / um_per_px), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(
        file, levels, photometric="rgb" if levels.ndim == 3 and levels.shape[-1] == 3 else "minisblack", **options
    )
    return file.getvalue()


def ome_tiff(levels: NDArray[Any], um_per_px: float) -> bytes:
    """Return an OME-TIFF file with its physical pixel size."""
    import tifffile

    file = io.BytesIO()
    metadata = {"axes": "YX", "PhysicalSizeX": um_per_px, "PhysicalSizeXUnit": "µm"}
    metadata |= {"PhysicalSizeY": um_per_px, "PhysicalSizeYUnit": "µm"}
    tifffile.imwrite(file, levels, ome=True, metadata=metadata)
    return file.getvalue()


def _pillow(levels: NDArray[Any], dtype: str, **options: Any) -> bytes:
    from PIL import Image as Pillow

    file = io.BytesIO()
    Pillow.fromarray(levels).save(file, dtype, **options)
    return file.getvalue()
