"""Parallel compilation of the missing parts of the tracer by programs that trace small cases."""

from pathlib import Path

import pytest

from solen.sensor import precompile
from solen.trace.kernel.compiled import cache_folder


def test_only_parts_of_which_nothing_is_kept_are_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precompile, "cache_folder", lambda: tmp_path)
    assert len(precompile.parts_to_compile()) == 2
    (tmp_path / "adapt.integrate_cone-74.py311.1.nbc").touch()
    (left,) = precompile.parts_to_compile()
    assert "layered" in left
    monkeypatch.setattr(precompile, "cache_folder", lambda: None)
    assert precompile.parts_to_compile() == []


@pytest.mark.parametrize("function", precompile.PARTS)
def test_a_program_leaves_its_function_in_the_cache(function: str) -> None:
    """Run here, where the function may be kept already: a renamed one would never be found."""
    name, values = precompile.PARTS[function]
    exec(precompile.PROGRAM.format(name=name, values=values), {})  # noqa: S102
    folder = cache_folder()
    assert folder is None or any(folder.glob(f"{function}-*.nbc"))
