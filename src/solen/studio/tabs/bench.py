"""The bench tab: runs a real or simulated rig and converts recordings into responses, diagnoses and angles."""

from pathlib import Path

from solen.studio.offers import Offer

OFFERS = (
    Offer(
        "bench analyse",
        "solen.pipeline.bench.analyse:analyse",
        "Response of sensors",
        files={"files": "Recordings"},
        written={"out": "analysis.json", "traces": "traces.svg"},
        first=("time", "angle", "channel"),
    ),
    Offer(
        "bench diagnose",
        "solen.pipeline.bench.diagnose:diagnose",
        "Diagnosis: decentre, chip, gains",
        files={"files": "Recordings"},
        written={"out": "diagnosis.json"},
        first=("design", "sensor"),
    ),
    Offer(
        "bench calibrate",
        "solen.pipeline.bench.calibrate:calibrate",
        "Calibration: from volts to angles",
        files={"recordings": "Recordings"},
        written={"out": "calibration.json"},
        first=("sensor",),
    ),
    Offer(
        "bench decode",
        "solen.pipeline.bench.decode:decode",
        "Angles, live or from a recording",
        files={"source": "Recording, or journal of a run"},
        results={"calibration": "Calibration"},
        written={"out": "angles.csv"},
        first=("follow", "sensor"),
        live={"rows": "solen.studio.live:Angles"},
        hidden=("warn", "text", "send", "force"),
    ),
    Offer(
        "bench new",
        "solen.pipeline.bench.record:new",
        "Files of a simulated rig",
        written={"folder": ""},
    ),
    Offer(
        "bench run",
        "solen.pipeline.bench.record:run",
        "Run a rig, real or simulated",
        results={"protocol": "Protocol", "rig": "Rig"},
        written={"out": ""},
        first=("name", "seed", "real_time"),
        live={"watch": "solen.studio.live:Levels"},
        hidden=("report", "confirm"),
    ),
)


def commands_for(path: Path) -> tuple[str, ...]:
    """Return the commands that accept a file: TOML is a protocol or a rig, a journal is an unfinished run."""
    if path.suffix == ".toml":
        return ("bench run",)
    return ("bench decode",) if path.suffix == ".journal" else ("bench analyse", "bench diagnose", "bench calibrate")
