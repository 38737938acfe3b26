"""Results in a folder are not overwritten by those of other options."""

from pathlib import Path

import pytest

from solen.errors import DataError, OutputError
from solen.explore import OptimiseOptions, SweepOptions, ToleranceOptions
from solen.explore.request import Request
from solen.files import write_all
from solen.pipeline.explore.optimise import optimise
from solen.pipeline.explore.sweep import sweep
from solen.pipeline.explore.tolerance import tolerance
from solen.spec import Design, save

DESIGN = Design(name="small", material={"index": 1.44}, motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 1.0})


def test_a_table_stays_where_another_sweep_names_its_folder(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    design, out = save(tmp_path / "small.toml", DESIGN), tmp_path / "out"
    options = SweepOptions(over=("lens.focus_mm=18,22",))
    first = sweep(design, out=out, options=options)
    table = first.files["table"].read_bytes()
    finer = SweepOptions(over=("lens.focus_mm=18,20,22",))
    for changed, set_, named in (
        (finer, None, ["--over", "18,22", "18,20,22"]),
        (options, ["material.index=1.45"], ["material.index", "1.44", "1.45"]),
        (SweepOptions(over=options.over, rays=512), None, ["--rays", "default", "512"]),
    ):
        with pytest.raises(OutputError) as refused:
            sweep(design, out=out, options=changed, set_=set_)
        assert all(word in str(refused.value) for word in [*named, "--out", "small-sweep.json"])
    assert first.files["table"].read_bytes() == table
    again = sweep(design, out=out, options=options)
    assert isinstance(again.result.to_dict(), dict)
    assert again.result.traced == 0
    assert again.result.to_dataset().identical(first.result.to_dataset())
    (out / "small-sweep.json").unlink()
    assert sweep(design, out=out, options=finer).result.traced == 1


def test_prints_and_designs_of_another_request_stay_too(tmp_path: Path) -> None:
    design = save(tmp_path / "small.toml", DESIGN)
    kept = ToleranceOptions(prints=32)
    write_all(Request(tmp_path / "small-prints.json", DESIGN, kept).content)
    Request(tmp_path / "small-prints.json", DESIGN, kept.model_copy(update={"print_number": 7})).check()
    with pytest.raises(OutputError, match=r"--seed is default there and 3 here"):
        tolerance(design, out=tmp_path, options=ToleranceOptions(prints=32, seed=3))
    write_all(Request(tmp_path / "small-optimise.json", DESIGN, OptimiseOptions(minimise=("span",))).content)
    with pytest.raises(OutputError, match="--minimise"):
        optimise(design, out=tmp_path, options=OptimiseOptions(minimise=("light",)))


def test_files_that_a_request_names_count_by_their_content(tmp_path: Path) -> None:
    rays = tmp_path / "rays.txt"
    design = DESIGN.set({"emitter.ray_file": "rays.txt"}).in_folder(tmp_path)
    process = tmp_path / "mine.toml"
    for path in (rays, process):
        path.write_text("1", encoding="utf-8")
    request = Request(tmp_path / "asked.json", design, ToleranceOptions(process=process))
    write_all(request.content)
    request.check()
    for path, named in ((rays, r"emitter\.ray_file"), (process, "process")):
        path.write_text("2", encoding="utf-8")
        with pytest.raises(OutputError, match=named):
            request.check()
        path.write_text("1", encoding="utf-8")
    request.path.write_text("{", encoding="utf-8")
    with pytest.raises(DataError, match=r"asked\.json"):
        request.check()
