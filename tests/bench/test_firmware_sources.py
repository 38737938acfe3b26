"""The firmware sources that `solen bench firmware` writes."""

from pathlib import Path

import pytest

from solen.bench.firmware.boards import BOARDS, Board
from solen.errors import OutputError
from solen.pipeline.bench.firmware import firmware


@pytest.mark.parametrize("board", BOARDS)
def test_writes_sources_but_keeps_changed_files(tmp_path: Path, board: Board) -> None:
    outcome = firmware(tmp_path / "board", board=board)
    names = {path.relative_to(tmp_path / "board").as_posix() for path in outcome.files.values()}
    assert names == set(BOARDS[board])
    assert all(path.stat().st_size > 200 for path in outcome.files.values())
    firmware(tmp_path / "board", board=board)  # unchanged files are accepted
    next(iter(outcome.files.values())).write_text("changed", encoding="utf-8")
    with pytest.raises(OutputError, match="already exists"):
        firmware(tmp_path / "board", board=board)
