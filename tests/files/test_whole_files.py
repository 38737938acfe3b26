"""Files are written whole or not at all, and every failure is one line."""

import os
import sys
from pathlib import Path

import pytest

from solen import files
from solen.errors import DataError, OutputError, SpecError


def told(error: Exception) -> str:
    assert len(str(error).splitlines()) == 1
    return str(error)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    assert files.write_text(target, "ein Öl\nzwei\n") == target
    assert target.read_bytes() == "ein Öl\nzwei\n".encode()
    assert files.read_text(target, DataError) == "ein Öl\nzwei\n"
    assert files.write_bytes(target, b"\x00\xff").read_bytes() == b"\x00\xff"
    assert list(tmp_path.iterdir()) == [target]


def test_a_library_writes_by_itself_under_a_temporary_name(tmp_path: Path) -> None:
    target, seen = tmp_path / "out.txt", []
    target.write_text("old", encoding="utf-8")

    def by_itself(path: Path) -> None:
        seen.append(path)
        assert target.read_text(encoding="utf-8") == "old"
        path.write_text("new", encoding="utf-8")

    assert files.write_all({target: by_itself, tmp_path / "other": b"x"}) == [target, tmp_path / "other"]
    assert target.read_text(encoding="utf-8") == "new"
    assert (seen[0].parent, seen[0].name) != (target.parent, target.name)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "other", target]


