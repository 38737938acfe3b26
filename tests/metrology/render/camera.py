"""The camera: pixels that integrate, shot and read noise, a range that clips, and the files it writes."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray


def integrated(fine: FloatArray, sub: int) -> FloatArray:
    """Mean over the ``sub`` by ``sub`` sub-pixels of each pixel."""
    rows, columns = fine.shape[0] // sub, fine.shape[1] // sub
    return np.asarray(fine.reshape(rows, sub, columns, sub).mean(axis=(1, 3)))


@dataclass(frozen=True)
class Camera:
    """Noise relative to full scale: ``noise`` at full scale, of which ``shot_share`` of the variance grows with light.

    ``bits`` is the depth of a grey level, 0 for floating point.
    """

    noise: float = 0.03
    shot_share: float = 0.5
    bits: int = 8

    def levels(self, light: FloatArray, rng: np.random.Generator) -> NDArray[Any]:
        """Grey levels of light in 0 to 1."""
        variance = self.noise**2 * (1.0 - self.shot_share + self.shot_share * np.clip(light, 0.0, None))
        seen = light + np.sqrt(variance) * rng.standard_normal(light.shape)
        if self.bits == 0:
            return seen.astype(np.float32)
        top = 2**self.bits - 1
        kind = np.uint8 if self.bits <= 8 else np.uint16
        return np.asarray(np.clip(np.rint(top * seen), 0, top).astype(kind))


def coloured(levels: NDArray[Any], tint: tuple[float, float, float] = (1.0, 0.92, 0.78)) -> NDArray[Any]:
    """A colour image (rows, columns, 3) of a grey one under light of that tint."""
    return np.stack([np.rint(levels * share).astype(levels.dtype) for share in tint], axis=-1)


def png(levels: NDArray[Any], um_per_px: float | None = None) -> bytes:
    """A PNG file, with its scale as pixels per metre if given."""
    options = {} if um_per_px is None else {"dpi": (25400 / um_per_px, 25400 / um_per_px)}
    return _pillow(levels, "PNG", **options)


def jpeg(levels: NDArray[Any], quality: int = 85) -> bytes:
    """A JPEG file without a scale."""
    return _pillow(levels, "JPEG", quality=quality)


def tiff(levels: NDArray[Any], um_per_px: float | None = None, **options: Any) -> bytes:
    """A TIFF file, with its scale as pixels per cm if given."""
    import tifffile

    file = io.BytesIO()
    if um_per_px is not None:
        options |= {"resolution": (1e4 / um_per_px, 1e4 / um_per_px), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(
        file, levels, photometric="rgb" if levels.ndim == 3 and levels.shape[-1] == 3 else "minisblack", **options
    )
    return file.getvalue()


def ome_tiff(levels: NDArray[Any], um_per_px: float) -> bytes:
    """An OME-TIFF file with its physical pixel size."""
    import tifffile

    file = io.BytesIO()
    metadata = {"axes": "YX", "PhysicalSizeX": um_per_px, "PhysicalSizeXUnit": "µm"}
    metadata |= {"PhysicalSizeY": um_per_px, "PhysicalSizeYUnit": "µm"}
    tifffile.imwrite(file, levels, ome=True, metadata=metadata)
    return file.getvalue()


def _pillow(levels: NDArray[Any], kind: str, **options: Any) -> bytes:
    from PIL import Image as Pillow

    file = io.BytesIO()
    Pillow.fromarray(levels).save(file, kind, **options)
    return file.getvalue()
