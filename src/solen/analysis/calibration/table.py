"""A calibration as a small table, with code in MicroPython and C that decodes readings with it on a board.

Between two nodes of the table the curve is straight in the plane of the two voltages. On each segment, the point
nearest to a reading, in units of the reading's covariance, has a closed form; the nearest segment gives the angle. This
is the median of `solen.analysis.calibration.decoder` without its bands. Rising and falling directions are merged into
one curve here, and their difference is added to the covariance. If two angles match a reading, only the more probable
angle is returned.

Public names: `BoardTable` and `DecodingTable`.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from scipy.stats import f as f_distribution

from solen.analysis.calibration.decoder import OUTSIDE, Decoder
from solen.analysis.calibration.estimate import Calibration, at_angles
from solen.arrays import FloatArray
from solen.ranks import Caution, warning
from solen.recording.stimulus import ANGLE, STIMULI, Name, Stimulus
from solen.results import Result, reported
from solen.spec.strict import Options

TRIED = 20
"""Number of positions on each segment at which the table is compared with the full decoder."""
MAX_DEVIATION = 0.5
"""Largest deviation from the full decoder that causes no warning, in standard uncertainties."""
_PYTHON = '''"""{plural} of a calibrated sensor: {name}. Written by solen {version}.

decode(left, right) returns the {what} in {unit}, its standard uncertainty, and whether the readings lie off the
calibrated curve, so that the {what} is meaningless. Supply readings as they were calibrated: {readings}.
"""

LIMIT = {limit:.6g}
# For each segment: {what} at its start and its length in {unit}; left and right at its start and their change;
# a, b and c, for which the covariance of (a dl, b dl + c dr) for a reading is the identity.
PIECES = (
{rows})


def decode(left, right):
    nearest, found = 1e30, (0.0, 0.0)
    for {what}, width, l0, r0, dl, dr, a, b, c in PIECES:
        x, y = a * (left - l0), b * (left - l0) + c * (right - r0)
        u, v = a * dl, b * dl + c * dr
        square = u * u + v * v
        along = min(max((x * u + y * v) / square, 0.0), 1.0)
        x, y = x - along * u, y - along * v
        far = x * x + y * y
        if far < nearest:
            nearest, found = far, ({what} + along * width, width / square**0.5)
    return found[0], found[1], nearest > LIMIT
'''
_C = """/* {plural} of a calibrated sensor: {name}. Written by solen {version}.
 *
 * solen_decode gives the {what} in {unit} and its standard uncertainty; it is false where the readings lie on no point
 * of the curve, so that the {what} means nothing. Readings are as they were calibrated: {readings}. */
#ifndef SOLEN_DECODE_H
#define SOLEN_DECODE_H

#include <math.h>
#include <stdbool.h>

/* Of each piece: {what} at its start and its length in {unit}; left and right at its start and their change; what
 * makes the covariance of a reading one: a, b, c in (a dl, b dl + c dr). On an AVR they stand in RAM. */
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
    """Segments of the curve, (n, 9), as in the generated code, and the squared distance that marks an outlier.

    Attributes
    ----------
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
        spread = np.stack(
            [np.interp(middle, calibration.angle_deg, total[:, i, j]) for i in (0, 1) for j in (0, 1)], axis=-1
        ).reshape(-1, 2, 2)
        white = np.linalg.inv(np.linalg.cholesky(spread))
        columns = (nodes[:-1], np.diff(nodes), curve[:-1], np.diff(curve, axis=0), white[:, 0, 0], white[:, 1])
        least = float(np.interp(middle, calibration.angle_deg, freedom).min())
        limit = 2.0 * float(f_distribution.isf(OUTSIDE, 2, min(least, 1e6)))
        return cls(np.column_stack(columns), limit, name, readings, version, stimulus)

    @cached_property
    def python(self) -> str:
        """Source code for MicroPython and Python."""
        return _PYTHON.format(rows=self._rows("    ({}),\n", ""), **self._named_values)

    @cached_property
    def c(self) -> str:
        """Source code in C99, as a header file."""
        return _C.format(rows=self._rows("    {{{}}},\n", "f"), count=len(self.pieces), **self._named_values)

    @property
    def _named_values(self) -> dict[str, Any]:
        texts = {"name": self.name, "readings": self.readings, "version": self.version}
        drive = {"what": self.stimulus.name, "plural": self.stimulus.plural.title(), "unit": self.stimulus.unit}
        return drive | {"limit": self.limit} | {key: re.sub(r"[^\w .,()+-]", "", text) for key, text in texts.items()}

    def _rows(self, row: str, suffix: str) -> str:
        return "".join(
            row.format(", ".join(f"{value:#.7g}{suffix}" for value in piece)) for piece in self.pieces.tolist()
        )

    def decode(self, volts: FloatArray) -> FloatArray:
        """Decode left and right voltages, (n, 2), into angles with the generated MicroPython code."""
        space: dict[str, Any] = {}
        exec(self.python, space)  # noqa: S102  what is written is what is tried
        return np.array([space["decode"](left, right)[0] for left, right in volts.tolist()])

    def off_deg(self, calibration: Calibration) -> tuple[float, float]:
        """Return the largest deviation from the full decoder along the curve, in degrees and in standard uncertainties."""
        nodes = np.append(self.pieces[:, 0], self.pieces[-1, 0] + self.pieces[-1, 1])
        angle = np.linspace(nodes[0], nodes[-1], TRIED * len(self.pieces) + 1)[TRIED:-TRIED]
        volts = at_angles(calibration.angle_deg, calibration.curves_V.mean(axis=0)[None], angle)[0]
        whole = Decoder(calibration).decode(volts)
        off = np.abs(self.decode(volts) - whole.angle_deg)
        spread = np.maximum(0.5 * (whole.high_deg[:, 0] - whole.low_deg[:, 0]), 1e-9)
        return float(off.max()), float((off / spread).max())


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
        off = f"{self.off_deg:.2g}{STIMULI[self.stimulus].sign}"
        return (warning(f"the table deviates by up to {off} from the full decoder; use more --points"),)
