"""The whole chain of a design: response, figures, tables and report in a folder."""

import json
from collections.abc import Sequence
from pathlib import Path

from solen import files
from solen.arrays import Progress
from solen.pipeline.design.designs import open_design
from solen.results import Outcome
from solen.sensor import DesignStudy, study


def run(
    path: Path, out: Path, assignments: Sequence[str] | None = None, progress: Progress | None = None
) -> Outcome[DesignStudy]:
    """Trace a design over its motion with and without lens and beside neighbours; write its report into a folder."""
    from solen.report.design import html
    from solen.report.design.table import csv_table

    design = open_design(path, assignments)
    with files.output_folder(out):
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
