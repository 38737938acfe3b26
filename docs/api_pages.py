"""Write the pages of the Python reference, one for each module of the package."""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

PARTS = {
    "basics": (
        "Basics",
        ("errors", "units", "plane", "arrays", "progress", "files", "extras", "registry", "results", "ranks"),
    ),
    "curve": ("Curves and refraction", ("curve", "refraction")),
    "recording": ("Recordings", ("recording",)),
    "spec": ("The design file", ("spec",)),
    "parts": ("Parts", ("parts",)),
    "material": ("Material", ("material",)),
    "lens": ("Lens", ("lens",)),
    "geometry": ("Geometry", ("geometry",)),
    "mechanics": ("Mechanics of soft bodies", ("mechanics",)),
    "scene": ("Scene", ("scene",)),
    "trace": ("Trace", ("trace",)),
    "readout": ("Readout", ("readout",)),
    "sensor": ("Sensor", ("sensor",)),
    "analysis": ("Analysis of recordings", ("analysis",)),
    "fabricate": ("Solids, layers and the print process", ("fabricate",)),
    "metrology": ("Metrology", ("metrology",)),
    "bench": ("Bench", ("bench",)),
    "explore": ("Exploring designs, and tuning prints", ("explore",)),
    "archive": ("Archives of sensors", ("archive",)),
    "report": ("Figures", ("report",)),
}
"""Parts of the package in the order of the stages: page, title, modules."""
RE_EXPORTING = ("solen.curve", "solen.sensor")
"""Packages whose names are documented on the page of the package rather than of the module that defines them."""
CLOSED = ("solen.trace.kernel", "solen.recording", "solen.scene.rayoptics", "solen.geometry.drawing", "solen.report")
"""Packages whose modules are not part of the reference, except those in `OPEN`."""
OPEN = (
    *(f"solen.recording.{name}" for name in ("reader", "model", "spectrum", "grid", "source", "stimulus")),
    *("solen.scene.rayoptics.importer", "solen.geometry.drawing.model", "solen.report.design.figures"),
)
EXCLUDED = {
    "solen.recording.model": "metadata, texts",
    "solen.readout.circuit": "named_part",
    "solen.fabricate.threemf": "Pieces",
}
"""Members that are not part of the reference, keyed by module."""


def write_pages(folder: Path) -> None:
    """Write all pages to a folder; unchanged pages are not written, so that Sphinx does not rebuild them."""
    folder.mkdir(exist_ok=True)
    pages = {"index": index_page()}
    for part, (title, packages) in PARTS.items():
        names = [name for package in packages for name in modules(f"solen.{package}")]
        pages |= {part: part_page(title, names)} | {name: module_page(name, part, title) for name in names}
    for path in folder.glob("*.md"):
        if path.stem not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def index_page() -> str:
    """Return the first page: the package, and its parts in the order of the stages."""
    names = "\n".join(PARTS)
    return (
        "# Python interface\n\n```{eval-rst}\n.. automodule:: solen\n```\n\n"
        "Modules in the order of the stages: each imports only modules of parts listed above it.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{names}\n```\n"
    )


def part_page(title: str, names: list[str]) -> str:
    """Return the page of a part: its modules, each with the first sentence of its docstring."""
    rows = "\n".join(f"- :mod:`{name}`: {first_sentence(name)}" for name in names)
    return f"# {title}\n\n```{{eval-rst}}\n{rows}\n```\n"


def first_sentence(name: str) -> str:
    """Return the first sentence of the docstring of a module, in one line."""
    text = " ".join((import_module(name).__doc__ or "").split("\n\n")[0].split())
    return text.partition(". ")[0].removesuffix(".") + "."


def module_page(name: str, part: str, title: str) -> str:
    """Return the page of a module, to which the page of its part links."""
    return f"---\norphan: true\n---\n\n# {name}\n\n[{title}]({part}.md)\n\n```{{eval-rst}}\n{block(name)}```\n"


def modules(name: str) -> Iterator[str]:
    """Yield a module and the modules within it, as far as they are part of the reference."""
    if name in OPEN or not any(name.startswith(f"{package}.") for package in CLOSED):
        yield name
    for _, inner, _ in pkgutil.iter_modules(getattr(import_module(name), "__path__", ())):
        if not inner.startswith("_"):
            yield from modules(f"{name}.{inner}")


def block(name: str) -> str:
    """Return the directive of a module: a package with its docstring only, a module with its members."""
    module = import_module(name)
    package = next((candidate for candidate in RE_EXPORTING if f"{name}.".startswith(f"{candidate}.")), None)
    lines = [f".. automodule:: {name}"]
    if name == package or not hasattr(module, "__path__"):
        lines += ["   :members:", "   :show-inheritance:"]
        if excluded := ", ".join(filter(None, (EXCLUDED.get(name), *documented_elsewhere(name, package)))):
            lines.append(f"   :exclude-members: {excluded}")
    return "\n".join(lines) + "\n"


def documented_elsewhere(name: str, package: str | None) -> list[str]:
    """Return the names of a module that its package documents, or the names of a package that are its modules."""
    if package is None:
        return []
    inner = {module.name for module in pkgutil.iter_modules(import_module(package).__path__)}
    return [public for public in import_module(package).__all__ if (public in inner) == (name == package)]
