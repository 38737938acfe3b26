"""An angle from a video: a marker on the rotating part, recorded with any fixed camera.

The angle is measured in each frame (`solen.bench.marker`), at the time stamps of the frames, even if they are
irregular. If the video shows the emitters switching on as a run begins, that moment is the start of the recording;
otherwise the offset between the clocks is specified, or left to the analysis, which determines the lag of a motion log
from the signals.

The timing errors of the camera remain: the rolling shutter, and a time stamp at any moment of the exposure. Both delay
all frames alike, which is a lag of the log.

Public names: `motion_of`, `VideoOptions` and `VideoMotion`.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.bench.marker import MIN_PX, Dictionary, MarkerFinder, refined, rotation_of
from solen.errors import DataError, SpecError
from solen.extras import need
from solen.files import check_seal
from solen.ranks import Caution, do_not_use, note, warning
from solen.results import HIDDEN, Result
from solen.spec.strict import Options

MIN_FRAMES = 16
"""Smallest number of frames that must show the marker."""
GAP = 1.5
"""Multiple of the median interval above which frames are missing."""
UNEVEN = 0.02
"""Fraction of the median interval by which intervals may vary without a note."""
ZERO_S = 0.5
"""Duration in s at the beginning of a video whose median angle is the zero."""
_MIN_ZERO_FRAMES = 4  # frames needed to determine whether the marker is at rest
_MAX_SHIFT = 3.0  # shift between the halves of this beginning, in uncertainties, above which the marker moves
MIN_GLOW = 6.0
"""Smallest ratio of the glow to its noise."""


class VideoOptions(Options):
    """How an angle is measured in a video, and the clock of its times."""

    dictionary: Dictionary = "4x4"
    """Family of the marker: ArUco by its number of cells, or AprilTag."""
    marker: Annotated[int, Field(ge=0)] | None = None
    """Number of the marker; default: the only one in the video."""
    glow: tuple[int, int, int, int] | None = None
    """Region that shows the emitters' light: left, top, width, height in pixels. Time 0 is when they switch on."""
    recording: Path | None = None
    """With --glow: recording that starts when the emitters switch on; the times are then on its clock."""
    offset_s: float | None = None
    """Time of the recording minus that of the video, if it is known."""
    readout_ms: Annotated[float, Field(ge=0, le=200)] = 0.0
    """Time from the readout of the first row of a frame to that of the last (rolling shutter)."""


class VideoMotion(Result):
    """The angle of a marker over time.

    Attributes
    ----------
    path
        The video.
    marker
        Number of the marker.
    frames, without, ambiguous
        Number of frames, of frames without a usable marker, and of frames that show the marker more than once.
    rate_hz
        Frames per second, from the median interval.
    longest_gap_s
        Longest time without an angle.
    low_deg, high_deg
        Range of the angle.
    u_angle_deg
        Standard uncertainty of an angle: the larger of those from the residuals of the corners and from the variation
        from frame to frame, combined with that of the zero if the marker moves at the beginning.
    misfit_px
        RMS deviation of the corner coordinates from those of a square in a plane.
    glow_s
        Times of the video at which the emitters switched on and off; empty without --glow.
    u_start_s
        Standard uncertainty of the switch-on time: that of a uniform distribution over one frame interval.
    time_s, angle_deg
        The motion, (N,); counter-clockwise is positive, and 0 is the initial angle of the marker.
    warnings
        Ranked warnings.
    """

    path: Path = field(metadata=HIDDEN)
    marker: int
    frames: int
    without: int
    ambiguous: int
    rate_hz: float
    longest_gap_s: float
    low_deg: float
    high_deg: float
    u_angle_deg: float
    misfit_px: float
    glow_s: tuple[float, ...]
    u_start_s: float | None
    time_s: FloatArray = field(metadata=HIDDEN)
    angle_deg: FloatArray = field(metadata=HIDDEN)
    warnings: tuple[Caution, ...]

    @property
    def csv(self) -> str:
        """Return a motion log: time, angle, and its uncertainty."""
        rows = (
            f"{at:.6f},{angle:.5f},{self.u_angle_deg:.5f}"
            for at, angle in zip(self.time_s, self.angle_deg, strict=True)
        )
        return "\n".join(["time_s,angle_deg,u_angle_deg", *rows, ""])


@dataclass
class _Detections:
    """Time and glow of each frame, and the frames with the marker: their indices, and its corners."""

    time_s: list[float] = field(default_factory=list)
    glow: list[float] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    corners: list[FloatArray] = field(default_factory=list)
    ambiguous: int = 0
    height: int = 1


