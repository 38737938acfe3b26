"""The bench tab: running a real or simulated rig; responses, diagnoses and angles from recordings."""

from pathlib import Path

from solen.studio.page_commands import PageCommand

COMMANDS = (
    PageCommand(
        "bench analyse",
        "solen.pipeline.bench.analyse:analyse",
        "Response of sensors",
        files={"files": "Recordings"},
        outputs={"out": "analysis.json", "traces": "traces.svg"},
        first=("time", "angle", "channel"),
    ),
    PageCommand(
        "bench diagnose",
        "solen.pipeline.bench.diagnose:diagnose",
        "Diagnosis: decentre, chip, gains",
        files={"files": "Recordings"},
        outputs={"out": "diagnosis.json"},
        first=("design", "sensor"),
    ),
    PageCommand(
        "bench calibrate",
        "solen.pipeline.bench.calibrate:calibrate",
        "Calibration: from voltages to angles",
        files={"recordings": "Recordings"},
        outputs={"out": "calibration.json"},
        first=("sensor",),
    ),
    PageCommand(
        "bench decode",
        "solen.pipeline.bench.decode:decode",
        "Angles, live or from a recording",
        files={"source": "Recording, or journal of a run"},
        results={"calibration": "Calibration"},
        outputs={"out": "angles.csv"},
        first=("follow", "sensor"),
        live={"rows": "solen.studio.live:Angles"},
        hidden=("warn", "text", "send", "force"),
    ),
    PageCommand(
        "bench new",
        "solen.pipeline.bench.record:new",
        "Files of a simulated rig",
        outputs={"folder": ""},
    ),
    PageCommand(
        "bench run",
        "solen.pipeline.bench.record:run",
        "Run a rig, real or simulated",
        results={"protocol": "Protocol", "rig": "Rig"},
        outputs={"out": ""},
        first=("name", "seed", "real_time"),
        live={"watch": "solen.studio.live:Levels"},
        hidden=("report", "confirm"),
    ),
)


def suitable_commands(path: Path) -> tuple[str, ...]:
    """Return the commands that accept a file; TOML is a protocol or a rig, and a journal is an unfinished run."""
    if path.suffix == ".toml":
        return ("bench run",)
    return ("bench decode",) if path.suffix == ".journal" else ("bench analyse", "bench diagnose", "bench calibrate")
