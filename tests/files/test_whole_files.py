"""Files are written completely or not at all, and every failure is reported in one line."""

import os
import sys
from pathlib import Path

import pytest

from solen import files
from solen.errors import DataError, OutputError, SpecError


def one_line(error: Exception) -> str:
    assert len(str(error).splitlines()) == 1
    return str(error)


def test_text_read_equals_text_written(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    assert files.write_text(target, "ein Öl\nzwei\n") == target
    assert target.read_bytes() == "ein Öl\nzwei\n".encode()
    assert files.read_text(target, DataError) == "ein Öl\nzwei\n"
    assert files.write_bytes(target, b"\x00\xff").read_bytes() == b"\x00\xff"
    assert list(tmp_path.iterdir()) == [target]


def test_function_writes_under_temporary_name(tmp_path: Path) -> None:
    target, paths = tmp_path / "out.txt", []
    target.write_text("old", encoding="utf-8")

    def write(path: Path) -> None:
        paths.append(path)
        assert target.read_text(encoding="utf-8") == "old"
        path.write_text("new", encoding="utf-8")

    assert files.write_all({target: write, tmp_path / "other": b"x"}) == [target, tmp_path / "other"]
    assert target.read_text(encoding="utf-8") == "new"
    assert (paths[0].parent, paths[0].name) != (target.parent, target.name)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "other", target]


def test_failing_function_leaves_old_files(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def fail(path: Path) -> None:
        path.write_text("half", encoding="utf-8")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device") as refusal:
        files.write_all({target: b"new", tmp_path / "library": fail})
    assert "library" in one_line(refusal.value)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("failing", ["pathlib.Path.replace", "shutil.copymode", "os.fsync", "pathlib.Path.open"])
def test_failed_write_leaves_only_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(failing, fail)
    with pytest.raises(OutputError, match="No space left on device") as refusal:
        files.write_text(target, "new")
    monkeypatch.undo()
    assert str(target) in one_line(refusal.value)
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_interrupt_leaves_only_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.write_text(target, "new")
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_reports_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written") as refusal:
        files.write_text(tmp_path / "no" / "out.txt", "x")
    assert "No such file" in one_line(refusal.value)


def test_reports_folder_with_name_of_file(tmp_path: Path) -> None:
    (tmp_path / "out.txt").mkdir()
    with pytest.raises(OutputError, match="cannot be written") as refusal:
        files.write_text(tmp_path / "out.txt", "x")
    one_line(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]


def test_reports_missing_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", denied)
        with pytest.raises(OutputError, match="Permission denied") as refusal:
            files.write_text(tmp_path / "out.txt", "x")
    one_line(refusal.value)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("tempfile.TemporaryFile", denied)
    with pytest.raises(OutputError, match="Permission denied") as refusal, files.output_folder(tmp_path / "new"):
        pytest.fail("entered")
    one_line(refusal.value)


def test_creates_empty_output_folder_with_parents(tmp_path: Path) -> None:
    with files.output_folder(tmp_path / "a" / "b") as folder:
        assert folder == tmp_path / "a" / "b"
        assert list(folder.iterdir()) == []
    with files.output_folder(folder) as existing:
        assert existing == folder
    assert folder.is_dir()


def test_removes_output_folder_only_if_created_and_empty(tmp_path: Path) -> None:
    def interrupted(folder: Path, after_writing: bool) -> None:
        with files.output_folder(folder) as folder_created:
            if after_writing:
                files.write_text(folder_created / "x", "x")
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


@pytest.mark.parametrize("subfolders", [(), ("deeper",)])
def test_reports_file_with_name_of_folder(tmp_path: Path, subfolders: tuple[str, ...]) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with (
        pytest.raises(OutputError, match="cannot be written") as refusal,
        files.output_folder(tmp_path.joinpath("file", *subfolders)),
    ):
        pytest.fail("entered")
    one_line(refusal.value)
    assert subfolders or "is a file, not a folder" in str(refusal.value)


@pytest.mark.skipif(sys.platform == "win32", reason="has a different limit on names")
def test_reports_folder_name_that_is_too_long(tmp_path: Path) -> None:
    with pytest.raises(OutputError) as refusal, files.output_folder(tmp_path / "new" / ("x" * 300)):
        pytest.fail("entered")
    one_line(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_drops_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbfschema = 1\n")
    assert files.read_text(tmp_path / "bom.toml", SpecError) == "schema = 1\n"


@pytest.mark.parametrize("data", [b"ab\xff", "ab\u00f6".encode("latin-1"), "ab".encode("utf-16")])
def test_refuses_text_that_is_not_utf_8(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "other.toml").write_bytes(data)
    with pytest.raises(SpecError, match="not UTF-8 text") as refusal:
        files.read_text(tmp_path / "other.toml", SpecError)
    assert "other.toml" in one_line(refusal.value)


def test_distinguishes_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file") as refusal:
        files.read_text(tmp_path / "none", DataError)
    one_line(refusal.value)
    with pytest.raises(DataError, match=r"is a folder|cannot be read") as refusal:
        files.read_text(tmp_path, DataError)
    one_line(refusal.value)
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(DataError, match=r"cannot be read|no such file") as refusal:
        files.read_text(tmp_path / "file" / "below", DataError)
    one_line(refusal.value)


def test_reports_path_with_null_byte(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read") as unread:
        files.read_text(Path("a\0b"), DataError)
    one_line(unread.value)
    with pytest.raises(OutputError, match="cannot be written") as unwritten:
        files.write_text(tmp_path / "a\0b", "x")
    one_line(unwritten.value)
    with pytest.raises(OutputError, match="cannot be written") as refusal, files.output_folder(tmp_path / "a\0b"):
        pytest.fail("entered")
    one_line(refusal.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
def test_keeps_permissions_of_replaced_file(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")
    target.chmod(0o600)
    files.write_text(target, "new")
    assert target.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX permissions")
@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_new_file_has_default_permissions(tmp_path: Path, umask: int, mode: int) -> None:
    before = os.umask(umask)
    try:
        target = files.write_text(tmp_path / "out.txt", "x")
    finally:
        os.umask(before)
    assert target.stat().st_mode & 0o777 == mode


def test_removes_all_created_empty_folders(tmp_path: Path) -> None:
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


def test_writes_file_with_longest_name(tmp_path: Path) -> None:
    target = tmp_path / ("x" * 251 + ".txt")
    assert files.write_text(target, "x").read_text(encoding="utf-8") == "x"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize(
    ("name", "message"),
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
def test_refuses_names_invalid_on_some_system(name: str, message: str) -> None:
    with pytest.raises(DataError) as refusal:
        files.check_name("sensor", name, DataError)
    assert message in one_line(refusal.value)


def test_accepts_valid_names() -> None:
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
def test_escapes_spreadsheet_formulas(text: str, cell: str) -> None:
    assert files.csv_cell(text) == cell


@pytest.mark.parametrize("position", [0, 50, 499])
def test_refuses_changed_sealed_file(tmp_path: Path, position: int) -> None:
    target = files.write_bytes(tmp_path / "a", bytes(range(250)) * 2)
    files.check_seal(target, DataError)  # files without a seal are accepted
    files.seal(target)
    files.check_seal(target, DataError)
    data = bytearray(target.read_bytes())
    assert data[:500] == bytes(range(250)) * 2
    data[position] ^= 1
    target.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        files.check_seal(target, DataError)
    data[position] ^= 1
    data[505] ^= 1  # damage to the first seal
    target.write_bytes(data)
    files.check_seal(target, DataError)
