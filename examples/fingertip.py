"""A fingertip sensor: the effect of its mount, and a calibration to newtons on a simulated bench.

A finger presses on the side of the stem of a soft Y. If the mount supports the entire arms, the stem is only indented
and the contrast does not change; if it supports their ends, the body bends and the contrast changes. The second sensor
is recorded on the simulated press of `solen bench new`, with a load cell, and calibrated; its first cycle is decoded.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from solen import Sensor
from solen.analysis import Study, study
from solen.analysis.calibration import Decoder, SensorCalibrations, calibrated_sensors
from solen.bench.record import record
from solen.bench.starter import starter_files
from solen.spec import loads, template

MOUNTS = {"along the arms": "outer-*", "at the ends of the arms": "receiver-*"}


def contrast(face: str) -> float:
    """Return the contrast of the shipped design at 0.3 N if some of its faces are supported."""
    sensor = Sensor.of(loads(template("press-860")).set({"hold[0].face": face, "motion.forces_N": (0.0, 0.3)}))
    return float(sensor.power((0.3,)).contrast[0])


def recorded() -> Study:
    """Run the shipped press and analyse the recording."""
    with TemporaryDirectory() as folder_name:
        folder, texts = Path(folder_name), starter_files()
        for name in ("press", "rig-press", "sensor-press"):
            (folder / f"{name}.toml").write_text(texts[name], encoding="utf-8")
        return study([record(folder / "press.toml", folder / "rig-press.toml", folder).path])


def hold_force(recording: Study, calibrations: SensorCalibrations) -> tuple[float, float, float]:
    """Return the force decoded while the finger is held in the first cycle, with its 95 % band."""
    run = recording.sensors["finger"].runs[0]
    sides = [run.signals.receivers.index(side) for side in ("left", "right")]
    volts = run.signals.volts[slice(*run.motion.holds[1])][:, sides]
    decoded = Decoder(calibrations.calibrations[0].calibration).decode(volts.mean(axis=0, keepdims=True))
    return float(decoded.angle_deg[0]), float(decoded.low_deg[0, 1]), float(decoded.high_deg[0, 1])


def main() -> tuple[dict[str, float], Study, SensorCalibrations, tuple[float, float, float]]:
    """Compare the mounts; record and calibrate the sensor with the better mount, and decode a force."""
    contrasts = {name: contrast(face) for name, face in MOUNTS.items()}
    print(*(f"supported {name}: contrast {value:+.3f} at 0.3 N" for name, value in contrasts.items()), sep="\n")
    recording = recorded()
    for side, receiver in recording.sensors["finger"].receivers.items():
        print(f"recorded: {side} {receiver.sensitivity_V_per_deg:+.2f} V/N")
    print("\n".join((calibrations := calibrated_sensors(recording)).calibrations[0].words))
    force, low, high = hold_force(recording, calibrations)
    print(f"pressed by 0.3 mm: {force:.4f} N (95 %: {low:.4f} to {high:.4f} N, including the error of the load cell)")
    return contrasts, recording, calibrations, (force, low, high)


if __name__ == "__main__":
    main()
