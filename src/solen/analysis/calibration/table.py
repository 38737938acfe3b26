"""A calibration as a small table, with code in MicroPython and C that decodes readings with it on a board.

Between two nodes of the table the curve is straight in the plane of the two voltages. On each segment, the point
nearest to a reading, in units of the reading's covariance, has a closed form; the nearest segment gives the angle. It
approximates the median of `solen.analysis.calibration.decoder`, without bands. Rising and falling curves are averaged,
and their deviation from the average is added to the covariance. If two angles match a reading, only the nearer one is
returned.

Public names: `BoardTable` and `DecodingTable`.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from scipy.stats import f as f_distribution

from solen.analysis.calibration.decoder import MIN_TAIL_PROBABILITY, Decoder
from solen.analysis.calibration.estimate import Calibration, at_angles
from solen.arrays import FloatArray
from solen.ranks import Caution, warning
from solen.recording.stimulus import ANGLE, STIMULI, Name, Stimulus
from solen.results import Result, reported
from solen.spec.strict import Options

CHECKED_POINTS = 20
"""Number of positions on each segment at which the table is compared with the full decoder."""
MAX_DEVIATION = 0.5
"""Largest deviation from the full decoder that causes no warning, in standard uncertainties."""
_PYTHON = '''"""{plural} of a calibrated sensor: {name}. Written by solen {version}.

decode(left, right) returns the {what} in {unit}, its standard uncertainty, and whether the readings are off the
calibrated curve, so that the {what} is meaningless. Readings must be as in the calibration: {readings}.
"""

LIMIT = {limit:.6g}
# For each segment: {what} at its start and its length in {unit}; left and right at its start and their change;
# a, b and c, for which the covariance of (a dl, b dl + c dr) for a reading is the identity.
PIECES = (
{rows})


def decode(left, right):
    nearest, result = 1e30, (0.0, 0.0)
    for {what}, width, l0, r0, dl, dr, a, b, c in PIECES:
        x, y = a * (left - l0), b * (left - l0) + c * (right - r0)
        u, v = a * dl, b * dl + c * dr
        square = u * u + v * v
        along = min(max((x * u + y * v) / square, 0.0), 1.0)
        x, y = x - along * u, y - along * v
        distance = x * x + y * y
        if distance < nearest:
            nearest, result = distance, ({what} + along * width, width / square**0.5)
    return result[0], result[1], nearest > LIMIT
'''
_C = """/* {plural} of a calibrated sensor: {name}. Written by solen {version}.
 *
 * solen_decode sets the {what} in {unit} and its standard uncertainty. It returns false if the readings are off the
 * calibrated curve, so that the {what} is meaningless. Readings must be as in the calibration: {readings}. */
#ifndef SOLEN_DECODE_H
#define SOLEN_DECODE_H

#include <math.h>
#include <stdbool.h>

/* For each segment: {what} at its start and its length in {unit}; left and right at its start and their change;
 * a, b and c, for which the covariance of (a dl, b dl + c dr) for a reading is the identity. On an AVR the table is
 * in RAM. */
static const float solen_pieces[{count}][9] = {{
{rows}}};

static inline bool solen_decode(float left, float right, float *{what}_{unit}, float *u_{unit}) {{
    float nearest = 1e30f;
    for (int number = 0; number < {count}; number++) {{
        const float *p = solen_pieces[number];
        float x = p[6] * (left - p[2]), y = p[7] * (left - p[2]) + p[8] * (right - p[3]);
        float u = p[6] * p[4], v = p[7] * p[4] + p[8] * p[5];
        float square = u * u + v * v, along = (x * u + y * v) / square;
        along = along < 0 ? 0 : along > 1 ? 1 : along;
        x -= along * u;
        y -= along * v;
        if (x * x + y * y < nearest) {{
            nearest = x * x + y * y;
            *{what}_{unit} = p[0] + along * p[1];
            *u_{unit} = p[1] / sqrtf(square);
        }}
    }}
    return nearest <= {limit:.6g}f;
}}

