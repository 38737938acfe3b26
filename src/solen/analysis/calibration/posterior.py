"""Reference implementation of decoding a single reading: the posterior probability of each angle on a uniform grid.

`Decoder` is tested against it. It is simple enough to be verified by reading, and does not approximate the curves by
straight lines.

Public name: `posterior`.
"""

import numpy as np

from solen.analysis.calibration.estimate import Calibration, at_angles
from solen.arrays import FloatArray


def posterior(calibration: Calibration, volts: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Return the probabilities (m,) of evenly spaced angles (m,), given a left and a right reading (2,).

    The prior is uniform, and the reading is equally likely to be from the rising and the falling curve.
    """
    grid = calibration.angle_deg
    curves = at_angles(grid, calibration.curves_V, angle_deg)
    grid_scale, grid_freedom = calibration.t_distribution()
    freedom = np.interp(angle_deg, grid, grid_freedom)
    log_likelihood = np.zeros((2, angle_deg.size))
    for direction, index in np.ndindex(log_likelihood.shape):
        angle = angle_deg[index]
        scale = np.array([[np.interp(angle, grid, grid_scale[:, i, j]) for j in range(2)] for i in range(2)])
        residual = volts - curves[direction, index]
        distance = residual @ np.linalg.solve(scale, residual)
        log_likelihood[direction, index] = -0.5 * np.log(np.linalg.det(scale))
        log_likelihood[direction, index] -= 0.5 * (freedom[index] + 2.0) * np.log1p(distance / freedom[index])
    likelihood = np.exp(log_likelihood - log_likelihood.max()).sum(axis=0)
    return np.asarray(likelihood / likelihood.sum())
