"""Double-polished silicon on a Cary 5000: the lossless index, the drift of its repeats, what as-published gives."""

from pathlib import Path
from typing import Any

import pytest

from solen.errors import DataError
from solen.material.index.options import IndexOptions
from solen.pipeline.resin import index as pipeline

REPEATS = tuple(f"VG05_1_{i}" for i in range(1, 6))


def index(file: Path, options: IndexOptions = IndexOptions(), **named: Any) -> dict[str, Any]:
    """The result as its JSON holds it."""
    return pipeline.index(file, options=options, **named).to_dict()


@pytest.fixture
def raw(outside: Path) -> Path:
    return outside / "cary" / "AO_bonding_paper" / "orig_20150206_cary5000.csv"


@pytest.fixture
def cleaned(outside: Path) -> Path:
    return outside / "cary" / "AO_bonding_paper" / "cln_20130218_cary5000.csv"


def at(found: dict[str, Any], nm: float) -> int:
    return int(found["wavelength_nm"].index(nm))


def test_the_lossless_index_drifts_over_the_repeats_and_that_is_reported(raw: Path) -> None:
    alone = [index(raw, IndexOptions(transmittance=[name])) for name in REPEATS]
    assert [round(one["n"][at(one, 1775.0)], 3) for one in alone] == [3.472, 3.469, 3.465, 3.464, 3.463]
    together = index(raw, IndexOptions(transmittance=REPEATS))
    assert together["mode"] == "lossless"
    assert together["repeats_lossless_n"] == pytest.approx([one["n"][at(one, 1775.0)] for one in alone])
    assert any("lossless n(1775 nm) of the 5 repeats, in order: 3.472 … 3.463" in w for w in together["warnings"])
    assert any("5 repeats of T drift in one direction" in line for line in together["warnings"])
    # the uncertainty is that of one repeat: it spans the drift and does not shrink with their number
    here = at(together, 1775.0)
    assert together["u_n"][here] > 0.003
    assert together["bandwidth_nm"] == 2.0


def test_the_cleaned_table_gives_the_known_index(cleaned: Path) -> None:
    found = index(cleaned, IndexOptions(transmittance=["VG05"], at_nm=(2400.0,), u_T="0.1%"))
    assert found["at"][0]["n"] == pytest.approx(3.461, abs=0.005)
    assert found["n"][at(found, 2400.0)] == found["at"][0]["n"]


def test_sixty_one_traces_are_not_chosen_from_by_guess(raw: Path) -> None:
    with pytest.raises(DataError, match=r"61 .*: Baseline 100%T, empty_1, .* and 41 more"):
        index(raw)


def test_as_published_it_is_refused_as_a_measurement(raw: Path, cleaned: Path) -> None:
    for file, trace, nm in ((raw, REPEATS[0], 1775.0), (cleaned, "VG05", 2400.0)):
        chosen = {"transmittance": [trace]}
        # never by itself, and not under the name of a measurement
        assert index(file, IndexOptions(thickness_um=500.0, **chosen))["mode"] == "lossless"
        with pytest.raises(DataError, match=r"a measured index; does not follow from T alone, .* n\(.* nm\) = 3\.[45]"):
            index(file, IndexOptions(thickness_um=500.0, **chosen, mode="measured"))
        found = index(file, IndexOptions(thickness_um=500.0, **chosen, mode="as-published"))
        assert not found["measurement"]
        assert "not valid as a measurement" in found["warnings"][0]
        here = at(found, nm)
        assert found["n"][here] == pytest.approx(2.197, abs=0.006)  # where silicon has 3.44
        assert found["u_n"][here] is None
        assert found["lossless_n"][here] > 3.4