def motion_of(path: Path, options: VideoOptions = VideoOptions()) -> VideoMotion:
    """Measure the angle of a marker in a video.

    Raises
    ------
    DataError, SpecError
        If the video cannot be read, shows no marker or several, or options contradict each other.
    """
    _check(options)
    number, detected = _detect(path, options)
    warnings: list[Caution] = []
    stamps = np.array(detected.time_s)
    _check_stamps(stamps, warnings)
    rotation = rotation_of(np.array(detected.corners))
    time_s = stamps[detected.frames] + 1e-3 * options.readout_ms * rotation.row / detected.height
    if options.readout_ms == 0.0:
        delay = "a rolling shutter and the exposure delay the angle by up to one frame interval, as a lag of the log"
        warnings.append(note(delay))
    begin = slice(max(_MIN_ZERO_FRAMES, int(np.sum(time_s <= time_s[0] + ZERO_S))))
    angle = rotation.angle_deg - np.median(rotation.angle_deg[begin])
    u_deg = max(rotation.u_angle_deg, _scatter(angle))
    interval = float(np.median(np.diff(stamps)))
    without = len(stamps) - len(detected.frames) - detected.ambiguous
    if without or detected.ambiguous:
        omitted = f"{without} frames without a usable marker and {detected.ambiguous} that show it twice are omitted"
        warnings.append(warning(omitted))
    glow_s = _glow(stamps, np.array(detected.glow)) if options.glow is not None else ()
    return VideoMotion(
        path,
        number,
        frames=len(stamps),
        without=without,
        ambiguous=detected.ambiguous,
        rate_hz=1.0 / interval,
        longest_gap_s=float(np.diff(time_s).max()),
        low_deg=float(angle.min()),
        high_deg=float(angle.max()),
        u_angle_deg=float(np.hypot(u_deg, _u_zero(angle[begin], u_deg, warnings))),
        misfit_px=rotation.misfit_px,
        glow_s=glow_s,
        u_start_s=interval / np.sqrt(12.0) if glow_s else None,
        time_s=time_s + _offset(options, glow_s, interval, warnings),
        angle_deg=angle,
        warnings=tuple(warnings),
    )


def _check(options: VideoOptions) -> None:
    if options.glow is not None and options.offset_s is not None:
        raise SpecError("--offset-s", limit="cannot be combined with --glow", remedy="specify one of the two")
    if options.recording is not None and options.glow is None:
        limit = "requires --glow, which shows when the recording began"
        raise SpecError("--recording", limit=limit, remedy="add --glow, or use --offset-s instead")


def _frames(path: Path) -> Iterator[tuple[float, FloatArray]]:
    """Yield the time stamp in s and the grey levels of each frame."""
    need("cv2", what=str(path), doing="reading a video", error=DataError)
    import cv2

    if not path.is_file():
        raise DataError(str(path), limit="does not exist", remedy="check the path")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # errors are reported in one line
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise DataError(str(path), limit="is not a video that OpenCV can read", remedy="convert it to MP4 (H.264)")
        while True:
            available, frame = video.read()
            if not available:
                return
            grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            yield 1e-3 * float(video.get(cv2.CAP_PROP_POS_MSEC)), np.asarray(grey, float)
    finally:
        video.release()


def _detect(path: Path, options: VideoOptions) -> tuple[int, _Detections]:
    """Return the number of the marker, and what is detected in the frames."""
    finder, detected, numbers = MarkerFinder(options.dictionary), _Detections(), set[int]()
    marker = options.marker
    for time_s, frame in _frames(path):
        detected.time_s.append(time_s)
        if options.glow is not None:
            detected.glow.append(_mean(frame, options.glow))
        markers = finder(frame)
        numbers.update(number for number, _ in markers)
        if marker is None and markers:
            marker = _only_number(path, [number for number, _ in markers])
        candidates = [corners for number, corners in markers if number == marker]
        if len(candidates) > 1:
            detected.ambiguous += 1
        elif candidates and (corners := refined(frame, candidates[0])) is not None:
            detected.frames.append(len(detected.time_s) - 1)
            detected.corners.append(corners)
        detected.height = len(frame)
    if marker is None or len(detected.frames) < MIN_FRAMES:
        raise _not_detected(path, options, detected, numbers)
    return marker, detected


def _only_number(path: Path, numbers: list[int]) -> int:
    if len(set(numbers)) > 1:
        limit = f"shows markers {', '.join(map(str, sorted(set(numbers))))}"
        raise DataError(str(path), limit=limit, remedy="specify the rotating one with --marker")
    return numbers[0]


def _not_detected(path: Path, options: VideoOptions, detected: _Detections, numbers: set[int]) -> DataError:
    what = f"marker {options.marker}" if options.marker is not None else f"{options.dictionary} marker"
    frames = f"{len(detected.frames)} of {len(detected.time_s)} frames"
    limit = f"shows a usable {what} in {frames}; {MIN_FRAMES} are needed"
    others = ", ".join(str(number) for number in sorted(numbers) if number != options.marker)
    remedy = f"check that it is sharp and has a white border and {MIN_PX:g} pixels or more, or specify --dictionary"
    if others:
        remedy = f"specify --marker: the video shows {others}"
    return DataError(str(path), limit=limit, remedy=remedy)


