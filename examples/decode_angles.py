"""A calibration from a simulated recording with known angles, and its use on a recording of another day.

The voltages of both receivers together determine the angle, with a 95 % band, which is compared with the known angle.
"""

import numpy as np

from solen.analysis import study
from solen.analysis.calibration import CalibrationOptions, Decoder, SensorCalibrations, calibrated_sensors
from solen.recording import read
from solen.samples import FOLDER

SENSOR = "S1"


def main() -> tuple[SensorCalibrations, np.ndarray, np.ndarray]:
    """Return the calibration, and the decoded and known angles of the other day."""
    recordings = study([FOLDER / "rotation-simulated.csv"])
    calibrations = calibrated_sensors(recordings, CalibrationOptions(sensor=SENSOR))
    calibration = calibrations.calibrations[0].calibration
    table = read(FOLDER / "again-simulated.csv")
    columns = {channel.name: channel.values for channel in table.channels}
    volts = np.column_stack([columns[f"{SENSOR}.{side}"] for side in ("left", "right")])
    decoded, known = Decoder(calibration).decode(volts), columns["angle"]
    errors = decoded.angle_deg - known
    inside = (decoded.low_deg[:, 1] <= known) & (known <= decoded.high_deg[:, 1])
    print(calibrations.calibrations[0].words[0])
    print(f"RMS error of {known.size} decoded readings of another day: {np.sqrt(np.mean(errors**2)):.4f}°")
    print(f"{100 * inside.mean():.0f} % of the known angles are within the 95 % bands")
    return calibrations, decoded.angle_deg, known


if __name__ == "__main__":
    main()