#endif
"""


class TableOptions(Options):
    """Table size."""

    points: Annotated[int, Field(ge=5, le=257)] = 33
    """Number of table nodes, evenly spaced in angle."""


@dataclass(frozen=True, eq=False)
class BoardTable:
    """Table for decoding on a board.

    Attributes
    ----------
    pieces
        Segments of the curve, (n, 9), as in the generated code.
    limit
        Squared distance from the curve above which readings are off the curve.
    name, readings, version, stimulus
        Sensor, receiver readings, solen version and decoded quantity, as written in the generated source files.
    """

    pieces: FloatArray
    limit: float
    name: str
    readings: str
    version: str
    stimulus: Stimulus = ANGLE

    @classmethod
    def of(
        cls,
        calibration: Calibration,
        points: int,
        *,
        name: str,
        readings: str,
        version: str,
        stimulus: Stimulus = ANGLE,
    ) -> "BoardTable":
        """Compute the table for a calibration."""
        total, freedom = calibration.t_distribution()
        half = 0.5 * (calibration.curves_V[1] - calibration.curves_V[0])
        total = total + half[:, :, None] * half[:, None, :]
        nodes = np.linspace(calibration.angle_deg[0], calibration.angle_deg[-1], points)
        curve = at_angles(calibration.angle_deg, calibration.curves_V.mean(axis=0)[None], nodes)[0]
        middle = 0.5 * (nodes[1:] + nodes[:-1])
        covariance = np.stack(
            [np.interp(middle, calibration.angle_deg, total[:, i, j]) for i in (0, 1) for j in (0, 1)], axis=-1
        ).reshape(-1, 2, 2)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        columns = (nodes[:-1], np.diff(nodes), curve[:-1], np.diff(curve, axis=0), whiten[:, 0, 0], whiten[:, 1])
        min_freedom = float(np.interp(middle, calibration.angle_deg, freedom).min())
        limit = 2.0 * float(f_distribution.isf(MIN_TAIL_PROBABILITY, 2, min(min_freedom, 1e6)))
        return cls(np.column_stack(columns), limit, name, readings, version, stimulus)

    @cached_property
    def python(self) -> str:
        """Source code for MicroPython and Python."""
        return _PYTHON.format(rows=self._rows("    ({}),\n", ""), **self._fields)

    @cached_property
    def c(self) -> str:
        """Source code in C99, as a header file."""
        return _C.format(rows=self._rows("    {{{}}},\n", "f"), count=len(self.pieces), **self._fields)

    @property
    def _fields(self) -> dict[str, Any]:
        """Values of the fields of both templates; characters that could end a comment are removed."""
        texts = {"name": self.name, "readings": self.readings, "version": self.version}
        decoded = {"what": self.stimulus.name, "plural": self.stimulus.plural.title(), "unit": self.stimulus.unit}
        return decoded | {"limit": self.limit} | {key: re.sub(r"[^\w .,()+-]", "", text) for key, text in texts.items()}

    def _rows(self, row: str, suffix: str) -> str:
        return "".join(
            row.format(", ".join(f"{value:#.7g}{suffix}" for value in piece)) for piece in self.pieces.tolist()
        )

    def decode(self, volts: FloatArray) -> FloatArray:
        """Decode left and right voltages, (n, 2), into angles with the generated MicroPython code."""
        namespace: dict[str, Any] = {}
        exec(self.python, namespace)  # noqa: S102  the generated code itself
        return np.array([namespace["decode"](left, right)[0] for left, right in volts.tolist()])

    def deviation(self, calibration: Calibration) -> tuple[float, float]:
        """Return the largest deviation from the full decoder on the curve, in degrees and standard uncertainties."""
        last = self.pieces[-1]
        count = CHECKED_POINTS * len(self.pieces) + 1
        angle = np.linspace(self.pieces[0, 0], last[0] + last[1], count)[CHECKED_POINTS:-CHECKED_POINTS]
        volts = at_angles(calibration.angle_deg, calibration.curves_V.mean(axis=0)[None], angle)[0]
        decoded = Decoder(calibration).decode(volts)
        deviation = np.abs(self.decode(volts) - decoded.angle_deg)
        u = np.maximum(0.5 * (decoded.high_deg[:, 0] - decoded.low_deg[:, 0]), 1e-9)
        return float(deviation.max()), float((deviation / u).max())


class DecodingTable(Result):
    """Summary of a decoding table.

    Attributes
    ----------
    sensor
        Name of the calibrated sensor.
    pieces
        Number of straight segments in the table.
    low_deg, high_deg
        Range of the table.
    off_deg
        Largest deviation from the full decoder along the curve.
    sigma
        The same deviation in standard uncertainties of an angle.
    simulated
        Whether the calibration is based on simulated recordings.
    stimulus
        Decoded quantity: ``angle``, ``force`` or ``depth``. Keys end in its unit.
    """

    sensor: str
    pieces: int
    low_deg: float
    high_deg: float
    off_deg: float
    sigma: float
    simulated: bool
    stimulus: Name = "angle"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; keys end in the unit of the decoded quantity."""
        return STIMULI[self.stimulus].keyed(super().to_dict())

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warning if the table is too coarse."""
        if self.sigma <= MAX_DEVIATION:
            return ()
        deviation = f"{self.off_deg:.2g}{STIMULI[self.stimulus].sign}"
        return (warning(f"the table deviates by up to {deviation} from the full decoder; use more --points"),)
