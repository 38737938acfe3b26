"""The table of a study, `results.csv`, and similar tables of columns."""

import csv
import io
import math
from collections.abc import Iterable

from solen.sensor import DesignStudy

PLAIN = ("right", "left", "contrast")


def csv_table(study: DesignStudy) -> str:
    """Return a CSV table of the powers and the contrast of every case, with a row for each angle."""
    columns = {"angle_deg": study.case.power.angle_deg}
    for name, case in study.cases.items():
        if case.count is not None:
            columns |= {f"{name}_count_{what}": getattr(case.count, what) for what in PLAIN}
        columns |= {f"{name}_power_{what}": getattr(case.power, what) for what in (*PLAIN, "u_power")}
    return csv_text(columns, zip(*columns.values(), strict=True))


def csv_text(heads: Iterable[str], rows: Iterable[Iterable[str | float]]) -> str:
    """Return a table as CSV with all digits; the cell of an unknown number is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow(map(_cell, row))
    return text.getvalue()


def _cell(value: str | float) -> str:
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else repr(float(value))
