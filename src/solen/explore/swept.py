"""The result of a sweep: responses and figures of merit of a design over values of its keys, and their table.

Public name: `Sweep`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

import solen
from solen.arrays import FloatArray
from solen.results import HIDDEN, Result, reported


class Sweep(Result):
    """Responses of a design over values of its keys: P points with A angles each.

    Attributes
    ----------
    name
        Name of the design.
    values
        The P values of each key; in a grid, the last key varies fastest.
    shape
        Number of values of each key of a grid; for samples or a part, only P.
    seed
        Seed of the samples; None for a grid.
    part
        Part of the points, such as 3/10; None for all.
    first
        Index of the first point of the part among all points.
    merits
        P values of each merit (`Merits`), keyed by name, and their uncertainties with the prefix ``u_``. With
        deviations, also the worst values over them, with the prefix ``worst_``.
    failures
        Reasons why points have no response, with their counts; reasons that differ only in numbers are counted
        together.
    traced
        Number of responses that were traced rather than read from the store; designs without a response do not count.
    robust
        Deviations with which each point was also traced.
    angle_deg, power, u_power
        Angles (A,) and powers (P, A, 2) at the right and the left receiver; for a network, the angles (A, M) of M
        motions in A states and the powers (P, A, C) of C channels: all receivers for the first emitter, then for the
        next. NaN for a point without a response.
    labels
        For a network, the names of its motions, emitters and receivers.
    design
        The design before its values are set, as TOML.
    """

    name: str
    values: Mapping[str, Sequence[Any]]
    shape: tuple[int, ...]
    seed: int | None
    merits: Mapping[str, FloatArray]
    failures: Mapping[str, int]
    traced: int
    robust: tuple[dict[str, float], ...]
    warnings: tuple[str, ...]
    angle_deg: FloatArray = field(metadata=HIDDEN)
    power: FloatArray = field(metadata=HIDDEN)
    u_power: FloatArray = field(metadata=HIDDEN)
    design: str = field(metadata=HIDDEN)
    part: str | None = None
    first: int = 0
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict, metadata=HIDDEN)
    simulated: bool = True

    @property
    def contrast(self) -> FloatArray:
        """Contrast (P, A) of two receivers."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.power[..., 0] - self.power[..., 1]) / self.power.sum(axis=-1))

    @reported
    def points(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape))

    @property
    def is_grid(self) -> bool:
        """Whether the points are a grid of all values rather than samples."""
        return self.seed is None and self.part is None

    @property
    def axes(self) -> dict[str, list[Any]]:
        """The distinct values of each key of a grid."""
        return {key: list(dict.fromkeys(values)) for key, values in self.values.items()}

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return variables, coordinates and attributes of a dataset; its dimensions are the keys, or ``sample``."""
        names = tuple(self.values) if self.is_grid else ("sample",)
        indices = {} if self.part is None else {"sample": np.arange(self.first, self.first + self.points)}
        values = (
            {key: (key, distinct) for key, distinct in self.axes.items()}
            if self.is_grid
            else {key: ("sample", list(column)) for key, column in self.values.items()}
        )
        coordinates: dict[str, Any] = {**values, **indices}
        variables: dict[str, Any] = {name: (names, merit.reshape(self.shape)) for name, merit in self.merits.items()}
        if self.labels:
            coordinates |= {name: (name, list(labels)) for name, labels in self.labels.items()}
            coordinates["angle_deg"] = (("state", "motion"), self.angle_deg)
            channels = [len(self.labels[name]) for name in ("emitter", "receiver")]
            for name in ("power", "u_power"):
                curve = getattr(self, name).reshape(*self.shape, -1, *channels)
                variables[name] = ((*names, "state", "emitter", "receiver"), curve)
        else:
            coordinates["angle_deg"] = ("angle_deg", self.angle_deg)
            for name, curve in self._curves().items():
                variables[name] = ((*names, "angle_deg"), curve.reshape(*self.shape, -1))
        attributes = {
            "title": f"Sweep of {self.name}",
            "comment": "Simulated, not measured. Powers are fractions of the emitted power.",
            "source": f"solen {solen.__version__}",
            "design": self.design,
            "simulated": 1,
        }
        return variables, coordinates, attributes

    def _curves(self) -> dict[str, FloatArray]:
        """Return the responses (P, A) of two receivers."""
        u_power = self.u_power.max(axis=-1)
        with np.errstate(invalid="ignore"):
            u_contrast = 2.0 * u_power / self.power.sum(axis=-1)
        right, left = np.moveaxis(self.power, -1, 0)
        return {"right": right, "left": left, "u_power": u_power, "contrast": self.contrast, "u_contrast": u_contrast}
