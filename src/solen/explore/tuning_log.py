"""The log of a tuning: one entry for each print, with its image, measurement and next drawing.

Each call evaluates all logged measurements and drawings again. A drawing is identified by the hash of its outline, an
image by that of its file.

Public names: `TuningLog`, `read_log` and `log_text`.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from solen.errors import DataError
from solen.explore.contour import ContourDeviations
from solen.fabricate.process import Drawing
from solen.files import read_text
from solen.results import Result
from solen.spec.objects import build, parse_json

KIND = "print tuning log"
SCHEMA = 1
AS_DESIGNED = "the design itself"


class Correction(Result):
    """A drawing: number 0 is the design itself, and any other has the number of the print from which it was computed.

    Attributes
    ----------
    number, file, sha256
        Number of the drawing, name of its design file, and hash of its outline.
    lens_um
        Displacement of the drawn lens from the designed one along its normals, at equidistant points.
    wall_um, scale
        Outward displacement of other walls, and scale factor of the drawing.
    """

    number: int
    file: str
    sha256: str
    lens_um: tuple[float, ...]
    wall_um: float
    scale: float

    @classmethod
    def of(cls, number: int, file: str, sha256: str, drawing: Drawing) -> "Correction":
        """Return the log entry of a drawing."""
        lens = tuple(np.round(drawing.drawn_um, 5).tolist())
        return cls(number, file, sha256, lens, drawing.wall_um, drawing.scale)

    @property
    def drawing(self) -> Drawing:
        """The drawing."""
        return Drawing(np.array(self.lens_um), self.wall_um, self.scale)


class LoggedImage(Result):
    """Measurement of a print from an image, as in `solen.explore.contour.ContourDeviations`."""

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
    def deviations(self) -> ContourDeviations:
        """Deviations of the print along its contour."""
        arc, deviation, u = (np.array(column) for column in (self.arc_mm, self.deviation_um, self.u_um))
        return ContourDeviations(arc, deviation, u, self.um_per_px, self.u_um_per_px)


@dataclass(frozen=True)
class Residual:
    """Predicted RMS deviation of the next print, its standard uncertainty and 95 % interval."""

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
        Null from the contrast and the slope at 0°; None if it is not near 0°.
    slope_per_deg, u_slope_per_deg
        Slope of the contrast about 0°.
    """

    angle_deg: tuple[float, ...]
    contrast: tuple[float, ...]
    u_contrast: tuple[float, ...]
    null_deg: float | None
    u_null_deg: float | None
    slope_per_deg: float
    u_slope_per_deg: float


class Responses(Result):
    """Responses as designed, of this print, and as predicted for the next print."""

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
        Number of the print, and that of its drawing.
    image
        Measurement from the image of the print.
    rms_um, u_rms_um
        Deviation of the print, as `solen print inspect` measures it.
    correction
        The next drawing, from this and all earlier prints; the previous one if it is kept.
    predicted
        Predicted deviation of the next print of that drawing.
    response
        Responses before and after the correction; None if not traced.
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
    """Prints of one design on one printer, with the pixel pitch and the position of the vertex in its pixel."""

    design: str
    sha256: str
    pixels_um: tuple[float, float]
    phase_px: tuple[float, float]
    prints: tuple[LoggedPrint, ...] = ()

    def drawing(self, number: int, points: int) -> Drawing:
        """Return drawing ``number``.

        Number 0 is the design without a correction: the displacement is 0 at ``points`` points along the lens.
        """
        return Drawing(np.zeros(points)) if number == 0 else self.prints[number - 1].correction.drawing

    def name(self, number: int) -> str:
        """Return the name of drawing ``number``, for messages."""
        file = AS_DESIGNED if number == 0 else self.prints[number - 1].correction.file
        return f"correction {number} ({file})"

    @property
    def last_drawing(self) -> int:
        """Number of the drawing for the next print."""
        return self.prints[-1].correction.number if self.prints else 0

    def predicted_of(self, number: int) -> Residual | None:
        """Return the latest prediction for print ``number`` from earlier prints; None if there is none."""
        drawing, earlier = self.prints[number - 1].drawing, self.prints[: number - 1]
        return next((logged.predicted for logged in reversed(earlier) if logged.correction.number == drawing), None)

    def correction(self, number: int) -> Correction | None:
        """Return correction ``number``; None for number 0, the design itself."""
        return self.prints[number - 1].correction if number else None

    def with_print(self, logged: LoggedPrint) -> "TuningLog":
        """Return the log with one more print."""
        return replace(self, prints=(*self.prints, logged))


def read_log(path: Path) -> TuningLog:
    """Read the log from a file; raise `DataError` if it is not a log or is damaged."""
    name = str(path)
    data = parse_json(read_text(path, DataError), name)
    if not isinstance(data, dict) or data.pop("solen", None) != KIND:
        limit = f'is not a log of solen print tune: it does not contain "solen": "{KIND}"'
        raise DataError(name, limit=limit, remedy="specify another --log, or remove the file")
    if (schema := data.pop("schema", None)) != SCHEMA:
        limit = f"must be {SCHEMA}, which this version of solen reads"
        raise DataError(f"{name}: schema", value=schema, limit=limit, remedy="install a newer version of solen")
    log = build(TuningLog, data, name)
    for number, logged in enumerate(log.prints, start=1):
        image = logged.image
        lengths = {len(column) for column in (image.arc_mm, image.deviation_um, image.u_um)}
        if logged.number != number or not 0 <= logged.drawing < number or len(lengths) != 1:
            limit = "prints must be in order, with as many deviations as points and the drawing of an earlier print"
            raise DataError(f"{name}: prints[{number - 1}]", limit=limit, remedy="restore the file from a backup")
    return log


def log_text(log: TuningLog) -> str:
    """Return the JSON text of a log, for `read_log`."""
    data: dict[str, Any] = {"solen": KIND, "schema": SCHEMA} | log.to_dict()
    return json.dumps(data, indent=1, allow_nan=False) + "\n"
