"""Videos of a marker that turns, drawn here: seen obliquely, blurred, with noise, and with the times one states."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from solen.arrays import FloatArray

Picture = NDArray[np.uint8]
HEIGHT, WIDTH, FINE = 240, 320, 3
FOCAL_PX, REACH_PX = 600.0, 90
BLACK, WHITE, ROOM = 40.0, 210.0, 100.0


def cells(dictionary: str, number: int, size: int) -> FloatArray:
    """The marker, cell by cell with its black border: 0 and 1."""
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    return np.asarray(cv2.aruco.generateImageMarker(known, number, size) > 0, float)


def seen_by(tilt_deg: float, yaw_deg: float, distance: float = 6.0) -> FloatArray:
    """Projection of a plane to the picture by a camera that looks at it obliquely; a side of the marker is 1."""
    a, b = np.radians([tilt_deg, yaw_deg])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    yaw = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    turned = tilt @ yaw
    camera = np.array([[FOCAL_PX, 0.0, WIDTH / 2], [0.0, -FOCAL_PX, HEIGHT / 2], [0.0, 0.0, 1.0]])
    return np.asarray(camera @ np.column_stack([turned[:, 0], turned[:, 1], [0.0, 0.0, distance]]))


@dataclass
class Camera:
    """What draws pictures of a marker on an arm that turns about the plane's origin.

    Attributes
    ----------
    view
        Projection of the plane.
    marker
        Its cells.
    arm
        Where its middle is at 0 degrees, in sides of it.
    blur_px, noise
        Of a picture, in pixels and grey levels.
    """

    view: FloatArray
    marker: FloatArray
    arm: tuple[float, float] = (0.3, 0.0)
    blur_px: float = 1.0
    noise: float = 3.0
    seed: int = 1

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)

    def picture(self, angle_deg: float, *, hidden: bool = False, twice: bool = False, glow: float = 0.0) -> Picture:
        """A picture at an angle; without the marker, with it twice, with light at the lower right."""
        coarse = np.full((HEIGHT, WIDTH), ROOM)
        for shift in () if hidden else (0.0, -1.7) if twice else (0.0,):
            self._draw(coarse, angle_deg, shift)
        coarse[-30:-10, -30:-10] += glow
        drawn = gaussian_filter(coarse, self.blur_px) + self.noise * self._rng.standard_normal(coarse.shape)
        return np.asarray(np.clip(np.rint(drawn), 0, 255), np.uint8)

    def _draw(self, coarse: FloatArray, angle_deg: float, shift: float) -> None:
        """Draw the paper with the marker, with finer pixels where it is."""
        cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
        n = len(self.marker)
        middle = self.view @ np.array([self.arm[0] + shift, self.arm[1], 1.0])
        spans = [
            (max(round(float(one)) - REACH_PX, 0), min(round(float(one)) + REACH_PX, size))
            for one, size in zip(middle[:2] / middle[2], (WIDTH, HEIGHT), strict=True)
        ]
        u, v = np.meshgrid(*((np.arange((end - begin) * FINE) + 0.5) / FINE - 0.5 + begin for begin, end in spans))
        plane = np.einsum("ij,jab->iab", np.linalg.inv(self.view), np.stack([u, v, np.ones_like(u)]))
        plane /= plane[2]
        x = cosine * plane[0] + sine * plane[1] - self.arm[0] - shift
        y = -sine * plane[0] + cosine * plane[1] - self.arm[1]
        place = np.floor((x + 0.5) * n).astype(int), np.floor((0.5 - y) * n).astype(int)
        inside = (np.abs(x) < 0.5) & (np.abs(y) < 0.5)
        paper = (np.abs(x) < 0.75) & (np.abs(y) < 0.75)
        part = np.full(x.shape, ROOM)
        part[paper] = WHITE
        part[inside] = BLACK + (WHITE - BLACK) * self.marker[place[1][inside], place[0][inside]]
        means = part.reshape(part.shape[0] // FINE, FINE, -1, FINE).mean(axis=(1, 3))
        coarse[slice(*spans[1]), slice(*spans[0])] += means - ROOM


def write_avi(path: Path, pictures: Iterable[Picture], rate_hz: float) -> None:
    """A video of even times, each picture a JPEG."""
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate_hz, (WIDTH, HEIGHT))
    assert writer.isOpened()
    for one in pictures:
        writer.write(cv2.cvtColor(one, cv2.COLOR_GRAY2BGR))
    writer.release()


def _element(name: str, data: bytes) -> bytes:
    """An element of EBML: its identifier, its length, its data."""
    return bytes.fromhex(name) + struct.pack(">Q", len(data) | 1 << 56) + data


def _number(name: str, value: int) -> bytes:
    return _element(name, value.to_bytes(8, "big"))


def write_mkv(path: Path, pictures: Iterable[Picture], time_ms: Sequence[int]) -> None:
    """A video in Matroska (RFC 9559) whose pictures have the times that are stated."""
    import cv2

    head = _number("4286", 1) + _number("42F7", 1) + _number("42F2", 4) + _number("42F3", 8)
    head += _element("4282", b"matroska") + _number("4287", 4) + _number("4285", 2)
    size = _number("B0", WIDTH) + _number("BA", HEIGHT)
    track = _number("D7", 1) + _number("73C5", 1) + _number("83", 1) + _element("86", b"V_MJPEG") + _element("E0", size)
    info = _number("2AD7B1", 1_000_000) + _element("4D80", b"drawn") + _element("5741", b"drawn")
    body = _element("1549A966", info) + _element("1654AE6B", _element("AE", track))
    for at, one in zip(time_ms, pictures, strict=True):
        encoded: Any = cv2.imencode(".jpg", one, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
        block = b"\x81\x00\x00\x80" + encoded.tobytes()
        body += _element("1F43B675", _number("E7", at) + _element("A3", block))
    path.write_bytes(_element("1A45DFA3", head) + _element("18538067", body))
