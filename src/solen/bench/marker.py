"""Sub-pixel position of a square marker in pictures, and its rotation between them.

OpenCV detects an ArUco or AprilTag marker and its corners to a pixel. Each side of its black square is then located
again: along its normals, the area under the grey profile gives the position of the step from white to black,
independent of blur; a line is fitted through these points, and two lines intersect in a corner.

A marker that turns in a plane keeps its shape in that plane, even if it is seen obliquely: the model has one projection
from the plane to the picture, common to all pictures, and a rotation and a shift for each picture. Both are fitted to
all corners, and the corners' misfit gives the uncertainty of an angle. The camera must be fixed and free of distortion.

Public names: `Finder`, `turns` and `Turns`.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.ndimage import map_coordinates

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.extras import need

Dictionary = Literal["4x4", "5x5", "6x6", "7x7", "apriltag-16h5", "apriltag-25h9", "apriltag-36h10", "apriltag-36h11"]
DICTIONARIES: dict[Dictionary, str] = {
    "4x4": "DICT_4X4_1000",
    "5x5": "DICT_5X5_1000",
    "6x6": "DICT_6X6_1000",
    "7x7": "DICT_7X7_1000",
    "apriltag-16h5": "DICT_APRILTAG_16h5",
    "apriltag-25h9": "DICT_APRILTAG_25h9",
    "apriltag-36h10": "DICT_APRILTAG_36h10",
    "apriltag-36h11": "DICT_APRILTAG_36h11",
}
SQUARE = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]])
"""Corners of the marker in its plane, y up, in the order in which they are detected."""
MARGIN, PLACES, STEP_PX = 0.12, 40, 0.5
"""Fraction of a side omitted at each end, largest number of points along it, and spacing of samples across it."""
REACH = 0.09
"""Half-length of the profiles across a side, as a fraction of the side: less than the width of the black and of the
white border.
"""
MIN_PX = 24.0
"""Smallest length of a side in pixels; shorter sides have no border that could be located."""
ROUNDS, FITTED = 6, 400
"""Rounds of the fit, and largest number of pictures to which the projection is fitted."""


class Finder:
    """Markers of one dictionary in pictures; raises `DataError` if OpenCV is not installed."""

    def __init__(self, dictionary: Dictionary) -> None:
        need("cv2", what="video", doing="reading pictures", error=DataError)
        import cv2

        found = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[dictionary]))
        self._detector: Any = cv2.aruco.ArucoDetector(found)

    def __call__(self, picture: FloatArray) -> list[tuple[int, FloatArray]]:
        """Return number and corners (4, 2) of each marker in a grey picture, x to the right and y down, in pixels."""
        corners, numbers, _ = self._detector.detectMarkers(picture.astype(np.uint8))
        if numbers is None:
            return []
        return [
            (int(number), np.asarray(corner, float).reshape(4, 2))
            for number, corner in zip(np.ravel(numbers), corners, strict=True)
        ]


def refined(picture: FloatArray, corners: FloatArray) -> FloatArray | None:
    """Return corners (4, 2) from the lines of the marker's sides; None if a side cannot be located."""
    for _ in range(2):
        sides = [_line(picture, corners[place], corners[(place + 1) % 4]) for place in range(4)]
        lines = [side for side in sides if side is not None]
        if len(lines) < 4:
            return None
        corners = np.array([_meet(lines[place - 1], lines[place]) for place in range(4)])
    return corners


