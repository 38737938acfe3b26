"""Lens profiles are read as they were written, and invalid ones are rejected in one line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError
from solen.lens import MeasuredProfile, OvalLens, profile_of, profile_text, read_profile
from solen.lens.profile import scatter_mm

LENS = OvalLens(1.0, 20.0, 2.0, 1.44)
X = np.linspace(-2.0, 2.0, 201)
Z = LENS.z_mm(X)

Change = Callable[[dict[str, Any]], object]


def profile_data() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(profile_text(profile_of(X, Z, 0.0005, name="print 3", simulated=True)))
    return content


def write_file(folder: Path, text: str, name: str = "lens.json") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_profile_is_read_as_it_was_written(tmp_path: Path) -> None:
    source = {"file": "photo.png", "sha256": "0" * 64, "metadata": {"um per px": "2"}}
    z = Z + 1e-9 * np.sin(1e5 * X)
    profile = MeasuredProfile(X, z, np.full_like(X, 1e-4), False, "print 3", "top", (source,), ("no scale check",))
    again = read_profile(write_file(tmp_path, profile_text(profile)))
    for key in ("x_mm", "z_mm", "u_mm"):
        assert np.array_equal(getattr(profile, key), getattr(again, key))
    assert (again.simulated, again.name, again.edge) == (False, "print 3", "top")
    assert again.sources == (source,)
    assert again.warnings == ("no scale check",)


def test_a_table_in_micrometres_is_the_same_profile(tmp_path: Path) -> None:
    rows = "\n".join(f"{1e3 * x:.6f};{1e3 * z:.6f};0.5" for x, z in zip(X, Z, strict=True))
    profile = read_profile(write_file(tmp_path, f"# simulated\nx (um);z (um);u (um)\n{rows}\n", "lens.csv"))
    assert np.abs(profile.z_mm - Z).max() < 1e-9  # six digits of a micrometre
    assert profile.u_mm[0] == pytest.approx(0.0005)
    assert profile.simulated
    assert profile.sources[0]["file"] == "lens.csv"


def test_a_table_from_right_to_left_is_reversed(tmp_path: Path) -> None:
    rows = "\n".join(f"{x:.9f},{z:.9f}" for x, z in zip(X[::-1], Z[::-1], strict=True))
    profile = read_profile(write_file(tmp_path, f"x_mm,z_mm\n{rows}\n", "lens.csv"))
    assert np.all(np.diff(profile.x_mm) > 0.0)


def test_the_scatter_of_the_points_replaces_a_missing_uncertainty() -> None:
    x = np.linspace(-2.0, 2.0, 2001)
    slope = LENS.slope(x)
    noise = np.random.default_rng(1).normal(0.0, 0.0005, x.size)
    profile = profile_of(x, LENS.z_mm(x) + noise * np.hypot(1.0, slope))
    # the median of 2000 numbers with common neighbours has an error of 4 %; the shape of the lens adds less
    assert profile.u_mm[0] == pytest.approx(0.0005, rel=0.12)
    assert "specifies no uncertainty" in profile.warnings[0]
    assert scatter_mm(x, LENS.z_mm(x)) < 1e-6


def test_a_profile_is_immutable() -> None:
    with pytest.raises(ValueError, match="read-only"):
        profile_of(X, Z, 0.0).x_mm[0] = 1.0


REFUSED: list[tuple[Change, str]] = [
    (lambda d: d.pop("solen"), "not a lens profile"),
    (lambda d: d.update(solen="scene"), "not a lens profile"),
    (lambda d: d.update(schema=2), "schema = 2; this version of solen reads 1"),
    (lambda d: d.update(colour="red"), "colour; unknown key"),
    (lambda d: d.pop("u_mm"), "u_mm; is missing"),
    (lambda d: d.pop("simulated"), "simulated; is missing"),
    (lambda d: d.update(simulated="yes"), "simulated = 'yes'; input should be a valid boolean"),
    (lambda d: d.update(edge="left"), "edge = 'left'; must be one of top, bottom, mean, predicted"),
    (lambda d: d.update(name=3), "name = 3; input should be a valid string"),
    (lambda d: d.update(x_mm="wide"), "x_mm = 'wide'"),
    (lambda d: d["z_mm"].__setitem__(5, "a"), "z_mm"),
    (lambda d: d["z_mm"].__setitem__(5, None), "z_mm"),
    (lambda d: d["x_mm"].pop(), "length of z_mm = 201; must be that of x_mm, 200"),
    (lambda d: d["u_mm"].pop(), "length of u_mm = 200; must be that of x_mm, 201"),
    (lambda d: d["u_mm"].__setitem__(7, -1e-4), "u_mm[7] = -0.0001; must be 0 to 1 mm"),
    (lambda d: d["x_mm"].__setitem__(7, d["x_mm"][5]), "x_mm[7] = -1.9; must be above the preceding -1.88"),
    (lambda d: d["x_mm"].reverse(), "x_mm = '2 to -2'; must be in ascending order"),
    (
        lambda d: d.update({k: d[k][:15] for k in ("x_mm", "z_mm", "u_mm")}),
        "points = 15; must be 16 to 100,000",
    ),
    (lambda d: d.update(x_mm=[1e3 * x for x in d["x_mm"]]), "width of the profile = 4000.0; must be 0.02 to 200 mm"),
    (lambda d: d.update(x_mm=[1e-3 * x for x in d["x_mm"]]), "width of the profile = 0.004; must be 0.02 to 200 mm"),
    (
        lambda d: d.update(z_mm=[1e3 * z for z in d["z_mm"]]),
        "of the profile = 1810.85214; must be at most 200 mm",
    ),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_refuses_an_invalid_file_in_one_line(tmp_path: Path, change: Change, message: str) -> None:
    content = profile_data()
    change(content)
    path = write_file(tmp_path, json.dumps(content))
    with pytest.raises(DataError) as refusal:
        read_profile(path)
    line = str(refusal.value)
    assert message in line
    assert line.startswith(str(path))
    assert "\n" not in line


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("{", "not valid JSON"),
        ("[1, 2]", "not a lens profile"),
        ('{"solen": "lens profile", "schema": 1, "x_mm": [NaN]}', "NaN is not a valid JSON number"),
        ("x_mm,y_mm\n1,2\n3,4\n", "has no column z or z_mm"),
        ("x,z\n" + "\n".join(f"{x},{x}" for x in range(20)), "cannot be converted to mm"),
        ("x_mm,z_mm\n" + "\n".join(f"{x},{'' if x == 7 else x}" for x in range(20)), "z_mm[7] = nan"),
        ("x_mm,z_mm\n" + "\n".join(f"{abs(x)},{x}" for x in range(-10, 10)), "must be above the preceding"),
    ],
)
def test_refuses_other_text_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = write_file(tmp_path, text, "lens.csv")
    with pytest.raises(DataError) as refusal:
        read_profile(path)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_refuses_a_missing_file(tmp_path: Path) -> None:
    for name in ("lens.json", "lens.csv"):
        with pytest.raises(DataError, match="no such file"):
            read_profile(tmp_path / name)
