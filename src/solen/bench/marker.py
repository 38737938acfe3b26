"""Sub-pixel position of a square marker in the frames of a video, and its rotation from frame to frame.

OpenCV detects an ArUco or AprilTag marker and locates its corners to a pixel. Each side of its black square is then
located more precisely: on profiles along the normals of the side, the area under the grey level gives the position of
the step from white to black, independent of blur; a line is fitted through these points, and two lines intersect in a
corner.

A marker that turns in a plane keeps its shape in that plane, even if it is seen obliquely: the model has one projection
from the plane to the image, common to all frames, and a rotation and a shift for each frame. Both are fitted to all
corners, and the residuals of the corners give the uncertainty of an angle. The camera must be fixed and free of
distortion.

Public names: `MarkerFinder`, `rotation_of` and `Rotation`.
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
MARGIN, MAX_PROFILES, STEP_PX = 0.12, 40, 0.5
"""Fraction of a side omitted at each end, largest number of profiles across it, and spacing of their samples."""
HALF_PROFILE = 0.09
"""Half-length of the profiles across a side, as a fraction of the side: less than the width of the black and of the
white border.
"""
MIN_PX = 24.0
"""Smallest length of a side in pixels; the border of a shorter one cannot be located."""
ITERATIONS, MAX_FITTED_FRAMES = 6, 400
"""Iterations of the fit, and largest number of frames to which the projection is fitted."""


class MarkerFinder:
    """A finder of the markers of one dictionary; raises `DataError` if OpenCV is not installed."""

    def __init__(self, dictionary: Dictionary) -> None:
        need("cv2", what="video", doing="reading frames", error=DataError)
        import cv2

        predefined = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[dictionary]))
        self._detector: Any = cv2.aruco.ArucoDetector(predefined)

    def __call__(self, frame: FloatArray) -> list[tuple[int, FloatArray]]:
        """Return number and corners (4, 2) of each marker in a grey frame, x to the right and y down, in pixels."""
        corners, numbers, _ = self._detector.detectMarkers(frame.astype(np.uint8))
        if numbers is None:
            return []
        return [
            (int(number), np.asarray(corner, float).reshape(4, 2))
            for number, corner in zip(np.ravel(numbers), corners, strict=True)
        ]


def refined(frame: FloatArray, corners: FloatArray) -> FloatArray | None:
    """Return corners (4, 2) at sub-pixel positions, from the lines of the sides; None if a side cannot be located."""
    for _ in range(2):
        sides = [_side_line(frame, corners[side], corners[(side + 1) % 4]) for side in range(4)]
        lines = [line for line in sides if line is not None]
        if len(lines) < 4:
            return None
        corners = np.array([_intersection(lines[side - 1], lines[side]) for side in range(4)])
    return corners


def _side_line(frame: FloatArray, begin: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return a point on the line of a side, and its direction; None if the side cannot be located."""
    along = end - begin
    length = float(np.hypot(*along))
    if length < MIN_PX:
        return None
    along = along / length
    inward = np.array([-along[1], along[0]])  # corners go clockwise in the frame
    half = HALF_PROFILE * length
    across = np.arange(-half, half + STEP_PX / 2, STEP_PX)
    position = np.linspace(MARGIN, 1.0 - MARGIN, min(MAX_PROFILES, int(length))) * length
    pixel = begin + position[:, None, None] * along + across[None, :, None] * inward
    grey = map_coordinates(frame, [pixel[..., 1], pixel[..., 0]], order=1, mode="nearest")
    ends = max(2, len(across) // 5)
    white, black = np.median(grey[:, :ends]), np.median(grey[:, -ends:])
    if white - black < 1.0:
        return None
    # the area under a step is its height times its width
    step = across[0] - 0.5 * STEP_PX + STEP_PX * ((grey - black) / (white - black)).sum(axis=1)
    points = begin + position[:, None] * along + step[:, None] * inward
    deviation = np.abs(step - np.median(step))
    kept = deviation <= max(0.5, 4.0 * float(np.median(deviation)))
    middle = points[kept].mean(axis=0)
    _, _, axes = np.linalg.svd(points[kept] - middle)
    return middle, axes[0]


def _intersection(first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]) -> FloatArray:
    distances = np.linalg.solve(np.stack([first[1], -second[1]], axis=1), second[0] - first[0])
    return np.asarray(first[0] + distances[0] * first[1])


@dataclass(frozen=True, eq=False)
class Rotation:
    """Rotation of a marker.

    Attributes
    ----------
    angle_deg
        Angle in each frame, relative to the first, counter-clockwise, (N,).
    u_angle_deg
        Standard uncertainty of each angle, from the residuals of the corners.
    row
        Position of the centre, in rows of the frame, (N,).
    misfit_px
        RMS residual of one coordinate of a corner.
    """

    angle_deg: FloatArray
    u_angle_deg: float
    row: FloatArray
    misfit_px: float


def rotation_of(corners: FloatArray) -> Rotation:
    """Compute the rotation of a marker from its corners (N, 4, 2) in the frames; x is to the right and y down."""
    projection = _projection(SQUARE, corners[0])
    fitted = np.linspace(0, len(corners) - 1, min(MAX_FITTED_FRAMES, len(corners))).astype(int)
    for _ in range(ITERATIONS):
        _, model, _ = _turned_squares(projection, corners[fitted])
        projection = _projection(model.reshape(-1, 2), corners[fitted].reshape(-1, 2))
    angle, model, in_plane = _turned_squares(projection, corners)
    degrees_of_freedom = max(5 * len(corners) - 8, 1)
    sd = float(np.sqrt(((in_plane - model) ** 2).sum() / degrees_of_freedom))
    side_px = float(np.hypot(*np.moveaxis(np.diff(corners, axis=1), -1, 0)).mean())
    # a corner moves by its distance from the centre per radian; the squares of the four distances add up to 2
    u_deg = float(np.degrees(sd / np.sqrt(2.0)))
    return Rotation(np.degrees(np.unwrap(angle)), u_deg, corners[:, :, 1].mean(axis=1), sd * side_px)


def _turned_squares(projection: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return angle and corners of the squares that fit the markers, and the corners of the markers in their plane."""
    in_plane = _projected(np.asarray(np.linalg.inv(projection), float), corners)
    middle = in_plane.mean(axis=1, keepdims=True)
    arm = in_plane - middle
    cross = np.sum(arm[..., 1] * SQUARE[:, 0] - arm[..., 0] * SQUARE[:, 1], axis=1)
    angle = np.arctan2(cross, np.sum(arm * SQUARE, axis=(1, 2)))
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = SQUARE.T
    return angle, middle + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1), in_plane


def _projected(matrix: FloatArray, points: FloatArray) -> FloatArray:
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])


def _projection(plane: FloatArray, frame: FloatArray) -> FloatArray:
    """Return the projection (3, 3) of points in a plane to points in a frame, (n, 2) each, by least squares."""
    middle, scale = frame.mean(axis=0), float(frame.std())
    x, y = plane.T
    u, v = ((frame - middle) / scale).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = np.concatenate(
        [
            np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1),
            np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1),
        ]
    )
    normalised = np.append(np.linalg.lstsq(rows, np.concatenate([u, v]), rcond=None)[0], 1.0).reshape(3, 3)
    to_pixels = np.array([[scale, 0.0, middle[0]], [0.0, scale, middle[1]], [0.0, 0.0, 1.0]])
    return np.asarray(to_pixels @ normalised)