def _mean(frame: FloatArray, region: tuple[int, ...]) -> float:
    left, top, width, height = region
    inside = frame[max(top, 0) : top + height, max(left, 0) : left + width]
    if min(left, top) < 0 or inside.shape != (height, width) or inside.size == 0:
        limit = f"must be within the frame of {frame.shape[1]} by {frame.shape[0]} pixels"
        raise SpecError("--glow", value=" ".join(map(str, region)), limit=limit)
    return float(inside.mean())


def _check_stamps(stamps: FloatArray, warnings: list[Caution]) -> None:
    """Warn of irregular time stamps; raise `DataError` if they are not in ascending order."""
    steps = np.diff(stamps)
    if len(steps) == 0 or not (steps > 0.0).all():
        limit = "must have frames with ascending time stamps"
        raise DataError("video", limit=limit, remedy="convert it, for example to MP4")
    usual = float(np.median(steps))
    gaps = steps[steps > GAP * usual]
    if len(gaps):
        warnings.append(
            warning(f"number of gaps in the video: {len(gaps)}, up to {gaps.max():.3g} s: frames were dropped")
        )
    spread = float(np.std(steps[steps <= GAP * usual]))
    if spread > UNEVEN * usual:
        varying = f"the intervals between frames vary by {1e3 * spread:.2g} ms about {1e3 * usual:.3g} ms"
        warnings.append(note(f"{varying}; the time of each angle is the time stamp of its frame"))


def _scatter(angle: FloatArray) -> float:
    """Return the noise of an angle from its second differences, most of which are from rest or uniform motion."""
    return float(1.4826 * np.median(np.abs(np.diff(angle, 2))) / np.sqrt(6.0))


def _u_zero(angle: FloatArray, u_deg: float, warnings: list[Caution]) -> float:
    """Return the uncertainty of the zero: 0 if the marker is at rest at first, otherwise from its range of motion."""
    half = len(angle) // 2
    shift = float(np.median(angle[-half:]) - np.median(angle[:half]))
    spread = 1.4826 * float(np.median(np.abs(angle)))
    if max(abs(shift), spread) <= _MAX_SHIFT * u_deg:
        return 0.0
    largest = float(np.abs(angle).max())
    warnings.append(
        do_not_use(
            f"the marker moves by {np.ptp(angle):.2g}° in the first {ZERO_S:g} s, whose median angle is the zero of "
            f"all angles: the zero is uncertain by up to {largest:.2g}°; begin the video {ZERO_S:g} s before the motion"
        )
    )
    return largest / float(np.sqrt(3.0))


def _glow(time_s: FloatArray, level: FloatArray) -> tuple[float, ...]:
    """Return the times at which the emitters switch on, and off if the video shows it.

    Raises `DataError` if no glow is detected, or if the emitters are on from the beginning.
    """
    low, high = np.percentile(level, [2, 98])
    noise = 1.4826 * float(np.median(np.abs(np.diff(level)))) / np.sqrt(2.0)
    lit = level > 0.5 * (low + high)
    if high - low < max(MIN_GLOW * noise, 1.0):
        remedy = "specify a region that shows the light of the emitters with --glow"
        raise DataError("video", limit="shows no glow in this region", remedy=remedy)
    if lit[0]:
        raise DataError("video", limit="begins with the emitters on", remedy="begin the video before the run")
    on, last = int(np.argmax(lit)), len(lit) - 1 - int(np.argmax(lit[::-1]))
    times = [0.5 * (time_s[on - 1] + time_s[on])]
    if last < len(lit) - 1:
        times.append(0.5 * (time_s[last] + time_s[last + 1]))
    return tuple(float(time) for time in times)


def _offset(options: VideoOptions, glow_s: tuple[float, ...], interval_s: float, warnings: list[Caution]) -> float:
    """Return the shift from times of the video to the clock of the recording."""
    if not glow_s:
        return options.offset_s or 0.0
    if options.recording is None:
        return -glow_s[0]
    begin_s, end_s = _recorded_span(options.recording)
    if len(glow_s) == 2:
        lit_s, recorded_s = glow_s[1] - glow_s[0], end_s - begin_s
        if abs(lit_s - recorded_s) > 2.0 * interval_s + 0.1:
            warnings.append(
                warning(
                    f"the emitters are visible for {lit_s:.2f} s, and the recording lasts {recorded_s:.2f} s; check "
                    "that it belongs to this video, and that no frames were dropped"
                )
            )
    return begin_s - glow_s[0]


def _recorded_span(path: Path) -> tuple[float, float]:
    """Return the first and last times of a recording, when its emitters were switched on and off, respectively."""
    need("h5netcdf", what=str(path), doing="reading a recording", error=DataError)
    import h5netcdf

    check_seal(path, DataError)
    try:
        with h5netcdf.File(path, "r") as file:
            times = file.variables["time_s"]
            return float(times[0]), float(times[-1])
    except (OSError, KeyError, IndexError):
        limit, remedy = "has no times in its root group", "specify a recording of solen bench run"
        raise DataError(str(path), limit=limit, remedy=remedy) from None
