"""The table of a study: `results.csv`."""

import csv
import io
import math

from solen.sensor import DesignStudy, Response

PLAIN = ("right", "left", "contrast")


def csv_table(study: DesignStudy) -> str:
    """One row per angle: right, left and contrast of every case in the order of the header; powers with u."""
    columns: dict[str, Response] = {}
    for name, case in study.cases.items():
        columns |= {f"{name}_count": case.count} if case.count is not None else {}
        columns[f"{name}_power"] = case.power
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["angle_deg"]
        + [
            f"{name}_{what}"
            for name in columns
            for what in (*PLAIN, *(("u_power",) if name.endswith("_power") else ()))
        ]
    )
    for i, angle in enumerate(study.case.power.angle_deg):
        row = [repr(float(angle))]
        for response in columns.values():
            values = [
                getattr(response, what)[i] for what in (*PLAIN, *(("u_power",) if response.mode == "power" else ()))
            ]
            row += ["" if math.isnan(value) else repr(float(value)) for value in values]
        writer.writerow(row)
    return text.getvalue()
