"""The log of a tuning: one entry for each print, with its image, measurement and next drawing.

The log contains measurements and drawings but nothing derived from them, so that every call evaluates all prints again.
A drawing is identified by the hash of its outline, an image by that of its file.

Public names: `TuningLog`, `read_log` and `log_text`.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from solen.errors import DataError
from solen.explore.contour import Rows
from solen.fabricate.process import Drawing
from solen.files import read_text
from solen.results import Result
from solen.spec.objects import build, parse_json

KIND = "print tuning log"
SCHEMA = 1
AS_DESIGNED = "the design itself"


class Correction(Result):
    """A drawing: number 0 is the design itself, and the others have the number of the print that they follow.

    Attributes
    ----------
    number, file, sha256
        Its number, the name of its design file, and the hash of its outline.
    lens_um
        Displacement of the drawn lens from the designed one along its normals, at equidistant points.
    wall_um, scale
        Outward displacement of other walls, and the factor that enlarges everything.
    """

    number: int
    file: str
    sha256: str
    lens_um: tuple[float, ...]
    wall_um: float
    scale: float

    @classmethod
    def of(cls, number: int, file: str, sha256: str, drawing: Drawing) -> "Correction":
        """Return the entry of a drawing."""
        lens = tuple(np.round(drawing.drawn_um, 5).tolist())
        return cls(number, file, sha256, lens, drawing.wall_um, drawing.scale)

    @property
    def drawing(self) -> Drawing:
        """The drawing."""
        return Drawing(np.array(self.lens_um), self.wall_um, self.scale)


class LoggedImage(Result):
    """Measurement of a print from an image, as in `solen.explore.contour.Rows`."""

    file: str
    sha256: str
    simulated: bool
    um_per_px: float
    u_um_per_px: float | None
    seen_from: Literal["top", "bottom"] | None
    arc_mm: tuple[float, ...]
    deviation_um: tuple[float, ...]
    u_um: tuple[float, ...]

    @property
    def rows(self) -> Rows:
        """Deviations of the print along its contour."""
        arc, deviation, u = (np.array(column) for column in (self.arc_mm, self.deviation_um, self.u_um))
        return Rows(arc, deviation, u, self.um_per_px, self.u_um_per_px)


@dataclass(frozen=True)
class Residual:
    """Predicted deviation (rms) of the next print, its standard uncertainty and 95 % interval."""

    rms_um: float
    u_rms_um: float
    interval95_rms_um: tuple[float, float]


class TunedResponse(Result):
    """Contrast of a sensor with a printed lens over N angles, and its null.

    Attributes
    ----------
    angle_deg, contrast, u_contrast
        Angles, contrast, and its standard uncertainty from the lens and the trace.
    null_deg, u_null_deg
        Null from the contrast at 0 and the slope there; None if it is not near 0.
    slope_per_deg, u_slope_per_deg
        Slope of the contrast about 0.
    """

    angle_deg: tuple[float, ...]
    contrast: tuple[float, ...]
    u_contrast: tuple[float, ...]
    null_deg: float | None
    u_null_deg: float | None
    slope_per_deg: float
    u_slope_per_deg: float


class Responses(Result):
    """Response as designed, of this print, and as predicted for the next one."""

    dimension: str
    width_mm: float
    designed: TunedResponse
    before: TunedResponse
    after: TunedResponse


class LoggedPrint(Result):
    """One print of the log.

    Attributes
    ----------
    number, drawing
        Its number, and that of the correction it was drawn with.
    image
        Its image.
    rms_um, u_rms_um
        Its deviation, as `solen print inspect` measures it.
    correction
        The next drawing, from this and all earlier prints; the previous one if kept.
    predicted
        Deviation of the next print of that drawing.
    response
        Response before and after; None if not traced.
    """

    number: int
    drawing: int
    image: LoggedImage
    rms_um: float
    u_rms_um: float
    correction: Correction
    predicted: Residual
    response: Responses | None

    @property
    def keeps(self) -> bool:
        """Whether the previous drawing was kept."""
        return self.correction.number != self.number


class TuningLog(Result):
    """Prints of one design on one printer, with the drawn heights and the position in the pixel."""

    design: str
    sha256: str
    pixels_um: tuple[float, float]
    phase_px: tuple[float, float]
    prints: tuple[LoggedPrint, ...] = ()

    def drawing(self, number: int, points: int) -> Drawing:
        """Return the drawing of a correction by its number, with a number of points along the lens."""
        return Drawing(np.zeros(points)) if number == 0 else self.prints[number - 1].correction.drawing

    def name(self, number: int) -> str:
        """Describe a drawing in words."""
        file = AS_DESIGNED if number == 0 else self.prints[number - 1].correction.file
        return f"correction {number} ({file})"

    @property
    def last_drawing(self) -> int:
        """Number of the drawing for the next print."""
        return self.prints[-1].correction.number if self.prints else 0

    def predicted_of(self, number: int) -> Residual | None:
        """Return the latest prediction of a print by its number: made after an earlier print, for its drawing."""
        drawing, before = self.prints[number - 1].drawing, self.prints[: number - 1]
        return next((one.predicted for one in reversed(before) if one.correction.number == drawing), None)

    def correction(self, number: int) -> Correction | None:
        """Return the correction with a number; None for the design itself."""
        return self.prints[number - 1].correction if number else None

    def with_print(self, one: LoggedPrint) -> "TuningLog":
        """Return the log with one more print."""
        return replace(self, prints=(*self.prints, one))


def read_log(path: Path) -> TuningLog:
    """Read the log from a file; raise `DataError` if it is not a log or is damaged."""
    where = str(path)
    data = parse_json(read_text(path, DataError), where)
    if not isinstance(data, dict) or data.pop("solen", None) != KIND:
        remedy = "name another --log, or remove the file"
        raise DataError(where, limit=f'not a log of solen print tune: it has no "solen": "{KIND}"', remedy=remedy)
    if (schema := data.pop("schema", None)) != SCHEMA:
        raise DataError(f"{where}: schema", value=schema, limit=f"this version of solen reads {SCHEMA}")
    log = build(TuningLog, data, where)
    for number, one in enumerate(log.prints, start=1):
        columns = {len(column) for column in (one.image.arc_mm, one.image.deviation_um, one.image.u_um)}
        if one.number != number or not 0 <= one.drawing < number or len(columns) != 1:
            limit = "prints must be in order, with as many deviations as points, and drawn before they are measured"
            raise DataError(f"{where}: prints[{number - 1}]", limit=limit, remedy="restore the file")
    return log


def log_text(log: TuningLog) -> str:
    """Return the JSON text of a log, for `read_log`."""
    data: dict[str, Any] = {"solen": KIND, "schema": SCHEMA} | log.to_dict()
    return json.dumps(data, indent=1, allow_nan=False) + "\n"
