"""Parallel compilation of the missing parts of the tracer by programs that trace small cases."""

from pathlib import Path

import pytest

from solen.sensor import precompile
from solen.trace.kernel.compiled import cache_folder


def test_compiles_only_parts_missing_in_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precompile, "cache_folder", lambda: tmp_path)
    assert len(precompile.parts_to_compile()) == 2
    (tmp_path / "adapt.integrate_cone-74.py311.1.nbc").touch()
    (remaining,) = precompile.parts_to_compile()
    assert "layered" in remaining
    monkeypatch.setattr(precompile, "cache_folder", lambda: None)
    assert precompile.parts_to_compile() == []


@pytest.mark.parametrize("function", precompile.PARTS)
def test_program_stores_its_function_in_the_cache(function: str) -> None:
    """The function may be in the cache already; the test fails if it is renamed."""
    name, values = precompile.PARTS[function]
    exec(precompile.PROGRAM.format(name=name, values=values), {})  # noqa: S102
    folder = cache_folder()
    assert folder is None or any(folder.glob(f"{function}-*.nbc"))
