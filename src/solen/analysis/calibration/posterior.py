"""Reference for decoding a single reading: the likelihood on a uniform grid of angles.

`Decoder` must agree with this reference, which is short enough to be checked by reading and does not approximate the
curves by straight lines.

Public name: `posterior`.
"""

import numpy as np

from solen.analysis.calibration.estimate import Calibration, at_angles
from solen.arrays import FloatArray


def posterior(calibration: Calibration, volts: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Return the probability of each evenly spaced angle (m,) in the calibrated range for a left and right reading (2,)."""
    grid = calibration.angle_deg
    curves = at_angles(grid, calibration.curves_V, angle_deg)
    scale, known = calibration.t_distribution()
    freedom = np.interp(angle_deg, grid, known)
    likelihood = np.zeros(angle_deg.size)
    logs = []
    for curve in curves:
        row = np.zeros(angle_deg.size)
        for place, angle in enumerate(angle_deg):
            covariance = np.array([[np.interp(angle, grid, scale[:, i, j]) for j in range(2)] for i in range(2)])
            rest = volts - curve[place]
            distance = rest @ np.linalg.solve(covariance, rest)
            row[place] = -0.5 * np.log(np.linalg.det(covariance))
            row[place] -= 0.5 * (freedom[place] + 2.0) * np.log1p(distance / freedom[place])
        logs.append(row)
    highest = max(row.max() for row in logs)
    for row in logs:
        likelihood += np.exp(row - highest)
    return np.asarray(likelihood / likelihood.sum())