def test_a_library_that_fails_leaves_every_old_file(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def fails(path: Path) -> None:
        path.write_text("half", encoding="utf-8")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device") as refusal:
        files.write_all({target: b"new", tmp_path / "library": fails})
    assert "library" in told(refusal.value)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("failing", ["pathlib.Path.replace", "shutil.copymode", "os.fsync", "pathlib.Path.open"])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(failing, fails)
    with pytest.raises(OutputError, match="No space left on device") as refusal:
        files.write_text(target, "new")
    monkeypatch.undo()
    assert str(target) in told(refusal.value)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_an_interrupt_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.write_text(target, "new")
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written") as refusal:
        files.write_text(tmp_path / "no" / "out.txt", "x")
    assert "No such file" in told(refusal.value)


def test_a_folder_in_the_way_is_reported(tmp_path: Path) -> None:
    (tmp_path / "out.txt").mkdir()
    with pytest.raises(OutputError, match="cannot be written") as refusal:
        files.write_text(tmp_path / "out.txt", "x")
    told(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]


def test_missing_permission_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", denied)
        with pytest.raises(OutputError, match="Permission denied") as refusal:
            files.write_text(tmp_path / "out.txt", "x")
    told(refusal.value)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("tempfile.TemporaryFile", denied)
    with pytest.raises(OutputError, match="Permission denied") as refusal, files.output_folder(tmp_path / "new"):
        pytest.fail("entered")
    told(refusal.value)


def test_a_folder_is_made_with_its_parents_and_handed_over_empty(tmp_path: Path) -> None:
    with files.output_folder(tmp_path / "a" / "b") as folder:
        assert folder == tmp_path / "a" / "b"
        assert list(folder.iterdir()) == []
    with files.output_folder(folder) as again:
        assert again == folder
    assert folder.is_dir()


def test_a_folder_made_for_nothing_is_removed_and_only_then(tmp_path: Path) -> None:
    def interrupted(folder: Path, after_writing: bool) -> None:
        with files.output_folder(folder) as made:
            if after_writing:
                files.write_text(made / "x", "x")
            raise KeyboardInterrupt

    def fails_in(folder: Path, *, after_writing: bool) -> None:
        with pytest.raises(KeyboardInterrupt):
            interrupted(folder, after_writing)

    fails_in(tmp_path / "new", after_writing=False)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old").mkdir()
    fails_in(tmp_path / "old", after_writing=False)
    fails_in(tmp_path / "kept", after_writing=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept", "old"]


@pytest.mark.parametrize("below", [(), ("deeper",)])
def test_a_file_in_the_place_of_a_folder_is_reported(tmp_path: Path, below: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with (
        pytest.raises(OutputError, match="cannot be written") as refusal,
        files.output_folder(tmp_path.joinpath("file", *below)),
    ):
        pytest.fail("entered")
    told(refusal.value)
    assert below or "is a file, not a folder" in str(refusal.value)


@pytest.mark.skipif(sys.platform == "win32", reason="another limit on names")
def test_a_folder_of_too_long_a_name_is_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError) as refusal, files.output_folder(tmp_path / "new" / ("x" * 300)):
        pytest.fail("entered")
    told(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_a_byte_order_mark_is_dropped(tmp_path: Path) -> None:
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbfschema = 1\n")
    assert files.read_text(tmp_path / "bom.toml", SpecError) == "schema = 1\n"


@pytest.mark.parametrize("data", [b"ab\xff", "ab\u00f6".encode("latin-1"), "ab".encode("utf-16")])
def test_what_is_not_utf_8_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "other.toml").write_bytes(data)
    with pytest.raises(SpecError, match="not UTF-8 text") as refusal:
        files.read_text(tmp_path / "other.toml", SpecError)
    assert "other.toml" in told(refusal.value)


def test_a_missing_file_and_a_folder_are_distinguished(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file") as refusal:
        files.read_text(tmp_path / "none", DataError)
    told(refusal.value)
    with pytest.raises(DataError, match=r"is a folder|cannot be read") as refusal:
        files.read_text(tmp_path, DataError)
    told(refusal.value)
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(DataError, match=r"cannot be read|no such file") as refusal:
        files.read_text(tmp_path / "file" / "below", DataError)
    told(refusal.value)


def test_a_path_with_a_null_byte_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read") as unread:
        files.read_text(Path("a\0b"), DataError)
    told(unread.value)
    with pytest.raises(OutputError, match="cannot be written") as unwritten:
        files.write_text(tmp_path / "a\0b", "x")
    told(unwritten.value)
    with pytest.raises(OutputError, match="cannot be written") as refusal, files.output_folder(tmp_path / "a\0b"):
        pytest.fail("entered")
    told(refusal.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
def test_a_private_file_stays_private(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")
    target.chmod(0o600)
    files.write_text(target, "new")
    assert target.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path: Path, umask: int, mode: int) -> None:
    before = os.umask(umask)
    try:
        target = files.write_text(tmp_path / "out.txt", "x")
    finally:
        os.umask(before)
    assert target.stat().st_mode & 0o777 == mode


def test_all_folders_made_for_nothing_are_removed_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    with pytest.raises(KeyboardInterrupt), files.output_folder(tmp_path / "old" / "a" / "b" / "c"):
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.rglob("*")] == ["old"]

    def interrupted_after_writing() -> None:
        with files.output_folder(tmp_path / "old" / "a" / "b") as folder:
            files.write_text(folder.parent / "x", "x")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_after_writing()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "old", "x"]


def test_a_name_as_long_as_a_name_may_be_is_written(tmp_path: Path) -> None:
    target = tmp_path / ("x" * 251 + ".txt")
    assert files.write_text(target, "x").read_text(encoding="utf-8") == "x"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("a/b", "without its folder"),
        ("..", "must not begin with a dot"),
        ("run.", "or end in a dot"),
        ("run ", "a space"),
        ("con", "reserved for a device on Windows: con"),
        ("COM1.nc", "reserved for a device on Windows: COM1"),
        ("lpt¹", "reserved for a device on Windows"),
        ("a\tb", "without its folder"),
        ("", "must not begin"),
        ("a" * 300, "is 300 bytes long; at most 200"),
    ],
)
def test_names_that_are_no_files_on_some_system_are_refused(name: str, why: str) -> None:
    with pytest.raises(DataError) as refusal:
        files.check_name("sensor", name, DataError)
    assert why in told(refusal.value)


def test_names_of_files_pass() -> None:
    for name in ("lens-1", "console", "com10", "a.b", "Ωm"):
        files.check_name("sensor", name, DataError)


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("U_L (V)", "U_L (V)"),
        ("=1+1", "'=1+1"),
        ("-x", "'-x"),
        ("+x", "'+x"),
        ("@x,y", '"\'@x,y"'),
        ('say "a"', '"say ""a"""'),
        ("", ""),
    ],
)
def test_texts_that_a_spreadsheet_would_compute_are_escaped(text: str, cell: str) -> None:
    assert files.csv_cell(text) == cell


@pytest.mark.parametrize("place", [0, 50, 499])
def test_a_sealed_file_that_was_changed_is_refused(tmp_path: Path, place: int) -> None:
    target = files.write_bytes(tmp_path / "a", bytes(range(250)) * 2)
    files.check_seal(target, DataError)  # without a seal it passes
    files.seal(target)
    files.check_seal(target, DataError)
    data = bytearray(target.read_bytes())
    assert data[:500] == bytes(range(250)) * 2
    data[place] ^= 1
    target.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        files.check_seal(target, DataError)
    data[place] ^= 1
    data[505] ^= 1  # the first of both seals
    target.write_bytes(data)
    files.check_seal(target, DataError)
