"""An angle from a video: a marker on the rotating part, recorded with any fixed camera.

The angle is read picture by picture (`solen.bench.marker`), at the time stamps of the pictures, even if they are
irregular. If the video shows the emitters switching on as a run begins, that moment is the recording's start; otherwise
the clock offset is stated, or left to analysis, which determines the lag of a log from the signals.

The camera's own timing errors remain: rolling shutter, and a stamp at any moment of an exposure. Both delay all
pictures equally, as a lag of the log.

Public names: `motion_of`, `VideoOptions` and `VideoMotion`.
"""

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.bench.marker import Dictionary, Finder, refined, turns
from solen.errors import DataError, SpecError
from solen.extras import need
from solen.files import check_seal
from solen.ranks import Caution, do_not_use, note, warning
from solen.results import HIDDEN, Result
from solen.spec.strict import Options

MIN_FRAMES = 16
"""Smallest number of pictures that show the marker."""
GAP = 1.5
"""Multiple of the median interval above which pictures are missing."""
UNEVEN = 0.02
"""Fraction of the median interval by which intervals may vary without a warning."""
BEGIN_S = 0.5
"""Initial duration whose mean angle is the zero."""
_MIN_REST_FRAMES = 4  # least number of pictures that show whether the marker is at rest
_MOVED = 3.0  # difference between both halves of the beginning, in uncertainties, above which it moves
CONTRAST = 6.0
"""Smallest ratio of a glow to its noise."""


class VideoOptions(Options):
    """How an angle is read from a video, and the clock on which its times are put."""

    dictionary: Dictionary = "4x4"
    """Family of the marker: ArUco by its number of cells, or AprilTag."""
    marker: Annotated[int, Field(ge=0)] | None = None
    """Number of the marker; default: the only one in the video."""
    glow: tuple[int, int, int, int] | None = None
    """Area that shows the emitters' light: left, top, width, height in pixels. Time 0 is when they switch on."""
    recording: Path | None = None
    """With --glow: recording of solen bench run that began with it, on whose clock the times are put."""
    offset_s: float | None = None
    """Time of the recording minus that of the video, if it is known."""
    readout_ms: Annotated[float, Field(ge=0, le=200)] = 0.0
    """Time from the readout of a picture's first row to that of its last (a rolling shutter)."""


class VideoMotion(Result):
    """A marker's angle over time.

    Attributes
    ----------
    path
        The video.
    marker
        The marker's number.
    pictures, without, ambiguous
        Number of pictures, of those without a usable marker, and of those that show it more than once.
    rate_hz
        Pictures per second, from the typical interval.
    longest_gap_s
        Longest time without an angle.
    low_deg, high_deg
        Range of the angle.
    u_angle_deg
        Standard uncertainty of an angle: the larger of those from the corners' misfit and from the variation between
        pictures; including that of the zero, if the marker moves at the beginning.
    misfit_px
        Root mean square deviation of corner coordinates from a square in a plane.
    glow_s
        Times of the video at which the emitters switched on and off; empty without --glow.
    u_start_s
        Standard uncertainty of the first: uniform over an interval.
    time_s, angle_deg
        The motion, (N,); counter-clockwise is positive, and 0 is the marker's initial angle.
    warnings
        Warnings.
    """

    path: Path = field(metadata=HIDDEN)
    marker: int
    pictures: int
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
class _Seen:
    """Content of pictures: times, the glow's brightness, and the corners of the marker if it is visible."""

    time_s: list[float] = field(default_factory=list)
    glow: list[float] = field(default_factory=list)
    places: list[int] = field(default_factory=list)
    corners: list[FloatArray] = field(default_factory=list)
    ambiguous: int = 0
    height: int = 1


