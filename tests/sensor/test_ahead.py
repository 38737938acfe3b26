"""What is compiled beside a run: what is missing, by programs that trace what they say."""

from pathlib import Path

import pytest

from solen.sensor import ahead
from solen.trace.kernel.compiled import cache_folder


def test_only_parts_of_which_nothing_is_kept_are_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "cache_folder", lambda: tmp_path)
    assert len(ahead.parts_to_compile()) == 2
    (tmp_path / "adapt.integrate_cone-74.py311.1.nbc").touch()
    (left,) = ahead.parts_to_compile()
    assert "layered" in left
    monkeypatch.setattr(ahead, "cache_folder", lambda: None)
    assert ahead.parts_to_compile() == []


@pytest.mark.parametrize("function", ahead.PARTS)
def test_a_program_leaves_its_function_in_the_cache(function: str) -> None:
    """Run here, where the function may be kept already: a renamed one would never be found."""
    name, values = ahead.PARTS[function]
    exec(ahead.PROGRAM.format(name=name, values=values), {})  # noqa: S102
    folder = cache_folder()
    assert folder is None or any(folder.glob(f"{function}-*.nbc"))
