"""Tuning of a lens print by print: measurement of an image, corrected drawing, and prediction of the next print.

A print model predicts the effect of a change of the drawing well, but the absolute print poorly; an image does the
reverse. Common deviations of prints (`solen.explore.systematic`) are therefore taken from the images, and the drawing
that cancels them from the model. Means of uniform overgrowth, size (with a stated scale only) and form are corrected:
if images resolve little, they stay near their priors. The next print is then predicted with all uncertainties: of the
printer, the images, the model, and of individual prints.

`tune` returns a `TunedPrint`, whose `log` is the input of the next call.
"""

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, DesignError, SolenError, SpecError
from solen.explore.contour import Contour, Rows
from solen.explore.print_model import PrintModel
from solen.explore.systematic import BLUR, OVERGROWTH, SIZE, Known, Print, Systematic, learnt, of_pixels
from solen.explore.tuned_print import Common, TunedPrint, TunedStep, TuneOptions
from solen.explore.tuned_response import responses
from solen.explore.tuning_log import AS_DESIGNED, Correction, LoggedImage, LoggedPrint, Residual, Responses, TuningLog
from solen.explore.tuning_warnings import of_image, of_prediction
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
EVERY = 3
"""Every n-th point of the lens is used in the fit."""
MAX_BLUR_RATIO = 3.0
"""Largest increase of the printer's blur, in standard uncertainties."""
UNLIKE = 20.0
"""Logarithm of a likelihood ratio above which a print is considered to be one of another drawing."""
NO_DRAWING = -1
EXACT = 1e-3
"""Uncertainty in % of a shrinkage that absorbs the scale's error."""


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
        Process, printer's pixels, and the lens's position in its pixel.
    options
        Priors of prints, and the drawing of this one.
    log
        Earlier prints; None at first.
    file
        Name of the design file that will contain the drawing.
    response
        Whether the response is traced.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    DataError
        If the log is of another design or printer, or the print of another drawing.
    SpecError, DesignError
        If the part is not printed flat, or the design does not have a single lens.
    """
    check_tunable(sensor)
    model = PrintModel.of(sensor, slicing)
    log = _checked(log, sensor, model, inspection)
    number = _drawing(log, model, options)
    problem = _Tuning(inspection, sensor, model, log, options, number)
    problem.check_likeness()
    return problem.settled().tuned(file, progress, response=response)


def check_tunable(sensor: Sensor) -> None:
    """Raise `DesignError` if a design does not have a single outline visible in an image of its print."""
    if isinstance(sensor.cut, LensInSpace):
        limit = "a lens that varies with height cannot be tuned: an image shows only one height of it"
        remedy = (
            "correct it with solen print predict --compensate, and measure both faces with solen print inspect --bottom"
        )
        raise DesignError("lens.shape", value=sensor.design.lens.shape, limit=limit, remedy=remedy)
    if not isinstance(sensor.cut, DesignedLens):
        limit = "the designed lens must be a Cartesian oval or a spline"
        raise DesignError("lens", value=sensor.design.lens.shape, limit=limit, remedy="name the intended design")


def _checked(log: TuningLog | None, sensor: Sensor, model: PrintModel, inspection: LensInspection) -> TuningLog:
    """Return the log or a new one; raise `DataError` for another design or printer, or an image already in the log."""
    design = sensor.design
    new = TuningLog(design.name, label_of(design, "").sha256, model.settings.pixels_um, model.phase_px)
    if log is None:
        return new
    if log.sha256 != new.sha256:
        limit = f"is not the design of the log, {log.design}, or has changed since"
        raise DataError("--design", value=design.name, limit=limit, remedy="name that design, or start another --log")
    if (log.pixels_um, log.phase_px) != (new.pixels_um, new.phase_px):
        value = f"pixels of {new.pixels_um[0]:g} x {new.pixels_um[1]:g} µm, vertex at {new.phase_px}"
        limit = f"the log's prints have {log.pixels_um[0]:g} x {log.pixels_um[1]:g} µm and {log.phase_px}"
        raise DataError(
            "--printer", value=value, limit=limit, remedy="specify the printer and --phase-px of those prints"
        )
    source = inspection.sources[0]
    for one in log.prints:
        if one.image.sha256 == source.sha256:
            limit = f"is the image of print {one.number} of the log"
            raise DataError(source.file, limit=limit, remedy="photograph the print of the last correction")
    return log


def _drawing(log: TuningLog, model: PrintModel, options: TuneOptions) -> int:
    """Return the number of the print's correction; raise `DataError` if its file is another one."""
    last = log.last_drawing
    if options.another_copy:
        if not log.prints:
            raise SpecError("--another-copy", limit="needs an earlier print, but the log has none", remedy="omit it")
        last = log.prints[-1].drawing
    if options.drawn is None:
        return last
    sha256 = model.sha256_of(options.drawn)
    hashes = {0: None} | {one.number: one.correction.sha256 for one in log.prints if not one.keeps}
    if sha256 == hashes[last]:
        return last
    same = [number for number, known in hashes.items() if known == sha256]
    found = f"is {log.name(same[0])}" if same else "is not a drawing of this log"
    limit = f"{found}; this print should be a print of {log.name(last)}"
    raise DataError("--drawn", value=options.drawn.name, limit=limit, remedy="photograph a print of that drawing")


