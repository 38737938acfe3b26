"""Effect of a drawing on its print according to the print model, as differences between drawings.

Public name: `PrintModel`.
"""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.contour import FRONT_PIECES, Contour, Rows
from solen.fabricate.label import label_of
from solen.fabricate.layers import Slicing
from solen.fabricate.process import (
    Compensation,
    Deviation,
    Drawing,
    Printing,
    Process,
    ProcessOptions,
    Settings,
    Target,
    lens_face,
    process_of,
    with_resin,
)
from solen.fabricate.process.predict import FLAT_POINTS
from solen.recording import Provenance
from solen.sensor import Sensor
from solen.spec import load

OWN_SHARE, PLACES = 1.0, 4
"""Relative error of the modelled pixel effect on an edge, and the number of pixel phases compared."""
SLOW_MM, PIECE_MM = 0.3, 0.1
"""Length above which pixels do not cause form deviations, and length over which the deviation is averaged."""


@dataclass(frozen=True, eq=False)
class PrintModel:
    """A design and the process for printing it flat, with the printer's pixels.

    ``wider`` is the process with the blur increased by its standard uncertainty, or None if the blur is exact.
    """

    sensor: Sensor
    process: Process
    sources: tuple[Provenance, ...]
    plain: Printing
    wider: Printing | None
    _known: dict[bytes, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, sensor: Sensor, slicing: Slicing) -> "PrintModel":
        """Create the model of a design from its slicing.

        Raises
        ------
        SpecError
            If it is not printed flat and unrotated.
        DataError
            If the process or the printer is invalid.
        """
        if slicing.orientation != "flat" or any(slicing.rotate_deg):
            limit = "only a lens printed flat, along the printer's X, can be tuned"
            raise SpecError("--orientation or --rotate-deg", value=slicing.orientation, limit=limit, remedy="omit them")
        process, sources = process_of(
            ProcessOptions(process=slicing.process, cure=slicing.cure, printer=slicing.printer)
        )
        process = with_resin(process, sensor.design)
        if slicing.process is None:
            process = process.with_settings(**slicing.differences(process.process))
        if others := slicing.described_differences(process.process):
            limit = "a tuned lens is printed with the layers of its process"
            raise SpecError("--process", value=others[0], limit=limit, remedy="omit that option, or change it")
        body = sensor.body()
        target = Target.of(lens_face(body).curve, FLAT_POINTS)
        thickness_mm = sensor.design.body.thickness_mm
        settings = process.process
        height_um = settings.middle_um(thickness_mm)

        def printing(values: Settings) -> Printing:
            return Printing(body, target, values, thickness_mm, height_um, slicing.phase_px)

        keys, covariance = process.covariance()
        key = settings.blur_key
        u = float(np.sqrt(covariance[keys.index(key), keys.index(key)])) if key in keys else 0.0
        wider = printing(blurred(settings, u)) if u > 0.0 else None
        return cls(sensor, process, sources, printing(settings), wider)

    @property
    def target(self) -> Target:
        """The designed lens."""
        return self.plain.target

    @property
    def settings(self) -> Settings:
        """Settings of the process."""
        return self.plain.settings

    @property
    def phase_px(self) -> tuple[float, float]:
        """Position of the vertex in its pixel, in pixels."""
        return self.plain.phase

    @property
    def as_designed(self) -> Drawing:
        """Drawing of the design itself."""
        return Drawing(np.zeros(len(self.target.points_mm)))

    def effect(self, drawing: Drawing) -> tuple[FloatArray, FloatArray]:
        """Return the change (N,) of the print due to another drawing than the design, and its change with more blur."""
        plain = self._moved(self.plain, drawing)
        return plain, (np.zeros_like(plain) if self.wider is None else self._moved(self.wider, drawing) - plain)

    @cached_property
    def of_pixels_um(self) -> FloatArray:
        """Return the standard uncertainty (N,) along the lens of the modelled pixel effects of another drawing."""
        step, (x, z) = float(np.mean(np.diff(self.target.along_mm))), self.phase_px
        squares = []
        for part in range(PLACES):
            placed = replace(self.plain, phase=(x, (z + part / PLACES) % 1.0))
            printed = placed.deviation_um(placed.outlines(self.as_designed))
            squares.append((printed - gaussian_filter1d(printed, SLOW_MM / step, mode="nearest")) ** 2)
        local = gaussian_filter1d(np.mean(squares, axis=0), PIECE_MM / step, mode="nearest")
        return np.asarray(OWN_SHARE * np.sqrt(local))

    def is_designed(self, drawing: Drawing) -> bool:
        """Return whether a drawing is that of the design, whose pixel effects are part of its measured prints."""
        return drawing.scale == 1.0 and not drawing.wall_um and not drawing.drawn_um.any()

    def on(self, rows: Rows, contour: Contour, drawing: Drawing) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the effect of a drawing, its change with more blur, and the model error, for the rows of an image.

        A wall follows its own drawing.
        """
        along = contour.nominal.nearest(self.target.points_mm).arc_mm
        wall = drawing.wall_um * drawing.scale + 1e3 * (drawing.scale - 1.0) * contour.by_size(rows.arc_mm)
        piece = max(1, round(contour.length_mm / FRONT_PIECES / float(np.mean(np.diff(along)))))
        on_front = (rows.arc_mm >= 0.0) & (rows.arc_mm <= contour.length_mm)
        lens, more = (
            np.interp(rows.arc_mm, along, uniform_filter1d(column, piece, mode="nearest"))
            for column in self.effect(drawing)
        )
        missed = np.interp(rows.arc_mm, along, self.of_pixels_um) * (not self.is_designed(drawing))
        return np.where(on_front, lens, wall), np.where(on_front, more, 0.0), np.where(on_front, missed, 0.0)

    def blurred(self, by: float) -> "PrintModel":
        """Return the model with the fitted blur, wider by a multiple of its standard uncertainty."""
        if self.wider is None:
            return self
        u = _width(self.wider.settings) - _width(self.settings)
        plain, wider = (replace(self.plain, settings=blurred(self.settings, more)) for more in (by * u, (by + 1.0) * u))
        return replace(self, plain=plain, wider=wider)

    @property
    def least_blur(self) -> float:
        """Largest reduction of the blur, to half, in standard uncertainties."""
        if self.wider is None:
            return 0.0
        return -0.5 * _width(self.settings) / (_width(self.wider.settings) - _width(self.settings))

    def against(self, beyond_um: FloatArray, start: Drawing) -> Compensation:
        """Return the drawing that prints as the designed lens, if the design prints ``beyond_um`` (N,) too large."""
        return self.plain.corrected(start, beyond_um - self._printed(self.plain, self.as_designed))

    def drawn(self, drawing: Drawing) -> Compensation:
        """Return a drawing and its predicted print."""
        outlines = self.plain.outlines(drawing)
        printed = Deviation(self.target, self._printed(self.plain, drawing))
        return Compensation(outlines, drawing.drawn_um, drawing.wall_um, drawing.scale, printed, ())

    def sha256_of(self, path: Path) -> str | None:
        """Hash of the outline of a design file, or None for the original design."""
        design = load(path)
        if label_of(design, "").sha256 == label_of(self.sensor.design, "").sha256:
            return None
        outline = design.files.get("body.file")
        return hashlib.sha256((path if outline is None else outline).read_bytes()).hexdigest()

    def _moved(self, printing: Printing, drawing: Drawing) -> FloatArray:
        return self._printed(printing, drawing) - self._printed(printing, self.as_designed)

    def _printed(self, printing: Printing, drawing: Drawing) -> FloatArray:
        """Return the predicted print of a drawing, cached."""
        sizes = np.array([drawing.wall_um, drawing.scale, _width(printing.settings)])
        key = drawing.drawn_um.tobytes() + sizes.tobytes()
        if key not in self._known:
            self._known[key] = printing.deviation_um(printing.outlines(drawing))
        return self._known[key]


def blurred(settings: Settings, more: float) -> Settings:
    """Return the settings with a wider blur."""
    wider = settings.model_copy(update={settings.blur_key: _width(settings) + more})
    return wider.model_copy(update={"halo_um": max(wider.halo_um, wider.blur_um)})


def _width(settings: Settings) -> float:
    """Return the key of the blur."""
    return float(getattr(settings, settings.blur_key))
