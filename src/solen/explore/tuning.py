"""Tuning of a lens print by print: measurement of an image, corrected drawing, and prediction of the next print.

A print model predicts the effect of a change of the drawing well, but the shape of a print poorly; an image shows the
shape but not the effect. Common deviations of prints (`solen.explore.systematic`) are therefore determined from images,
and the drawing that cancels them from the model. The means of uniform overgrowth, size (only if the uncertainty of the
scale is specified) and form are corrected; if the images resolve little, these means stay near their priors. The next
print is then predicted with all uncertainties: those of the printer, the images and the model, and the differences
between prints.

`tune` returns a `TunedPrint`, whose `log` is the input of the next call.
"""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, DesignError, SolenError, SpecError
from solen.explore.contour import Contour, ContourDeviations
from solen.explore.print_model import PrintModel
from solen.explore.systematic import (
    BLUR,
    OVERGROWTH,
    SIZE,
    MeasuredPrint,
    Prior,
    Systematic,
    infer_systematic,
    pixel_covariance,
)
from solen.explore.tuned_print import Common, TunedPrint, TunedStep, TuneOptions
from solen.explore.tuned_response import responses
from solen.explore.tuning_log import AS_DESIGNED, Correction, LoggedImage, LoggedPrint, Residual, Responses, TuningLog
from solen.explore.tuning_warnings import image_warnings, prediction_warnings
from solen.fabricate.label import label_of
from solen.fabricate.layers import Slicing
from solen.fabricate.process import Compensation, Deviation, Drawing, outline_text
from solen.fabricate.process.printed_design import profile_of_print
from solen.lens import DesignedLens, LensInSpace
from solen.lens.build import measured_lens
from solen.lens.profile import MeasuredProfile
from solen.metrology import LensInspection
from solen.metrology.nominal import END_MM
from solen.progress import Progress
from solen.ranks import Caution, warning
from solen.sensor import Sensor
from solen.sensor.as_printed import DRAWS

SAMPLES, SEED = 2000, 1
POINT_STEP = 3
"""Index step between the points of the lens that are used in the fit."""
MAX_BLUR_STEPS = 3.0
"""Largest increase of the printer's blur, in standard uncertainties."""
MAX_LOG_RATIO = 20.0
"""Log-likelihood ratio above which a print is considered to be a print of another drawing."""
UNKNOWN_DRAWING = -1
FIXED_SHRINKAGE_U = 1e-3
"""Uncertainty in % that keeps the shrinkage at its prior, so that the size error is attributed to the image scale."""


def tune(
    inspection: LensInspection,
    sensor: Sensor,
    slicing: Slicing = Slicing(),
    options: TuneOptions = TuneOptions(),
    log: TuningLog | None = None,
    *,
    file: str = "tuned.toml",
    response: bool = True,
    progress: Progress | None = None,
) -> TunedPrint:
    """Return the next drawing from a print and the prints of the log, with the prediction of its print.

    Parameters
    ----------
    inspection
        The print in its image, measured against the original design.
    sensor
        The original design.
    slicing
        Process, printer's pixels, and position of the lens in its pixel.
    options
        Priors of prints, and the drawing of this print.
    log
        Earlier prints; None for the first print.
    file
        Name of the design file that will contain the drawing.
    response
        Whether to trace the response.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    DataError
        If the log belongs to another design or printer, or the print is a print of another drawing.
    SpecError, DesignError
        If the part is not printed flat, or the design does not have a single lens.
    """
    check_tunable(sensor)
    model = PrintModel.of(sensor, slicing)
    log = _checked(log, sensor, model, inspection)
    number = _drawing(log, model, options)
    tuning = _Tuning(inspection, sensor, model, log, options, number)
    tuning.check_drawing()
    return tuning.with_fitted_blur().result(file, progress, response=response)


