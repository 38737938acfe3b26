"""Edits of a design file keep its comments and layout, and the file reads back as the changed design."""

from typing import Any

import pytest

from solen.errors import SpecError
from solen.spec import loads, template, with_values
from solen.spec.edited import edited

SHORT = """# mine
schema = 1
name = "short"
[material]
index=1.44   # of batch 7

[[wall]]  # a pad
face = "stem-right"
index = 1.40
outside = "skin"
"""


@pytest.mark.parametrize(
    "values",
    [
        {"lens.focus_mm": 25.0},
        {"material.resin": "pmma"},
        {"motion.pivot": [0.5, 2.0], "emitter.width_mm": 0.3, "motion.moves": ["lens"]},
        {"emitter.part": None, "trace.dimension": "2d", "readout.adc_range_v": [0.0, 5.0]},
        {"name": "another"},
    ],
)
def test_edits_keep_comments(values: dict[str, Any]) -> None:
    text = template("solen-860")
    result = edited(text, values)
    assert loads(result) == with_values(loads(text), values)
    lines = set(result.splitlines())
    changed = [line for line in text.splitlines() if line not in lines]
    assert len(changed) <= len(values) + 1
    assert not any(line.startswith("#") for line in changed), "no comment is lost"


def test_edits_entries_of_tables_and_lists() -> None:
    result = edited(SHORT, {"wall[0].index": 1.41, "lens.focus_mm": 19.0, "material.index": 1.45})
    assert "index=1.45   # of batch 7" in result
    assert "index = 1.41" in result
    assert loads(result).lens.focus_mm == 19.0
    spline = f'{SHORT}\n[lens]\nshape = "spline"\nknots_um = [0.0, -5.0, 0.0]  # edge last\n'
    knots = edited(spline, {"lens.knots_um[1]": -7.5})
    assert "knots_um = [0.0, -7.5, 0.0]  # edge last" in knots


def test_refuses_edits_to_an_invalid_design() -> None:
    with pytest.raises(SpecError, match="focus_mm"):
        edited(SHORT, {"lens.focus_mm": -1.0})
    with pytest.raises(SpecError, match="nonsense"):
        edited(SHORT, {"lens.nonsense": 1.0})
