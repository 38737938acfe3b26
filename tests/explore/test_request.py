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


def test_refuses_folder_with_results_of_other_sweep(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    design, out = save(tmp_path / "small.toml", DESIGN), tmp_path / "out"
    options = SweepOptions(over=("lens.focus_mm=18,22",))
    first = sweep(design, out=out, options=options)
    table = first.files["table"].read_bytes()
    finer = SweepOptions(over=("lens.focus_mm=18,20,22",))
    for changed, set_, words in (
        (finer, None, ["--over", "18,22", "18,20,22"]),
        (options, ["material.index=1.45"], ["material.index", "1.44", "1.45"]),
        (SweepOptions(over=options.over, rays=512), None, ["--rays", "default", "512"]),
    ):
        with pytest.raises(OutputError) as error:
            sweep(design, out=out, options=changed, set_=set_)
        assert all(word in str(error.value) for word in [*words, "--out", "small-sweep.json"])
    assert first.files["table"].read_bytes() == table
    repeated = sweep(design, out=out, options=options)
    assert isinstance(repeated.result.to_dict(), dict)
    assert repeated.result.traced == 0
    assert repeated.result.to_dataset().identical(first.result.to_dataset())
    (out / "small-sweep.json").unlink()
    assert sweep(design, out=out, options=finer).result.traced == 1


def test_refuses_folder_with_results_of_other_commands(tmp_path: Path) -> None:
    design = save(tmp_path / "small.toml", DESIGN)
    options = ToleranceOptions(prints=32)
    write_all(Request(tmp_path / "small-prints.json", DESIGN, options).content)
    Request(tmp_path / "small-prints.json", DESIGN, options.model_copy(update={"print_number": 7})).check()
    with pytest.raises(OutputError, match=r"--seed is default in that request and 3 in this one"):
        tolerance(design, out=tmp_path, options=ToleranceOptions(prints=32, seed=3))
    write_all(Request(tmp_path / "small-optimise.json", DESIGN, OptimiseOptions(minimise=("span",))).content)
    with pytest.raises(OutputError, match="--minimise"):
        optimise(design, out=tmp_path, options=OptimiseOptions(minimise=("light",)))


def test_compares_files_by_content(tmp_path: Path) -> None:
    rays = tmp_path / "rays.txt"
    design = DESIGN.set({"emitter.ray_file": "rays.txt"}).in_folder(tmp_path)
    process = tmp_path / "mine.toml"
    for path in (rays, process):
        path.write_text("1", encoding="utf-8")
    request = Request(tmp_path / "request.json", design, ToleranceOptions(process=process))
    write_all(request.content)
    request.check()
    for path, key in ((rays, r"emitter\.ray_file"), (process, "process")):
        path.write_text("2", encoding="utf-8")
        with pytest.raises(OutputError, match=key):
            request.check()
        path.write_text("1", encoding="utf-8")
    request.path.write_text("{", encoding="utf-8")
    with pytest.raises(DataError, match=r"request\.json"):
        request.check()