def _line(picture: FloatArray, begin: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return a point on the line of a side, and its direction."""
    along = end - begin
    length = float(np.hypot(*along))
    if length < MIN_PX:
        return None
    along = along / length
    inward = np.array([-along[1], along[0]])  # corners go clockwise in the picture
    reach = REACH * length
    across = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    places = np.linspace(MARGIN, 1.0 - MARGIN, min(PLACES, int(length))) * length
    at = begin + places[:, None, None] * along + across[None, :, None] * inward
    grey = map_coordinates(picture, [at[..., 1], at[..., 0]], order=1, mode="nearest")
    ends = max(2, len(across) // 5)
    white, black = np.median(grey[:, :ends]), np.median(grey[:, -ends:])
    if white - black < 1.0:
        return None
    # the area under a step is its height times its width
    step = across[0] - 0.5 * STEP_PX + STEP_PX * ((grey - black) / (white - black)).sum(axis=1)
    points = begin + places[:, None] * along + step[:, None] * inward
    kept = np.abs(step - np.median(step)) <= max(0.5, 4.0 * float(np.median(np.abs(step - np.median(step)))))
    middle = points[kept].mean(axis=0)
    _, _, axes = np.linalg.svd(points[kept] - middle)
    return middle, axes[0]


def _meet(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> FloatArray:
    shares = np.linalg.solve(np.stack([one[1], -other[1]], axis=1), other[0] - one[0])
    return np.asarray(one[0] + shares[0] * one[1])


@dataclass(frozen=True, eq=False)
class Turns:
    """Rotation of a marker.

    Attributes
    ----------
    angle_deg
        Angle in each picture, relative to the first, counter-clockwise, (N,).
    u_angle_deg
        Standard uncertainty of each angle, from the misfit of the corners.
    row
        Position of the centre, in rows of the picture, (N,).
    misfit_px
        Root mean square misfit of one coordinate of a corner.
    """

    angle_deg: FloatArray
    u_angle_deg: float
    row: FloatArray
    misfit_px: float


def turns(corners: FloatArray) -> Turns:
    """Compute the rotation of a marker from its corners (N, 4, 2) in pictures; x is to the right and y down."""
    flat = _projection(SQUARE, corners[0])
    chosen = np.linspace(0, len(corners) - 1, min(FITTED, len(corners))).astype(int)
    for _ in range(ROUNDS):
        _, placed = _placed(flat, corners[chosen])
        flat = _projection(placed.reshape(-1, 2), corners[chosen].reshape(-1, 2))
    angle, placed = _placed(flat, corners)
    off = _projected(_back(flat), corners) - placed
    free = max(5 * len(corners) - 8, 1)
    sd = float(np.sqrt((off**2).sum() / free))
    side_px = float(np.hypot(*np.moveaxis(np.diff(corners, axis=1), -1, 0)).mean())
    # a rotation moves each corner by its distance from the centre; the squares add up to 2
    u_deg = float(np.degrees(sd / np.sqrt(2.0)))
    return Turns(np.degrees(np.unwrap(angle)), u_deg, corners[:, :, 1].mean(axis=1), sd * side_px)


def _placed(flat: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the angle of each marker in its plane, and its corners aligned with those of the square."""
    seen = _projected(_back(flat), corners)
    middle = seen.mean(axis=1, keepdims=True)
    around = seen - middle
    turned = np.sum(around[..., 1] * SQUARE[:, 0] - around[..., 0] * SQUARE[:, 1], axis=1)
    angle = np.arctan2(turned, np.sum(around * SQUARE, axis=(1, 2)))
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = SQUARE.T
    return angle, middle + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def _back(flat: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(flat), float)


def _projected(matrix: FloatArray, points: FloatArray) -> FloatArray:
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def _projection(plane: FloatArray, picture: FloatArray) -> FloatArray:
    """Return the projection (3, 3) of points of a plane to those of a picture, (n, 2) each, by least squares."""
    middle, scale = picture.mean(axis=0), float(picture.std())
    x, y = plane.T
    u, v = ((picture - middle) / scale).T
    none, one = np.zeros_like(x), np.ones_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, none, none, none, -u * x, -u * y], axis=1),
            np.stack([none, none, none, x, y, one, -v * x, -v * y], axis=1),
        ]
    )
    found = np.append(np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)[0], 1.0).reshape(3, 3)
    back = np.array([[scale, 0.0, middle[0]], [0.0, scale, middle[1]], [0.0, 0.0, 1.0]])
    return np.asarray(back @ found)
