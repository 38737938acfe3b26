"""A fingertip sensor: the effect of its mount, and the conversion of a force to volts and back, as on a bench.

A damp finger presses a soft Y at the side of its stem. If the mount holds all of the arms, the stem dents and the light
stays; if it holds their ends, the body bends and the light moves. The second sensor is recorded on the simulated press
of `solen bench new`, with a load cell, and calibrated; its first cycle, which the calibration omits, is decoded.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from solen import Sensor
from solen.analysis import Study, study
from solen.analysis.calibration import Decoder, SensorCalibrations, calibrated_sensors
from solen.bench.record import record
from solen.bench.starter import starter_files
from solen.spec import loads, template

MOUNTS = {"all of the arms": "outer-*", "the ends of the arms": "receiver-*"}


def contrast(face: str) -> float:
    """Return the contrast of the shipped design at 0.3 N, with its mount on some faces."""
    sensor = Sensor.of(loads(template("press-860")).set({"hold[0].face": face, "motion.forces_N": (0.0, 0.3)}))
    return float(sensor.power((0.3,)).contrast[0])


def recorded() -> Study:
    """Run the shipped press and analyse the recording."""
    with TemporaryDirectory() as name:
        folder, texts = Path(name), starter_files()
        for file in ("press", "rig-press", "sensor-press"):
            (folder / f"{file}.toml").write_text(texts[file], encoding="utf-8")
        return study([record(folder / "press.toml", folder / "rig-press.toml", folder).path])


def held(found: Study, calibrations: SensorCalibrations) -> tuple[float, float, float]:
    """Return the decoded force of the first cycle's hold: its median and its 95 % band."""
    run = found.sensors["finger"].runs[0]
    sides = [run.signals.receivers.index(side) for side in ("left", "right")]
    volts = run.signals.volts[slice(*run.motion.holds[1])][:, sides]
    decoded = Decoder(calibrations.calibrations[0].calibration).decode(volts.mean(axis=0, keepdims=True))
    return float(decoded.angle_deg[0]), float(decoded.low_deg[0, 1]), float(decoded.high_deg[0, 1])


def main() -> tuple[dict[str, float], Study, SensorCalibrations, tuple[float, float, float]]:
    """Compare the mounts; record, calibrate and decode the better one."""
    contrasts = {name: contrast(face) for name, face in MOUNTS.items()}
    print(*(f"held by {name}: contrast {value:+.3f} at 0.3 N" for name, value in contrasts.items()), sep="\n")
    found = recorded()
    for side, one in found.sensors["finger"].receivers.items():
        print(f"recorded: {side} {one.sensitivity_V_per_deg:+.2f} V/N")
    print("\n".join((calibrations := calibrated_sensors(found)).calibrations[0].words))
    force, low, high = held(found, calibrations)
    print(f"pressed by 0.3 mm: {force:.4f} N ({low:.4f} to {high:.4f} N at 95 %, with the load cell's own error)")
    return contrasts, found, calibrations, (force, low, high)


if __name__ == "__main__":
    main()