@dataclass(frozen=True, eq=False)
class _Tuning:
    """A print and the earlier ones."""

    inspection: LensInspection
    sensor: Sensor
    model: PrintModel
    log: TuningLog
    options: TuneOptions
    number: int
    blur: float = 0.0

    def settled(self) -> "_Tuning":
        """Return the tuning with the blur that the prints show, since its effect on pixels is not linear."""
        somewhere = np.array([0.5 * self.contour.length_mm])
        blur = float(np.clip(self._learnt(self.number, somewhere).mean[BLUR], self.model.least_blur, MAX_BLUR_RATIO))
        return replace(self, model=self.model.blurred(blur), blur=blur)

    @cached_property
    def contour(self) -> Contour:
        return Contour(self.inspection.nominal)

    @cached_property
    def rows(self) -> Rows:
        return Rows.of(self.inspection)

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Lengths along the front of the points used in the fit."""
        return self.inspection.nominal.nearest(self.model.target.points_mm[::EVERY]).arc_mm

    @cached_property
    def drawing(self) -> Drawing:
        return self._drawing(self.number)

    @cached_property
    def common(self) -> Systematic:
        return self._learnt(self.number, self.arc_mm)

    def _drawing(self, number: int) -> Drawing:
        return self.log.drawing(number, len(self.model.target.points_mm))

    def _learnt(self, number: int, arc_mm: FloatArray, pixels_of: int | None = None, **otherwise: float) -> Systematic:
        """Return the common deviations of all prints, given the correction of this one.

        Pixel effects are those of another drawing if ``pixels_of`` names one.
        """
        every = [(one.image.rows, one.drawing, one.drawing) for one in self.log.prints]
        every.append((self.rows, number, number if pixels_of is None else pixels_of))
        prints = [Print(rows, of, *self.model.on(rows, self.contour, self._drawing(by))) for rows, by, of in every]
        keys = ("overgrowth_um", "u_overgrowth_um", "shrinkage_percent", "u_shrinkage_percent", "repeat_um")
        known = Known(**({key: getattr(self.options, key) for key in keys} | otherwise), blur=-self.blur)
        return learnt(self.contour, prints, known, arc_mm)

    def check_likeness(self) -> None:
        """Raise `DataError` if the print looks like one of another drawing, and its drawing is not stated."""
        if not self.log.prints or self.options.drawn is not None:
            return
        somewhere = np.array([0.5 * self.contour.length_mm])
        every = [0, *(one.number for one in self.log.prints if not one.keeps)]
        logs = {number: self._learnt(number, somewhere, NO_DRAWING).log_evidence for number in every}
        best = max(logs, key=lambda number: logs[number])
        if logs[best] - logs[self.number] > UNLIKE:
            limit = (
                f"looks like a print of {self.log.name(best)}, but should be a print of {self.log.name(self.number)}"
            )
            remedy = "photograph a print of the latter, or specify with --drawn the drawing from which it was made"
            raise DataError(self.inspection.sources[0].file, limit=limit, remedy=remedy)

    @cached_property
    def scale_stated(self) -> bool:
        """Whether the scale of every image has an uncertainty; otherwise the size is not corrected."""
        stated = [one.image.u_um_per_px for one in self.log.prints]
        return None not in (*stated, self.inspection.scale.u_um_per_px)

    @cached_property
    def taken(self) -> tuple[FloatArray, float, float, tuple[str, ...]]:
        """Return the corrections: deviation (n,) of the front, overgrowth in µm and size within it, and their names.

        Each is corrected as far as it is resolved, since means are damped towards the priors.
        """
        common = self.common if self.scale_stated else self._learnt(self.number, self.arc_mm, u_shrinkage_percent=EXACT)
        front = common.mean[: len(self.arc_mm)]
        grown, size = float(common.mean[OVERGROWTH]), float(common.mean[SIZE])
        words = ["overgrowth"] if abs(grown) > common.u[OVERGROWTH] else []
        words += ["size"] if self.scale_stated and abs(size) > common.u[SIZE] else []
        if self.inspection.mirrored is None:
            return 0.5 * (front + front[::-1]), grown, size, ("symmetric form", *words)
        return front, grown, size, ("form", *words)

    @cached_property
    def made(self) -> Compensation:
        """The drawing of the next print."""
        return self.model.drawn(self.drawing) if self.kept else self._against

    @cached_property
    def kept(self) -> bool:
        """Whether the corrected drawing is no better, in form or walls, than the previous one."""
        return not self._moved and self._corrected.rms_um >= self._unchanged.rms_um

    @cached_property
    def _moved(self) -> bool:
        """Return whether walls move by more than their uncertainty, which a registered deviation does not show."""
        return bool(abs(self._against.wall_um - self.drawing.wall_um) > self.common.u[OVERGROWTH])

    @cached_property
    def _unchanged(self) -> Residual:
        return self.residual(self.future(self.drawing))

    @cached_property
    def _corrected(self) -> Residual:
        return self.residual(self.future(self._against.drawing))

    @cached_property
    def _against(self) -> Compensation:
        """Return the drawing that cancels the common deviations."""
        front, grown, size, _ = self.taken
        along = self.inspection.nominal.nearest(self.model.target.points_mm).arc_mm
        start = replace(self.drawing, wall_um=-grown, scale=1.0 / (1.0 + size))
        return self.model.against(np.interp(along, self.arc_mm, front), start)

    @cached_property
    def draws(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Random states, individual forms of a further print, and factors of pixel effects."""
        return self.common.drawn(SAMPLES, np.random.default_rng(SEED))

    @cached_property
    def _registered(self) -> FloatArray:
        """Return the projection (n, n) that removes rotation and shift from deviations, as registration does."""
        rigid = self.contour.by_rigid(self.arc_mm) * self.measured_part[:, None]
        basis = self.contour.by_rigid(self.arc_mm) @ np.linalg.pinv(rigid)
        return np.asarray(np.eye(len(self.arc_mm)) - basis)

    @cached_property
    def measured_part(self) -> BoolArray:
        """Mask of points that are not corners."""
        return np.asarray((self.arc_mm > END_MM) & (self.arc_mm < self.contour.length_mm - END_MM))

    def future(self, drawing: Drawing) -> FloatArray:
        """Return the deviations (SAMPLES, n) of a further print of a drawing, registered."""
        states, alone, missed = self.draws
        effect, by_blur = (column[::EVERY] for column in self.model.effect(drawing))
        truth = states[:, : len(self.arc_mm)] + effect + np.outer(states[:, BLUR], by_blur) + alone
        if not self.model.is_designed(drawing):
            covariance = of_pixels(self.arc_mm, self.model.of_pixels_um[::EVERY])
            rng = np.random.default_rng(SEED + 1)
            pixels = rng.multivariate_normal(np.zeros(len(covariance)), covariance, SAMPLES, method="eigh")
            truth += missed[:, None] * pixels
        return np.asarray(truth @ self._registered.T)

    def residual(self, prints: FloatArray) -> Residual:
        """Return statistics of the root mean squares of prints."""
        rms = np.sqrt(np.mean(prints[:, self.measured_part] ** 2, axis=1))
        low, high = np.quantile(rms, [0.025, 0.975]).tolist()
        return Residual(float(rms.mean()), float(rms.std()), (low, high))

    def tuned(self, file: str, progress: Progress | None, *, response: bool) -> TunedPrint:
        """Return the result of the tuning."""
        made, inspection = self.made, self.inspection
        prints = self.future(made.drawing)
        predicted = self.residual(prints)
        traced, why = self._responses(prints, progress) if response else (None, [])
        log = self.log.with_print(self._entry(file, predicted, traced))
        warnings = [*of_image(inspection, self.model), *why, *inspection.warnings]
        warnings += of_prediction(log, self._corrected, self._unchanged, moved=self._moved)
        return TunedPrint(
            design=self.sensor.design.name,
            simulated=any(one.image.simulated for one in log.prints),
            process=self.model.process.name,
            number=len(log.prints),
            drawn_by=self.log.name(self.number),
            rms_um=inspection.deviation.rms_um,
            u_rms_um=inspection.deviation.u_rms_um,
            common=self._summary(),
            corrected=() if self.kept else self.taken[3],
            kept=self.kept,
            wall_um=made.wall_um,
            scale=made.scale,
            unchanged=self._unchanged,
            predicted=predicted,
            response=traced,
            history=_history(log),
            x_mm=self.model.target.points_mm[::EVERY, 0],
            measured_um=self._measured(),
            predicted_um=prints.mean(axis=0),
            u_predicted_um=prints.std(axis=0),
            sources=(*inspection.sources, *self.model.sources),
            warnings=tuple(dict.fromkeys(warnings)),
            made=made,
            profile=self._profile(prints.mean(axis=0), predicted.u_rms_um),
            log=log,
        )

    def _summary(self) -> Common:
        mean, u, n = self.common.mean, self.common.u, len(self.arc_mm)
        form = mean[:n] - mean[OVERGROWTH] - mean[SIZE] * 1e3 * self.contour.by_size(self.arc_mm)
        left = (self._registered @ form)[self.measured_part]
        return Common(
            overgrowth_um=float(mean[OVERGROWTH]),
            u_overgrowth_um=float(u[OVERGROWTH]),
            size_percent=100.0 * float(mean[SIZE]),
            u_size_percent=100.0 * float(u[SIZE]),
            form_um=float(np.sqrt(np.mean(left**2))),
            repeat_um=self.common.repeat_um,
            prints=len(self.log.prints) + 1,
        )

    def _measured(self) -> FloatArray:
        """Return the deviation of the image at the points, registered as in `solen print inspect`, or NaN."""
        fit, nominal = self.inspection.outline.chosen.registration, self.inspection.nominal
        at = nominal.nearest(fit.points_mm).arc_mm
        order = np.argsort(at)
        um = np.interp(self.arc_mm, at[order], fit.deviation_um[order], left=np.nan, right=np.nan)
        return np.asarray(um)

    def _profile(self, um: FloatArray, u_um: float) -> MeasuredProfile:
        """Return the profile of a lens with a deviation."""
        target = self.model.target
        along = self.inspection.nominal.nearest(target.points_mm).arc_mm
        deviation = Deviation(target, np.interp(along, self.arc_mm, um))
        return profile_of_print(deviation, self.sensor.design.name, self.model.process.name, u_um, self.model.sources)

    def _responses(self, prints: FloatArray, progress: Progress | None) -> tuple[Responses | None, list[Caution]]:
        """Return the responses before and after, or the reason why there are none."""
        designed = self.sensor.lens
        assert isinstance(designed, DesignedLens)  # noqa: S101  checked before
        try:
            seen = measured_lens(designed, self.inspection.profile())
            before = [seen, *(seen.with_outline(number) for number in range(1, DRAWS + 1))]
            outlines = [prints.mean(axis=0), *prints[:DRAWS]]
            after = [measured_lens(designed, self._profile(um, 0.0)) for um in outlines]
            return responses(self.sensor, before, after, progress), []
        except SolenError as bad:
            return None, [warning(f"no response: {bad}")]

    def _entry(self, file: str, predicted: Residual, traced: Responses | None) -> LoggedPrint:
        """Return the log entry of this print."""
        source, rows, made = self.inspection.sources[0], self.rows, self.made
        columns = (tuple(np.round(column, 5).tolist()) for column in (rows.arc_mm, rows.deviation_um, rows.u_um))
        scale = self.inspection.scale
        face = self.options.seen_from
        image = LoggedImage(
            source.file, source.sha256, source.simulated, scale.um_per_px, scale.u_um_per_px, face, *columns
        )
        number = len(self.log.prints) + 1
        sha256 = hashlib.sha256(outline_text(self.sensor, made).encode()).hexdigest()
        deviation = self.inspection.deviation
        correction = Correction.of(number, file, sha256, made.drawing)
        if self.kept:
            correction = self.log.correction(self.number) or Correction.of(0, AS_DESIGNED, sha256, made.drawing)
        return LoggedPrint(
            number, self.number, image, deviation.rms_um, deviation.u_rms_um, correction, predicted, traced
        )


def _history(log: TuningLog) -> tuple[TunedStep, ...]:
    return tuple(
        TunedStep(one.number, one.drawing, one.rms_um, one.u_rms_um, log.predicted_of(one.number)) for one in log.prints
    )