def check_tunable(sensor: Sensor) -> None:
    """Raise `DesignError` if the lens of a design is not a single profile, which an image of its print can show."""
    if isinstance(sensor.cut, LensInSpace):
        limit = "a lens whose profile varies with height cannot be tuned: an image shows the profile at only one height"
        remedy = "use solen print predict --compensate, and measure both faces with solen print inspect --bottom"
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit=limit, remedy=remedy)
    if not isinstance(sensor.cut, DesignedLens):
        limit = "the designed lens must be a Cartesian oval or a spline"
        raise DesignError("lens", value=sensor.design.lens.shape, limit=limit, remedy="specify the intended design")


def _checked(log: TuningLog | None, sensor: Sensor, model: PrintModel, inspection: LensInspection) -> TuningLog:
    """Return the log or a new one; raise `DataError` for another design or printer, or an image already in the log."""
    design = sensor.design
    new = TuningLog(design.name, label_of(design, "").sha256, model.settings.pixels_um, model.phase_px)
    if log is None:
        return new
    if log.sha256 != new.sha256:
        limit = f"is not the design of the log, {log.design}, or has been changed"
        remedy = "specify the design of the log, or another --log"
        raise DataError("--design", value=design.name, limit=limit, remedy=remedy)
    if (log.pixels_um, log.phase_px) != (new.pixels_um, new.phase_px):
        value = f"pixels of {new.pixels_um[0]:g} x {new.pixels_um[1]:g} µm, vertex at {new.phase_px}"
        limit = f"the prints of the log have {log.pixels_um[0]:g} x {log.pixels_um[1]:g} µm, vertex at {log.phase_px}"
        raise DataError(
            "--printer", value=value, limit=limit, remedy="specify the printer and --phase-px of those prints"
        )
    source = inspection.sources[0]
    for logged in log.prints:
        if logged.image.sha256 == source.sha256:
            limit = f"is the image of print {logged.number} of the log"
            raise DataError(source.file, limit=limit, remedy="take an image of the print of the last correction")
    return log


def _drawing(log: TuningLog, model: PrintModel, options: TuneOptions) -> int:
    """Return the number of the drawing of this print; raise `DataError` if ``--drawn`` is another drawing."""
    expected = log.last_drawing
    if options.another_copy:
        if not log.prints:
            limit = "requires an earlier print, but the log has none"
            raise SpecError("--another-copy", limit=limit, remedy="omit --another-copy")
        expected = log.prints[-1].drawing
    if options.drawn is None:
        return expected
    sha256 = model.outline_sha256(options.drawn)
    hashes = {0: None} | {logged.number: logged.correction.sha256 for logged in log.prints if not logged.keeps}
    if sha256 == hashes[expected]:
        return expected
    matches = [number for number, known in hashes.items() if known == sha256]
    identity = f"is {log.name(matches[0])}" if matches else "is not a drawing of this log"
    limit = f"{identity}, but this print should be a print of {log.name(expected)}"
    remedy = f"take an image of a print of {log.name(expected)}"
    raise DataError("--drawn", value=options.drawn.name, limit=limit, remedy=remedy)


