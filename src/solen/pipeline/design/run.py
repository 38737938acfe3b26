"""The whole chain of a design: response, figures, tables and report in a folder."""

import json
from pathlib import Path

from solen import files
from solen.pipeline.design.deform import run_loaded
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import ProgressBar, Set
from solen.results import Outcome
from solen.sensor import DesignStudy, study
from solen.sensor.loaded import LoadedStudy


def run(
    file: Path, /, *, out: Path, set_: Set = None, progress: ProgressBar = None
) -> Outcome[DesignStudy | LoadedStudy]:
    """Simulate a design over its motion: lens, body, response with and without lens, figures, tables, report.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for report.html, results.json, results.csv and the figures; made if need be. Of a soft body under load
        there is no report, and a figure of its shape.
    """
    from solen.report.design import html
    from solen.report.design.table import csv_table

    design = open_design(file, set_)
    with files.output_folder(out):
        if design.motion.kind == "loaded":
            return run_loaded(design, out, progress)
        result = study(design, progress, practical=True)
        drawn = html.figures(result)
        texts = {f"{name}.svg": text for name, text in drawn.items()}
        texts["results.json"] = json.dumps(result.to_dict(), indent=1, allow_nan=False) + "\n"
        texts["results.csv"] = csv_table(result)
        texts["report.html"] = html.html(result, drawn)
        files.write_all({out / name: text.encode("utf-8") for name, text in texts.items()})
        for name in html.FIGURES:
            if name not in drawn:  # of an earlier design
                files.remove(out / f"{name}.svg")
    return Outcome(result, {"report": out / "report.html"})
