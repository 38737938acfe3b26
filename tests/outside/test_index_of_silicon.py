"""Double-polished silicon in a Cary 5000: the lossless index, the drift of repeats, and the published evaluation."""

from pathlib import Path
from typing import Any

import pytest

from solen.errors import DataError
from solen.material.index.options import IndexOptions
from solen.pipeline.resin import index as pipeline

REPEATS = tuple(f"VG05_1_{i}" for i in range(1, 6))


def index(file: Path, options: IndexOptions = IndexOptions(), **arguments: Any) -> dict[str, Any]:
    """Return the result as in its JSON."""
    return pipeline.index(file, options=options, **arguments).to_dict()


@pytest.fixture
def raw(outside: Path) -> Path:
    return outside / "cary" / "AO_bonding_paper" / "orig_20150206_cary5000.csv"


@pytest.fixture
def cleaned(outside: Path) -> Path:
    return outside / "cary" / "AO_bonding_paper" / "cln_20130218_cary5000.csv"


def index_at(result: dict[str, Any], nm: float) -> int:
    return int(result["wavelength_nm"].index(nm))


def test_reports_drift_of_lossless_index_over_repeats(raw: Path) -> None:
    separate = [index(raw, IndexOptions(transmittance=[name])) for name in REPEATS]
    indices = [result["n"][index_at(result, 1775.0)] for result in separate]
    assert indices == pytest.approx([3.472, 3.469, 3.465, 3.464, 3.463], abs=5e-4)
    together = index(raw, IndexOptions(transmittance=REPEATS))
    assert together["mode"] == "lossless"
    assert together["repeats_lossless_n"] == pytest.approx(indices)
    (warning,) = [text for text in together["warnings"] if "n(1775 nm) of the 5 repeat measurements" in text]
    assert "3.472 … 3.463" in warning
    assert any("5 repeat measurements of T drift in one direction" in warning for warning in together["warnings"])
    # the uncertainty is that of one repeat: it covers the drift, and does not decrease with the number of repeats
    position = index_at(together, 1775.0)
    assert together["u_n"][position] > 0.003
    assert together["bandwidth_nm"] == 2.0


def test_cleaned_table_gives_known_index(cleaned: Path) -> None:
    result = index(cleaned, IndexOptions(transmittance=["VG05"], at_nm=(2400.0,), u_T="0.1%"))
    assert result["at"][0]["n"] == pytest.approx(3.461, abs=0.005)
    assert result["n"][index_at(result, 2400.0)] == result["at"][0]["n"]


def test_refuses_to_choose_among_sixty_one_traces(raw: Path) -> None:
    with pytest.raises(DataError, match=r"61 .*: Baseline 100%T, empty_1, .* and 41 more"):
        index(raw)


def test_refuses_published_evaluation_as_measurement(raw: Path, cleaned: Path) -> None:
    for file, trace, nm in ((raw, REPEATS[0], 1775.0), (cleaned, "VG05", 2400.0)):
        selection = {"transmittance": [trace]}
        # never by default, and not in the mode of a measurement
        assert index(file, IndexOptions(thickness_um=500.0, **selection))["mode"] == "lossless"
        with pytest.raises(DataError, match=r"a measured index; does not follow from T alone, .* n\(.* nm\) = 3\.[45]"):
            index(file, IndexOptions(thickness_um=500.0, **selection, mode="measured"))
        result = index(file, IndexOptions(thickness_um=500.0, **selection, mode="as-published"))
        assert not result["measurement"]
        assert "not valid as a measurement" in result["warnings"][0]
        position = index_at(result, nm)
        assert result["n"][position] == pytest.approx(2.197, abs=0.006)  # where silicon has 3.44
        assert result["u_n"][position] is None
        assert result["lossless_n"][position] > 3.4
