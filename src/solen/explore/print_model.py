"""Effect of a drawing on its print according to the print model, relative to the drawing of the design.

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
from solen.explore.contour import FRONT_PIECES, Contour, ContourDeviations
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

MODEL_ERROR, PHASES = 1.0, 4
"""Relative error of the modelled effect of pixels on an edge, and the number of positions in a pixel at which it is
computed.
"""
FORM_LENGTH_MM, AVERAGE_LENGTH_MM = 0.3, 0.1
"""Standard deviations of Gaussian filters: the one that separates pixel effects from the form, and the one that
averages their squares.
"""


@dataclass(frozen=True, eq=False)
class PrintModel:
    """A design and the process that prints it flat, with the printer's pixels.

    ``wider`` is ``plain`` with the blur increased by its standard uncertainty, or None if that is 0.
    """

    sensor: Sensor
    process: Process
    sources: tuple[Provenance, ...]
    plain: Printing
    wider: Printing | None
    _cache: dict[bytes, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, sensor: Sensor, slicing: Slicing) -> "PrintModel":
        """Create the model of a design from its slicing.

        Raises
        ------
        SpecError
            If the lens is not printed flat and unrotated, or its layers are not those of the process.
        DataError
            If the process or the printer is invalid.
        """
        if slicing.orientation != "flat" or any(slicing.rotate_deg):
            limit = "only a lens printed flat, along the printer's X, can be tuned"
            what = "--orientation or --rotate-deg"
            raise SpecError(what, value=slicing.orientation, limit=limit, remedy="omit both options")
        process, sources = process_of(
            ProcessOptions(process=slicing.process, cure=slicing.cure, printer=slicing.printer)
        )
        process = with_resin(process, sensor.design)
        if slicing.process is None:
            process = process.with_settings(**slicing.differences(process.process))
        if others := slicing.described_differences(process.process):
            limit = f"a tuned lens is printed with the layers of its process: {others[0]}"
            raise SpecError("--process", limit=limit, remedy=f"omit {others[0].partition(' ')[0]}")
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
        wider = printing(with_blur(settings, u)) if u > 0.0 else None
        return cls(sensor, process, sources, printing(settings), wider)

    @property
    def target(self) -> Target:
        """Target shape: the designed lens."""
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
        """Return the change (N,) of the print from that of the design, and the increase of this change with more blur.

        More blur means a blur wider by its standard uncertainty.
        """
        change = self._change(self.plain, drawing)
        return change, (np.zeros_like(change) if self.wider is None else self._change(self.wider, drawing) - change)

    @cached_property
    def u_pixels_um(self) -> FloatArray:
        """Standard uncertainty (N,) along the lens of the modelled pixel effects of a drawing other than the design."""
        step, (x, z) = float(np.mean(np.diff(self.target.along_mm))), self.phase_px
        squares = []
        for k in range(PHASES):
            printing = replace(self.plain, phase=(x, (z + k / PHASES) % 1.0))
            printed = printing.deviation_um(printing.outlines(self.as_designed))
            squares.append((printed - gaussian_filter1d(printed, FORM_LENGTH_MM / step, mode="nearest")) ** 2)
        local = gaussian_filter1d(np.mean(squares, axis=0), AVERAGE_LENGTH_MM / step, mode="nearest")
        return np.asarray(MODEL_ERROR * np.sqrt(local))

    def is_designed(self, drawing: Drawing) -> bool:
        """Return whether a drawing is that of the design, whose pixel effects are part of its measured prints."""
        return drawing.scale == 1.0 and not drawing.wall_um and not drawing.drawn_um.any()

    def effect_on(
        self, deviations: ContourDeviations, contour: Contour, drawing: Drawing
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the effect of a drawing, its increase with more blur, and the model's error, on each piece of a print.

        Walls are displaced as drawn.
        """
        arc_mm = deviations.arc_mm
        along = contour.nominal.nearest(self.target.points_mm).arc_mm
        wall = drawing.wall_um * drawing.scale + 1e3 * (drawing.scale - 1.0) * contour.by_size(arc_mm)
        piece = max(1, round(contour.length_mm / FRONT_PIECES / float(np.mean(np.diff(along)))))
        on_front = (arc_mm >= 0.0) & (arc_mm <= contour.length_mm)
        lens, per_blur = (
            np.interp(arc_mm, along, uniform_filter1d(column, piece, mode="nearest")) for column in self.effect(drawing)
        )
        u_model = np.interp(arc_mm, along, self.u_pixels_um) * (not self.is_designed(drawing))
        return np.where(on_front, lens, wall), np.where(on_front, per_blur, 0.0), np.where(on_front, u_model, 0.0)

    def with_more_blur(self, steps: float) -> "PrintModel":
        """Return the model with a blur that is wider by a multiple of its standard uncertainty."""
        if self.wider is None:
            return self
        u = _blur_width(self.wider.settings) - _blur_width(self.settings)
        plain, wider = (
            replace(self.plain, settings=with_blur(self.settings, more)) for more in (steps * u, (steps + 1.0) * u)
        )
        return replace(self, plain=plain, wider=wider)

    @property
    def min_blur(self) -> float:
        """Change of the blur to half its value, the largest allowed reduction, in standard uncertainties; negative."""
        if self.wider is None:
            return 0.0
        return -0.5 * _blur_width(self.settings) / (_blur_width(self.wider.settings) - _blur_width(self.settings))

    def compensation(self, deviation_um: FloatArray, start: Drawing) -> Compensation:
        """Return the drawing that prints as the designed lens if prints of the design deviate by ``deviation_um``."""
        return self.plain.corrected(start, deviation_um - self._printed(self.plain, self.as_designed))

    def with_prediction(self, drawing: Drawing) -> Compensation:
        """Return a drawing and its predicted print."""
        outlines = self.plain.outlines(drawing)
        printed = Deviation(self.target, self._printed(self.plain, drawing))
        return Compensation(outlines, drawing.drawn_um, drawing.wall_um, drawing.scale, printed, ())

    def outline_sha256(self, path: Path) -> str | None:
        """Return the hash of the outline of a design file; None for the original design."""
        design = load(path)
        if label_of(design, "").sha256 == label_of(self.sensor.design, "").sha256:
            return None
        outline = design.files.get("body.file")
        return hashlib.sha256((path if outline is None else outline).read_bytes()).hexdigest()

    def _change(self, printing: Printing, drawing: Drawing) -> FloatArray:
        return self._printed(printing, drawing) - self._printed(printing, self.as_designed)

    def _printed(self, printing: Printing, drawing: Drawing) -> FloatArray:
        """Return the predicted print of a drawing, cached."""
        sizes = np.array([drawing.wall_um, drawing.scale, _blur_width(printing.settings)])
        key = drawing.drawn_um.tobytes() + sizes.tobytes()
        if key not in self._cache:
            self._cache[key] = printing.deviation_um(printing.outlines(drawing))
        return self._cache[key]


def with_blur(settings: Settings, more: float) -> Settings:
    """Return the settings with a blur that is wider by ``more``, in the unit of its parameter."""
    wider = settings.model_copy(update={settings.blur_key: _blur_width(settings) + more})
    return wider.model_copy(update={"halo_um": max(wider.halo_um, wider.blur_um)})


def _blur_width(settings: Settings) -> float:
    """Return the value of the parameter that determines the blur."""
    return float(getattr(settings, settings.blur_key))
