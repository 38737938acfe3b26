"""Synthetic videos of a rotating marker, seen obliquely, with blur, noise and prescribed time stamps."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray

Frame = NDArray[np.uint8]
HEIGHT, WIDTH, SUBPIXELS = 240, 320, 3
FOCAL_PX, HALF_WINDOW_PX = 600.0, 84
BLACK, WHITE, BACKGROUND = 40.0, 210.0, 100.0


def cells(dictionary: str, number: int, size: int) -> FloatArray:
    """Cells of a marker, including its black border: 0 for black, 1 for white."""
    import cv2

    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    return np.asarray(cv2.aruco.generateImageMarker(markers, number, size) > 0, float)


def oblique_view(tilt_deg: float, yaw_deg: float, distance: float = 6.0) -> FloatArray:
    """Projection of a plane, in units of the marker's side, to the frame of a camera that sees it obliquely."""
    a, b = np.radians([tilt_deg, yaw_deg])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    yaw = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rotation = tilt @ yaw
    camera = np.array([[FOCAL_PX, 0.0, WIDTH / 2], [0.0, -FOCAL_PX, HEIGHT / 2], [0.0, 0.0, 1.0]])
    return np.asarray(camera @ np.column_stack([rotation[:, 0], rotation[:, 1], [0.0, 0.0, distance]]))


@dataclass
class Camera:
    """A camera that draws frames of a marker on an arm that turns about the origin of a plane.

    Attributes
    ----------
    view
        Projection of the plane.
    marker
        Cells of the marker.
    arm
        Position of the marker's centre at 0 degrees, in units of its side.
    blur_px, noise
        Standard deviations of blur and noise, in pixels and grey levels.
    """

    view: FloatArray
    marker: FloatArray
    arm: tuple[float, float] = (0.3, 0.0)
    blur_px: float = 1.0
    noise: float = 3.0
    seed: int = 1

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def frame(self, angle_deg: float, *, hidden: bool = False, twice: bool = False, glow: float = 0.0) -> Frame:
        """A frame at an angle: with the marker, without it or with two of them, and with light at the lower right."""
        import cv2

        grey = np.full((HEIGHT, WIDTH), BACKGROUND, np.float32)
        for shift in () if hidden else (0.0, -1.7) if twice else (0.0,):
            self._draw(grey, angle_deg, shift)
        grey[-30:-10, -30:-10] += glow
        noise = self.noise * self._rng.standard_normal(grey.shape, np.float32)
        blurred = cv2.GaussianBlur(grey, (0, 0), self.blur_px) + noise
        return np.asarray(np.clip(np.rint(blurred), 0, 255), np.uint8)

    def _draw(self, grey: NDArray[np.float32], angle_deg: float, shift: float) -> None:
        """Draw the paper with the marker, as means over subpixels."""
        cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
        n = len(self.marker)
        centre = self.view @ np.array([self.arm[0] + shift, self.arm[1], 1.0])
        spans = [
            (max(round(float(pixel)) - HALF_WINDOW_PX, 0), min(round(float(pixel)) + HALF_WINDOW_PX, size))
            for pixel, size in zip(centre[:2] / centre[2], (WIDTH, HEIGHT), strict=True)
        ]
        u, v = (((np.arange((b - a) * SUBPIXELS) + 0.5) / SUBPIXELS - 0.5 + a).astype(np.float32) for a, b in spans)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        to_plane = (turn @ np.linalg.inv(self.view)).astype(np.float32)
        x, y, w = (row[0] * u + (row[1] * v + row[2])[:, None] for row in to_plane)
        x = x / w - np.float32(self.arm[0] + shift)
        y = y / w - np.float32(self.arm[1])
        radius = np.maximum(np.abs(x), np.abs(y))
        inside = radius < 0.5
        fine = np.where(radius < 0.75, np.float32(WHITE), np.float32(BACKGROUND))
        row, column = (np.minimum((n * side).astype(int), n - 1) for side in (0.5 - y[inside], x[inside] + 0.5))
        fine[inside] = BLACK + (WHITE - BLACK) * self.marker[row, column]
        means = fine.reshape(fine.shape[0] // SUBPIXELS, SUBPIXELS, -1, SUBPIXELS).mean(axis=(1, 3))
        grey[slice(*spans[1]), slice(*spans[0])] += means - BACKGROUND


def write_avi(path: Path, frames: Iterable[Frame], rate_hz: float) -> None:
    """Write a video with a constant frame rate, each frame a JPEG."""
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()


def _element(name: str, data: bytes) -> bytes:
    """An EBML element: identifier, length, data."""
    return bytes.fromhex(name) + struct.pack(">Q", len(data) | 1 << 56) + data


def _number(name: str, value: int) -> bytes:
    return _element(name, value.to_bytes(8, "big"))


def write_mkv(path: Path, frames: Iterable[Frame], time_ms: Sequence[int]) -> None:
    """Write a Matroska video (RFC 9559) whose frames have given time stamps."""
    import cv2

    head = _number("4286", 1) + _number("42F7", 1) + _number("42F2", 4) + _number("42F3", 8)
    head += _element("4282", b"matroska") + _number("4287", 4) + _number("4285", 2)
    size = _number("B0", WIDTH) + _number("BA", HEIGHT)
    track = _number("D7", 1) + _number("73C5", 1) + _number("83", 1) + _element("86", b"V_MJPEG") + _element("E0", size)
    info = _number("2AD7B1", 1_000_000) + _element("4D80", b"drawn") + _element("5741", b"drawn")
    body = _element("1549A966", info) + _element("1654AE6B", _element("AE", track))
    for stamp_ms, frame in zip(time_ms, frames, strict=True):
        encoded: Any = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
        block = b"\x81\x00\x00\x80" + encoded.tobytes()
        body += _element("1F43B675", _number("E7", stamp_ms) + _element("A3", block))
    path.write_bytes(_element("1A45DFA3", head) + _element("18538067", body))