def motion_of(path: Path, options: VideoOptions = VideoOptions()) -> VideoMotion:
    """Measure the angle of a marker in a video.

    Raises
    ------
    DataError, SpecError
        If the video cannot be read, shows no marker or several, or options are contradictory.
    """
    _check(options)
    number, seen = _looked(path, options)
    warnings: list[Caution] = []
    stamped = _times(np.array(seen.time_s), warnings)
    found = turns(np.array(seen.corners))
    time_s = stamped[seen.places] + 1e-3 * options.readout_ms * found.row / seen.height
    if options.readout_ms == 0.0:
        warnings.append(
            note("a rolling shutter and the exposure delay the angle by up to one interval, which is a lag of the log")
        )
    begin = slice(max(_MIN_REST_FRAMES, int(np.sum(time_s <= time_s[0] + BEGIN_S))))
    angle = found.angle_deg - np.median(found.angle_deg[begin])
    own_u_deg = max(found.u_angle_deg, _scatter(angle))
    interval = float(np.median(np.diff(stamped)))
    missing = len(stamped) - len(seen.places) - seen.ambiguous
    if missing or seen.ambiguous:
        shown = f"{missing} pictures show no usable marker, {seen.ambiguous} show it twice"
        warnings.append(warning(shown))
    glow_s = _glow(stamped, np.array(seen.glow)) if options.glow is not None else ()
    return VideoMotion(
        path,
        number,
        pictures=len(stamped),
        without=missing,
        ambiguous=seen.ambiguous,
        rate_hz=1.0 / interval,
        longest_gap_s=float(np.diff(time_s).max()),
        low_deg=float(angle.min()),
        high_deg=float(angle.max()),
        u_angle_deg=float(np.hypot(own_u_deg, _u_zero(angle[begin], own_u_deg, warnings))),
        misfit_px=found.misfit_px,
        glow_s=glow_s,
        u_start_s=interval / np.sqrt(12.0) if glow_s else None,
        time_s=time_s + _offset(options, glow_s, interval, warnings),
        angle_deg=angle,
        warnings=tuple(warnings),
    )


def _check(options: VideoOptions) -> None:
    if options.glow is not None and options.offset_s is not None:
        raise SpecError("--offset-s", limit="is already determined by --glow", remedy="use one of the two")
    if options.recording is not None and options.glow is None:
        raise SpecError("--recording", limit="needs --glow, which shows when it began", remedy="or give --offset-s")


def _pictures(path: Path) -> Iterator[tuple[float, FloatArray]]:
    """Time in s and grey levels of each picture."""
    need("cv2", what=str(path), doing="reading a video", error=DataError)
    import cv2

    if not path.is_file():
        raise DataError(str(path), limit="no such file")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # errors are reported in one line
    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise DataError(str(path), limit="is not a video that OpenCV can read", remedy="convert it to MP4 (H.264)")
        while True:
            there, picture = video.read()
            if not there:
                return
            grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
            yield 1e-3 * float(video.get(cv2.CAP_PROP_POS_MSEC)), np.asarray(grey, float)
    finally:
        video.release()


def _looked(path: Path, options: VideoOptions) -> tuple[int, _Seen]:
    """Return the marker's number, and the content of the pictures."""
    finder, seen, numbers = Finder(options.dictionary), _Seen(), Counter[int]()
    one = options.marker
    for time_s, picture in _pictures(path):
        seen.time_s.append(time_s)
        if options.glow is not None:
            seen.glow.append(_mean(picture, options.glow))
        markers = finder(picture)
        numbers.update({number for number, _ in markers})
        if one is None and markers:
            one = _only(path, [number for number, _ in markers])
        mine = [corners for number, corners in markers if number == one]
        if len(mine) > 1:
            seen.ambiguous += 1
        elif mine and (corners := refined(picture, mine[0])) is not None:
            seen.places.append(len(seen.time_s) - 1)
            seen.corners.append(corners)
        seen.height = len(picture)
    if one is None or len(seen.places) < MIN_FRAMES:
        raise _not_seen(path, options, seen, numbers)
    return one, seen


def _only(path: Path, numbers: list[int]) -> int:
    if len(set(numbers)) > 1:
        limit = f"shows markers {', '.join(map(str, sorted(set(numbers))))}"
        raise DataError(str(path), limit=limit, remedy="choose the rotating one with --marker")
    return numbers[0]


def _not_seen(path: Path, options: VideoOptions, seen: _Seen, numbers: Counter[int]) -> DataError:
    what = f"marker {options.marker}" if options.marker is not None else f"{options.dictionary} marker"
    limit = f"shows a usable {what} in {len(seen.places)} of {len(seen.time_s)} pictures; {MIN_FRAMES} are needed"
    others = ", ".join(str(number) for number in sorted(numbers) if number != options.marker)
    remedy = (
        f"it shows {others}"
        if others
        else "check that it is sharp and has a white border and 24 pixels or more; see --dictionary"
    )
    return DataError(str(path), limit=limit, remedy=remedy)


