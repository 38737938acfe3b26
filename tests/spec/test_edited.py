"""A design file with values changed: comments and layout stay, and it reads back as the changed design."""

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
def test_values_are_changed_and_comments_stay(values: dict[str, Any]) -> None:
    text = template("solen-860")
    made = edited(text, values)
    assert loads(made) == with_values(loads(text), values)
    lines = set(made.splitlines())
    gone = [line for line in text.splitlines() if line not in lines]
    assert len(gone) <= len(values) + 1, "nothing else is touched"
    assert all(line.strip()[:1] in lines or not line.startswith("#") for line in gone), "no comment is lost"


def test_tables_and_lists_are_reached() -> None:
    made = edited(SHORT, {"wall[0].index": 1.41, "lens.focus_mm": 19.0, "material.index": 1.45})
    assert "index=1.45   # of batch 7" in made
    assert "index = 1.41" in made
    assert loads(made).lens.focus_mm == 19.0
    spline = f'{SHORT}\n[lens]\nshape = "spline"\nknots_um = [0.0, -5.0, 0.0]  # edge last\n'
    knots = edited(spline, {"lens.knots_um[1]": -7.5})
    assert "knots_um = [0.0, -7.5, 0.0]  # edge last" in knots


def test_what_is_no_design_is_refused() -> None:
    with pytest.raises(SpecError, match="focus_mm"):
        edited(SHORT, {"lens.focus_mm": -1.0})
    with pytest.raises(SpecError, match="nonsense"):
        edited(SHORT, {"lens.nonsense": 1.0})
