"""Packing and unpacking the files of a sensor: unpacked files equal the packed ones, and no other files are written."""

import hashlib
import json
import zipfile
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path, PurePosixPath

import pytest

from solen.archive import NAME, Limits, PackOptions, described, opened, pack
from solen.bench.rig import load_rig
from solen.cli import run_command
from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.material.resin import library
from solen.samples import sample_files
from solen.spec import load

OPTIONS = PackOptions(author=("A. Author <0000-0002-1825-0097>", "Another"), licence="CC-BY-4.0", description="Two.")
DESIGN = 'schema = 1  # mine\nname = "mine"\n[material]\nresin = "../resins/own.toml"  # ours\n'
RESIN = (files("solen.material") / "library" / f"{library()[0]}.toml").read_text(encoding="utf-8")
TABLE = "time (s),angle (deg),left (V),right (V)\n0,0,1.0,1.1\n1,1,1.1,1.0\n2,2,1.2,0.9\n"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a design whose resin is in another folder, a recording, an unreadable file and a figure."""
    folder = tmp_path_factory.mktemp("lab")
    for name, text in {
        "design/sensor.toml": DESIGN,
        "resins/own.toml": RESIN,
        "bench/monday.csv": TABLE,
        "bench/.hidden": "no",
        "bench/notes.dat": "not a table",
        "figure.svg": "<svg/>",
    }.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def zipped(lab: Path) -> Path:
    further = [lab / "bench", lab / "figure.svg"]
    return pack(lab / "design" / "sensor.toml", further, OPTIONS).save(lab / "sensor.zip")


def test_reads_unit_at_end_of_column_name(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("time_s,left_V,a.x_V,right_mV\n0,1,2,3\n1,2,3,4\n", encoding="utf-8")
    assert described(path, PurePosixPath("own.csv")).quantities == {
        "time": "s", "left_V": "V", "a.x_V": "V", "right": "mV"
    }  # fmt: skip


def test_unpacks_what_was_packed(zipped: Path, tmp_path: Path) -> None:
    archive = opened(zipped)
    assert {item.path: item.kind for item in archive.items} == {
        "sensor.toml": "design",
        "files/own.toml": "resin",
        "files/bench/monday.csv": "recording",
        "files/bench/notes.dat": "other file",
        "files/figure.svg": "image",
    }
    assert (archive.name, archive.licence, archive.authors) == ("mine", "CC-BY-4.0", ("A. Author", "Another"))
    table = next(item for item in archive.items if item.kind == "recording")
    assert table.quantities == {"time": "s", "angle": "deg", "left": "V", "right": "V"}
    folder = archive.save(tmp_path / "out")
    assert (folder / "files" / "bench" / "monday.csv").read_text() == TABLE
    design = load(folder / "sensor.toml")
    assert design.resin_file == folder / "files" / "own.toml"
    assert "# ours" in (folder / "sensor.toml").read_text()
    assert [item.to_dict() for item in opened(folder).items] == [item.to_dict() for item in archive.items]


def test_folder_and_zip_file_have_same_contents(lab: Path, zipped: Path, tmp_path: Path) -> None:
    archive = pack(lab / "design" / "sensor.toml", [lab / "bench", lab / "figure.svg"], OPTIONS)
    assert archive.save(tmp_path / "again.zip").read_bytes() == zipped.read_bytes()
    folder = archive.save(tmp_path / "folder")
    unpacked = opened(zipped).save(tmp_path / "unpacked")
    names = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
    assert len(names) == 6
    for name in names:
        assert (folder / name).read_bytes() == (unpacked / name).read_bytes()
    with pytest.raises(OutputError, match="exists"):
        archive.save(folder)


def test_metadata_is_linked_data(zipped: Path) -> None:
    with zipfile.ZipFile(zipped) as zip_file:
        graph = {entity["@id"]: entity for entity in json.loads(zip_file.read(NAME))["@graph"]}
    root = graph["./"]
    assert graph[NAME]["about"] == {"@id": "./"}
    assert graph[root["license"]["@id"]]["name"] == "CC-BY-4.0"
    assert [graph[author["@id"]]["name"] for author in root["author"]] == ["A. Author", "Another"]
    assert root["author"][0]["@id"] == "https://orcid.org/0000-0002-1825-0097"
    for part in root["hasPart"]:
        assert graph[part["@id"]]["@type"] == "File"
    quantities = graph["files/bench/monday.csv"]["variableMeasured"]
    assert graph[quantities[1]["@id"]] == {
        "@id": quantities[1]["@id"], "@type": "PropertyValue", "name": "angle", "unitText": "deg"
    }  # fmt: skip


def test_packs_unreadable_file_with_warning(lab: Path) -> None:
    archive = pack(lab / "design" / "sensor.toml", [lab / "bench"], OPTIONS)
    (warning,) = archive.warnings
    assert "notes.dat" in warning


def test_packs_designs_named_by_rig(lab: Path, tmp_path: Path) -> None:
    (tmp_path / "bench").mkdir()
    text = sample_files()["bench/rig.toml"].decode().replace('design = "sensor.toml"', 'design = "../other/other.toml"')
    (tmp_path / "bench" / "rig.toml").write_text(text, encoding="utf-8")
    (tmp_path / "other").mkdir()
    resin = (lab / "resins" / "own.toml").as_posix()
    (tmp_path / "other" / "other.toml").write_text(DESIGN.replace("../resins/own.toml", resin), encoding="utf-8")
    (tmp_path / "bench" / "recordings.sqlite").write_bytes(b"a catalogue, which is not packed")
    archive = pack(lab / "design" / "sensor.toml", [tmp_path / "bench"], OPTIONS)
    assert archive.warnings == ()
    out = opened(archive.save(tmp_path / "rig.zip")).save(tmp_path / "out")
    rig = load_rig(out / "files" / "bench" / "rig.toml")
    designs = {(out / "files" / "bench" / sensor.design).resolve() for sensor in rig.sensor}
    assert designs == {out / "files" / "other.toml"}
    assert load(out / "files" / "other.toml").resin_file.resolve() == out / "files" / "own.toml"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"author": ()}, "--author"),
        ({"author": ("A. Author <0000-0002-1825-0098>",)}, "0098"),
        ({"author": ("<0000-0002-1825-0097>",)}, "--author"),
        ({"licence": "CC-BY"}, "CC-BY-4.0"),
    ],
)
def test_refuses_invalid_author_or_licence(lab: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        pack(lab / "design" / "sensor.toml", [], OPTIONS.model_copy(update=options))


def test_refuses_missing_and_conflicting_files(lab: Path, tmp_path: Path) -> None:
    design = lab / "design" / "sensor.toml"
    (tmp_path / "sensor.toml").write_text(DESIGN.replace("../resins/", ""))
    with pytest.raises(DataError, match=r"own\.toml"):
        pack(tmp_path / "sensor.toml", [], OPTIONS)
    (tmp_path / "own.toml").write_text("schema = 1\n")
    with pytest.raises(DataError, match=r"own\.toml"):
        pack(tmp_path / "sensor.toml", [], OPTIONS)
    with pytest.raises(DataError, match=r"missing\.csv"):
        pack(design, [lab / "missing.csv"], OPTIONS)
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "figure.svg").write_text("<svg>other</svg>")
    with pytest.raises(DataError, match=r"files/figure\.svg"):
        pack(design, [lab / "figure.svg", tmp_path / "one" / "figure.svg"], OPTIONS)
    (tmp_path / "Figure.svg").write_text("<svg>other</svg>")
    with pytest.raises(DataError, match="Windows"):
        pack(design, [lab / "figure.svg", tmp_path / "Figure.svg"], OPTIONS)


def test_refuses_file_that_changes_while_packing(lab: Path, tmp_path: Path) -> None:
    file = tmp_path / "growing.csv"
    file.write_text(TABLE)
    archive = pack(lab / "design" / "sensor.toml", [file], OPTIONS)
    file.write_text(TABLE + "3,3,1.3,0.8\n")
    for out in ("out.zip", "out"):
        with pytest.raises(DataError, match=r"growing\.csv"):
            archive.save(tmp_path / out)
        assert not (tmp_path / out).exists()
    assert [path.name for path in tmp_path.iterdir()] == ["growing.csv"]


def _metadata(files: dict[str, bytes], change: Callable[[dict[str, dict[str, object]]], None]) -> None:
    data = json.loads(files[NAME])
    change({entity["@id"]: entity for entity in data["@graph"]})
    files[NAME] = json.dumps(data).encode()


def _renamed(path: str) -> Callable[[dict[str, bytes]], None]:
    """Return a change of the path of the figure, in the archive and in its metadata."""

    def change(files: dict[str, bytes]) -> None:
        files[path] = files.pop("files/figure.svg")
        files[NAME] = files[NAME].replace(b"files/figure.svg", path.replace("\\", "\\\\").encode())

    return change


def _with_entry(key: str, value: object) -> Callable[[dict[str, bytes]], None]:
    def set_entry(entities: dict[str, dict[str, object]]) -> None:
        entities["files/figure.svg"][key] = value

    return lambda files: _metadata(files, set_entry)


def _with_design_outside(files: dict[str, bytes]) -> None:
    text = files["sensor.toml"].replace(b"files/own.toml", b"../../own.toml")
    files["sensor.toml"] = text

    def set_entry(entities: dict[str, dict[str, object]]) -> None:
        entities["sensor.toml"] |= {"contentSize": len(text), "sha256": hashlib.sha256(text).hexdigest()}

    _metadata(files, set_entry)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_renamed("../figure.svg"), "within the folder"),
        (_renamed("/figure.svg"), "within the folder"),
        (_renamed("files/../../figure.svg"), "within the folder"),
        (_renamed("..\\figure.svg"), "within the folder|device|allow|without any"),
        (_renamed("C:figure.svg"), "within the folder"),
        (_renamed("files/aux.svg"), "device"),
        (_renamed("FILES/OWN.toml"), "two files"),
        (lambda files: files.pop("files/figure.svg"), "missing"),
        (lambda files: files.update(more=b"?"), "not listed"),
        (lambda files: files.update({"files/figure.svg": b"<svg>"}), "checksum"),
        (lambda files: files.update({"files/figure.svg": b"0" * 10_000_000}), "checksum"),
        (_with_entry("contentSize", 10**13), "MB"),
        (_with_entry("contentSize", -1), "contentSize"),
        (_with_entry("sha256", "0" * 63), "sha256"),
        (lambda files: files.pop(NAME), "not a solen archive"),
        (lambda files: files.update({NAME: b"[]"}), "RO-Crate"),
        (lambda files: files.update({NAME: b"\xff"}), "utf-8"),
        (lambda files: files.update({NAME: b"[" * 100_000}), "RO-Crate"),
        (_with_design_outside, "outside the archive"),
    ],
)
def test_refuses_manipulated_archive(
    zipped: Path, tmp_path: Path, change: Callable[[dict[str, bytes]], object], message: str
) -> None:
    with zipfile.ZipFile(zipped) as zip_file:
        files = {name: zip_file.read(name) for name in zip_file.namelist()}
    change(files)
    bad = tmp_path / "bad.zip"
    with zipfile.ZipFile(bad, "w", zipfile.ZIP_DEFLATED) as zip_file:
        for name, content in files.items():
            entry = zipfile.ZipInfo("x")
            entry.filename = name  # ZipInfo() would correct the separators
            zip_file.writestr(entry, content)
    with pytest.raises(SolenError, match=f"(?i){message}"):
        opened(bad).save(tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.zip"]


def test_refuses_rig_that_names_design_outside(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_bytes(sample_files()["bench/rig.toml"])
    (tmp_path / "sensor.toml").write_text('schema = 1\nname = "mine"\n[material]\nindex = 1.44\n')
    folder = pack(tmp_path / "sensor.toml", [tmp_path / "rig.toml"], OPTIONS).save(tmp_path / "folder")
    text = (folder / "rig.toml").read_bytes().replace(b'"sensor.toml"', b'"../sensor.toml"')
    (folder / "rig.toml").write_bytes(text)
    data = json.loads((folder / NAME).read_text())
    (entity,) = (entry for entry in data["@graph"] if entry["@id"] == "rig.toml")
    entity |= {"contentSize": len(text), "sha256": hashlib.sha256(text).hexdigest(), "kind": "other file"}
    (folder / NAME).write_text(json.dumps(data))
    with pytest.raises(DataError, match="outside the archive"):
        opened(folder).save(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_refuses_link_and_damaged_zip_file(zipped: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.zip"
    link.write_bytes(zipped.read_bytes())
    with zipfile.ZipFile(link, "a") as zip_file:
        entry = zipfile.ZipInfo("files/link")
        entry.external_attr = 0o120777 << 16
        zip_file.writestr(entry, "/etc/passwd")
    with pytest.raises(DataError, match="link"):
        opened(link)
    data = bytearray(zipped.read_bytes())
    damaged = tmp_path / "damaged.zip"
    damaged.write_bytes(data[: len(data) // 2])
    with pytest.raises(DataError, match="readable"):
        opened(damaged)
    data[len(data) // 4] ^= 0xFF
    damaged.write_bytes(data)
    with pytest.raises(DataError, match=r"damaged\.zip"):
        opened(damaged).save(tmp_path / "out")
    with pytest.raises(DataError, match="no such file"):
        opened(tmp_path / "none.zip")
    assert not (tmp_path / "out").exists()


def test_refuses_folder_with_link(zipped: Path, tmp_path: Path) -> None:
    folder = opened(zipped).save(tmp_path / "folder")
    (folder / "files" / "figure.svg").unlink()
    try:
        (folder / "files" / "figure.svg").symlink_to(zipped)
    except OSError:
        pytest.skip("creating links requires a privilege")
    with pytest.raises(DataError, match="link"):
        opened(folder)


def test_checks_limits(zipped: Path) -> None:
    with pytest.raises(DataError, match="most-files"):
        opened(zipped, Limits(most_files=2))
    with pytest.raises(DataError, match="most-megabytes"):
        opened(zipped, Limits(most_megabytes=1e-6))


def test_refuses_damaged_recording(tmp_path: Path) -> None:
    from solen.files import seal

    file = tmp_path / "run.h5"
    file.write_bytes(b"numbers" * 100)
    seal(file)
    data = bytearray(file.read_bytes())
    data[10] ^= 1
    file.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        described(file, file.relative_to(tmp_path))  # type: ignore[arg-type]


def test_packs_and_unpacks_on_command_line(lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    design, out = str(lab / "design" / "sensor.toml"), str(tmp_path / "sensor.zip")
    metadata = ["--author", "A. Author", "--licence", "MIT"]
    assert run_command(["project", "pack", design, str(lab / "bench"), "--out", out, *metadata, "--json"]) == 0
    packed = json.loads(capsys.readouterr().out)
    assert packed["simulated"] is False
    assert packed["size_bytes"] == sum(item["size_bytes"] for item in packed["items"])
    assert run_command(["project", "unpack", out, "--out", str(tmp_path / "out")]) == 0
    assert "monday.csv" in capsys.readouterr().out
    assert run_command(["project", "unpack", out, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