def _mean(picture: FloatArray, region: tuple[int, ...]) -> float:
    left, top, width, height = region
    inside = picture[max(top, 0) : top + height, max(left, 0) : left + width]
    if min(left, top) < 0 or inside.shape != (height, width) or inside.size == 0:
        limit = f"must be within the picture of {picture.shape[1]} by {picture.shape[0]} pixels"
        raise SpecError("--glow", value=" ".join(map(str, region)), limit=limit)
    return float(inside.mean())


def _times(stamps: FloatArray, warnings: list[Caution]) -> FloatArray:
    """Return the time stamps of the pictures, with warnings about irregularities."""
    steps = np.diff(stamps)
    if len(steps) == 0 or not (steps > 0.0).all():
        limit = "has pictures whose times do not increase"
        raise DataError("video", limit=limit, remedy="convert it, for example to MP4")
    usual = float(np.median(steps))
    gaps = steps[steps > GAP * usual]
    if len(gaps):
        warnings.append(warning(f"{len(gaps)} gaps in the video, up to {gaps.max():.3g} s: pictures were dropped"))
    spread = float(np.std(steps[steps <= GAP * usual]))
    if spread > UNEVEN * usual:
        vary = f"intervals vary by {1e3 * spread:.2g} ms about {1e3 * usual:.3g} ms"
        warnings.append(note(f"the video's {vary}: the times are its own stamps"))
    return stamps


def _scatter(angle: FloatArray) -> float:
    """Return the noise of an angle from second differences, most of which are at rest or in steady motion."""
    bends = np.diff(angle, 2)
    return float(1.4826 * np.median(np.abs(bends)) / np.sqrt(6.0))


def _u_zero(angle: FloatArray, u_deg: float, warnings: list[Caution]) -> float:
    """Return the uncertainty of the initial zero: 0 if the marker is at rest, else uniform over its motion."""
    half = len(angle) // 2
    moved = float(np.median(angle[-half:]) - np.median(angle[:half]))
    spread = 1.4826 * float(np.median(np.abs(angle)))
    if max(abs(moved), spread) <= _MOVED * u_deg:
        return 0.0
    way = float(np.abs(angle).max())
    warnings.append(
        do_not_use(
            f"the marker moves in the first {BEGIN_S:g} s, by {np.ptp(angle):.2g}°, and all angles are relative to "
            f"its mean there: their zero is uncertain by up to {way:.2g}°; "
            f"begin the video {BEGIN_S:g} s before the motion"
        )
    )
    return way / float(np.sqrt(3.0))


def _glow(time_s: FloatArray, level: FloatArray) -> tuple[float, ...]:
    """Return the times at which the emitters switch on, and off if visible.

    Raises `DataError` if no glow is detected.
    """
    low, high = np.percentile(level, [2, 98])
    noise = 1.4826 * float(np.median(np.abs(np.diff(level)))) / np.sqrt(2.0)
    lit = level > 0.5 * (low + high)
    if high - low < max(CONTRAST * noise, 1.0) or lit[0]:
        limit = "begins with the glow on" if high - low >= max(CONTRAST * noise, 1.0) else "shows no glow in this area"
        remedy = "begin the video before the run, and name an area that shows the emitters, with --glow"
        raise DataError("video", limit=limit, remedy=remedy)
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
    begin_s, end_s = _lit(options.recording)
    if len(glow_s) == 2:
        off_s = (glow_s[1] - glow_s[0]) - (end_s - begin_s)
        if abs(off_s) > 2.0 * interval_s + 0.1:
            longer = (
                f"emitters are visible for {glow_s[1] - glow_s[0]:.2f} s, and the recording lasts "
                f"{end_s - begin_s:.2f} s: check that it belongs to this video; "
                "pictures dropped without a trace shift all later ones"
            )
            warnings.append(warning(longer))
    return begin_s - glow_s[0]


def _lit(path: Path) -> tuple[float, float]:
    """Return the times at which a recording's emitters were switched on and off."""
    need("h5netcdf", what=str(path), doing="reading a recording", error=DataError)
    import h5netcdf

    check_seal(path, DataError)
    try:
        with h5netcdf.File(path, "r") as file:
            times = file.variables["time_s"]
            return float(times[0]), float(times[-1])
    except (OSError, KeyError, IndexError):
        limit, remedy = "contains no times in its root", "name a recording of solen bench run"
        raise DataError(str(path), limit=limit, remedy=remedy) from None
