"""The table of a study, `results.csv`, and similar tables of columns."""

import csv
import io
from collections.abc import Iterable

from solen.sensor import DesignStudy

PLAIN = ("right", "left", "contrast")


def csv_table(study: DesignStudy) -> str:
    """Return one row for each angle: right, left and contrast of every case in header order; powers with u."""
    columns = {"angle_deg": study.case.power.angle_deg}
    for name, case in study.cases.items():
        if case.count is not None:
            columns |= {f"{name}_count_{what}": getattr(case.count, what) for what in PLAIN}
        columns |= {f"{name}_power_{what}": getattr(case.power, what) for what in (*PLAIN, "u_power")}
    return csv_text(columns, zip(*columns.values(), strict=True))


def csv_text(heads: Iterable[str], rows: Iterable[Iterable[str | float]]) -> str:
    """Return a table as CSV with all digits; unknown numbers are left empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        cells = (one if isinstance(one, str) else float(one) for one in row)
        writer.writerow("" if cell != cell else cell if isinstance(cell, str) else repr(cell) for cell in cells)
    return text.getvalue()