@dataclass(frozen=True, eq=False)
class _Tuning:
    """A print and the earlier prints."""

    inspection: LensInspection
    sensor: Sensor
    model: PrintModel
    log: TuningLog
    options: TuneOptions
    number: int
    blur: float = 0.0

    def with_fitted_blur(self) -> "_Tuning":
        """Return the tuning with the model's blur fitted to the prints, since its effect on pixels is nonlinear."""
        mean = self._systematic(self.number, self._centre_mm).mean
        blur = float(np.clip(mean[BLUR], self.model.min_blur, MAX_BLUR_STEPS))
        return replace(self, model=self.model.with_more_blur(blur), blur=blur)

    @cached_property
    def contour(self) -> Contour:
        return Contour(self.inspection.nominal)

    @property
    def _centre_mm(self) -> FloatArray:
        """A single length along the front, which suffices for results that do not depend on it."""
        return np.array([0.5 * self.contour.length_mm])

    @cached_property
    def deviations(self) -> ContourDeviations:
        return ContourDeviations.of(self.inspection)

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Lengths along the front of the points used in the fit."""
        return self.inspection.nominal.nearest(self.model.target.points_mm[::POINT_STEP]).arc_mm

    @cached_property
    def drawing(self) -> Drawing:
        return self._drawing(self.number)

    @cached_property
    def common(self) -> Systematic:
        return self._systematic(self.number, self.arc_mm)

    def _drawing(self, number: int) -> Drawing:
        return self.log.drawing(number, len(self.model.target.points_mm))

    def _systematic(self, number: int, arc_mm: FloatArray, pixels_of: int | None = None, **priors: float) -> Systematic:
        """Return the common deviations of all prints, assuming that this one is a print of the drawing ``number``.

        With ``pixels_of``, the errors of the pixel effects are those of drawing ``pixels_of``.
        """
        prints = [(logged.image.deviations, logged.drawing, logged.drawing) for logged in self.log.prints]
        prints.append((self.deviations, number, number if pixels_of is None else pixels_of))
        measured = [
            MeasuredPrint(deviations, group, *self.model.effect_on(deviations, self.contour, self._drawing(drawing)))
            for deviations, drawing, group in prints
        ]
        keys = ("overgrowth_um", "u_overgrowth_um", "shrinkage_percent", "u_shrinkage_percent", "repeat_um")
        prior = Prior(**({key: getattr(self.options, key) for key in keys} | priors), blur=-self.blur)
        return infer_systematic(self.contour, measured, prior, arc_mm)

    def check_drawing(self) -> None:
        """Raise `DataError` if the print resembles a print of another drawing, unless its drawing is specified."""
        if not self.log.prints or self.options.drawn is not None:
            return
        numbers = [0, *(logged.number for logged in self.log.prints if not logged.keeps)]
        logs = {number: self._systematic(number, self._centre_mm, UNKNOWN_DRAWING).log_evidence for number in numbers}
        best = max(logs, key=lambda number: logs[number])
        if logs[best] - logs[self.number] > MAX_LOG_RATIO:
            expected = self.log.name(self.number)
            limit = f"looks like a print of {self.log.name(best)}, but should be a print of {expected}"
            remedy = f"take an image of a print of {expected}, or specify the printed drawing with --drawn"
            raise DataError(self.inspection.sources[0].file, limit=limit, remedy=remedy)

    @cached_property
    def has_u_scale(self) -> bool:
        """Whether the scale of every image has an uncertainty; otherwise the size is not corrected."""
        u_scales = [logged.image.u_um_per_px for logged in self.log.prints]
        return None not in (*u_scales, self.inspection.scale.u_um_per_px)

    @cached_property
    def corrections(self) -> tuple[FloatArray, float, float, tuple[str, ...]]:
        """Deviation (n,) of the front, overgrowth in µm and relative size included in it, and names of the corrections.

        Each is corrected as far as it is resolved, since means are damped towards the priors.
        """
        common = self.common
        if not self.has_u_scale:
            common = self._systematic(self.number, self.arc_mm, u_shrinkage_percent=FIXED_SHRINKAGE_U)
        front = common.mean[: len(self.arc_mm)]
        overgrowth, size = float(common.mean[OVERGROWTH]), float(common.mean[SIZE])
        names = ["overgrowth"] if abs(overgrowth) > common.u[OVERGROWTH] else []
        names += ["size"] if self.has_u_scale and abs(size) > common.u[SIZE] else []
        if self.inspection.mirrored is None:
            return 0.5 * (front + front[::-1]), overgrowth, size, ("symmetric form", *names)
        return front, overgrowth, size, ("form", *names)

    @cached_property
    def next_drawing(self) -> Compensation:
        """Drawing of the next print."""
        return self.model.with_prediction(self.drawing) if self.kept else self._compensation

    @cached_property
    def kept(self) -> bool:
        """Whether the corrected drawing is no better, in form or walls, than the previous one."""
        return not self._walls_moved and self._corrected.rms_um >= self._unchanged.rms_um

    @cached_property
    def _walls_moved(self) -> bool:
        """Whether walls move by more than their uncertainty, which is not visible in a registered deviation."""
        return bool(abs(self._compensation.wall_um - self.drawing.wall_um) > self.common.u[OVERGROWTH])

    @cached_property
    def _unchanged(self) -> Residual:
        return self.residual(self.next_prints(self.drawing))

    @cached_property
    def _corrected(self) -> Residual:
        return self.residual(self.next_prints(self._compensation.drawing))

    @cached_property
    def _compensation(self) -> Compensation:
        """Drawing that cancels the common deviations."""
        front, overgrowth, size, _ = self.corrections
        along = self.inspection.nominal.nearest(self.model.target.points_mm).arc_mm
        start = replace(self.drawing, wall_um=-overgrowth, scale=1.0 / (1.0 + size))
        return self.model.compensation(np.interp(along, self.arc_mm, front), start)

    @cached_property
    def samples(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Random samples of what determines the next print.

        They are states (SAMPLES, n + 3) of the common deviations, individual forms (SAMPLES, n) of a print in µm, and
        factors (SAMPLES,) on the error of the modelled pixel effects; see `Systematic.samples`.
        """
        return self.common.samples(SAMPLES, np.random.default_rng(SEED))

    @cached_property
    def _registered(self) -> FloatArray:
        """Projection (n, n) that removes rotation and shift from deviations, as registration does."""
        rigid = self.contour.by_rigid(self.arc_mm) * self.measured_part[:, None]
        basis = self.contour.by_rigid(self.arc_mm) @ np.linalg.pinv(rigid)
        return np.asarray(np.eye(len(self.arc_mm)) - basis)

    @cached_property
    def measured_part(self) -> BoolArray:
        """Mask (n,) of the points that are not at corners."""
        return np.asarray((self.arc_mm > END_MM) & (self.arc_mm < self.contour.length_mm - END_MM))

    def next_prints(self, drawing: Drawing) -> FloatArray:
        """Return random deviations (SAMPLES, n) of the next print of a drawing, registered."""
        states, forms, error_factors = self.samples
        effect, per_blur = (column[::POINT_STEP] for column in self.model.effect(drawing))
        deviation = states[:, : len(self.arc_mm)] + effect + np.outer(states[:, BLUR], per_blur) + forms
        if not self.model.is_designed(drawing):
            covariance = pixel_covariance(self.arc_mm, self.model.u_pixels_um[::POINT_STEP])
            rng = np.random.default_rng(SEED + 1)
            pixels = rng.multivariate_normal(np.zeros(len(covariance)), covariance, SAMPLES, method="eigh")
            deviation += error_factors[:, None] * pixels
        return np.asarray(deviation @ self._registered.T)

    def residual(self, prints: FloatArray) -> Residual:
        """Return statistics of the RMS deviations of prints."""
        rms = np.sqrt(np.mean(prints[:, self.measured_part] ** 2, axis=1))
        low, high = np.quantile(rms, [0.025, 0.975]).tolist()
        return Residual(float(rms.mean()), float(rms.std()), (low, high))

    def result(self, file: str, progress: Progress | None, *, response: bool) -> TunedPrint:
        """Return the result of the tuning."""
        compensation, inspection = self.next_drawing, self.inspection
        prints = self.next_prints(compensation.drawing)
        predicted = self.residual(prints)
        traced, failures = self._responses(prints, progress) if response else (None, [])
        log = self.log.with_print(self._entry(file, predicted, traced))
        warnings = [*image_warnings(inspection, self.model), *failures, *inspection.warnings]
        warnings += prediction_warnings(log, self._corrected, self._unchanged, walls_moved=self._walls_moved)
        return TunedPrint(
            design=self.sensor.design.name,
            simulated=any(logged.image.simulated for logged in log.prints),
            process=self.model.process.name,
            number=len(log.prints),
            drawn_by=self.log.name(self.number),
            rms_um=inspection.deviation.rms_um,
            u_rms_um=inspection.deviation.u_rms_um,
            common=self._summary(),
            corrected=() if self.kept else self.corrections[3],
            kept=self.kept,
            wall_um=compensation.wall_um,
            scale=compensation.scale,
            unchanged=self._unchanged,
            predicted=predicted,
            response=traced,
            history=_history(log),
            x_mm=self.model.target.points_mm[::POINT_STEP, 0],
            measured_um=self._measured(),
            predicted_um=prints.mean(axis=0),
            u_predicted_um=prints.std(axis=0),
            sources=(*inspection.sources, *self.model.sources),
            warnings=tuple(dict.fromkeys(warnings)),
            compensation=compensation,
            profile=self._profile(prints.mean(axis=0), predicted.u_rms_um),
            log=log,
        )

    def _summary(self) -> Common:
        mean, u, n = self.common.mean, self.common.u, len(self.arc_mm)
        form = mean[:n] - mean[OVERGROWTH] - mean[SIZE] * 1e3 * self.contour.by_size(self.arc_mm)
        remainder = (self._registered @ form)[self.measured_part]
        return Common(
            overgrowth_um=float(mean[OVERGROWTH]),
            u_overgrowth_um=float(u[OVERGROWTH]),
            size_percent=100.0 * float(mean[SIZE]),
            u_size_percent=100.0 * float(u[SIZE]),
            form_um=float(np.sqrt(np.mean(remainder**2))),
            repeat_um=self.common.repeat_um,
            prints=len(self.log.prints) + 1,
        )

    def _measured(self) -> FloatArray:
        """Return the deviation of this print, registered as in `solen print inspect`; NaN where it was not measured."""
        fit, nominal = self.inspection.outline.chosen.registration, self.inspection.nominal
        arc_mm = nominal.nearest(fit.points_mm).arc_mm
        order = np.argsort(arc_mm)
        deviation_um = np.interp(self.arc_mm, arc_mm[order], fit.deviation_um[order], left=np.nan, right=np.nan)
        return np.asarray(deviation_um)

    def _profile(self, deviation_um: FloatArray, u_um: float) -> MeasuredProfile:
        """Return the profile of the designed lens with a deviation added."""
        target = self.model.target
        along = self.inspection.nominal.nearest(target.points_mm).arc_mm
        deviation = Deviation(target, np.interp(along, self.arc_mm, deviation_um))
        return profile_of_print(deviation, self.sensor.design.name, self.model.process.name, u_um, self.model.sources)

    def _responses(self, prints: FloatArray, progress: Progress | None) -> tuple[Responses | None, list[Caution]]:
        """Return the responses before and after the correction, or a warning with the reason why there are none."""
        designed = self.sensor.lens
        assert isinstance(designed, DesignedLens)  # noqa: S101  ensured by check_tunable
        try:
            measured = measured_lens(designed, self.inspection.profile())
            before = [measured, *(measured.with_outline(number) for number in range(1, DRAWS + 1))]
            deviations = [prints.mean(axis=0), *prints[:DRAWS]]
            after = [measured_lens(designed, self._profile(deviation_um, 0.0)) for deviation_um in deviations]
            return responses(self.sensor, before, after, progress), []
        except SolenError as error:
            return None, [warning(f"no response: {error}")]

    def _entry(self, file: str, predicted: Residual, traced: Responses | None) -> LoggedPrint:
        """Return the log entry of this print."""
        source, deviations, compensation = self.inspection.sources[0], self.deviations, self.next_drawing
        arrays = (deviations.arc_mm, deviations.deviation_um, deviations.u_um)
        columns = (tuple(np.round(array, 5).tolist()) for array in arrays)
        scale = self.inspection.scale
        face = self.options.seen_from
        image = LoggedImage(
            source.file, source.sha256, source.simulated, scale.um_per_px, scale.u_um_per_px, face, *columns
        )
        number = len(self.log.prints) + 1
        sha256 = hashlib.sha256(outline_text(self.sensor, compensation).encode()).hexdigest()
        deviation = self.inspection.deviation
        correction = Correction.of(number, file, sha256, compensation.drawing)
        if self.kept:
            unchanged = Correction.of(0, AS_DESIGNED, sha256, compensation.drawing)
            correction = self.log.correction(self.number) or unchanged
        return LoggedPrint(
            number, self.number, image, deviation.rms_um, deviation.u_rms_um, correction, predicted, traced
        )


def _history(log: TuningLog) -> tuple[TunedStep, ...]:
    return tuple(
        TunedStep(logged.number, logged.drawing, logged.rms_um, logged.u_rms_um, log.predicted_of(logged.number))
        for logged in log.prints
    )
