"""Writes the pages of the Python reference, one for each module of the package, from the tree as it is."""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

ROOMS = {
    "ground": (
        "The ground",
        ("errors", "units", "plane", "arrays", "progress", "files", "extras", "registry", "results", "ranks"),
    ),
    "curve": ("Curves and interfaces", ("curve", "interface")),
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
"""Rooms in the order of the stages: page, title, modules."""
WHOLE = ("solen.curve", "solen.sensor")
"""Packages whose names are documented where they are imported from rather than where they are defined."""
INNER = ("solen.trace.kernel", "solen.recording", "solen.scene.rayoptics", "solen.geometry.drawing", "solen.report")
"""Packages of which only the package itself is part of the reference, and the modules of `OPEN`."""
OPEN = (
    *(f"solen.recording.{name}" for name in ("reader", "model", "spectrum", "grid", "source", "stimulus")),
    *("solen.scene.rayoptics.importer", "solen.geometry.drawing.model", "solen.report.design.figures"),
)
LEFT_OUT = {
    "solen.recording.model": "metadata, texts",
    "solen.readout.circuit": "named_part",
    "solen.fabricate.threemf": "Pieces",
}
"""Members that are no part of the reference, by module."""


def write_pages(folder: Path) -> None:
    """Write all pages into a folder; one that is as it should be is left alone, so that it is not built again."""
    folder.mkdir(exist_ok=True)
    pages = {"index": index_page()}
    for room, (title, packages) in ROOMS.items():
        names = [name for package in packages for name in modules(f"solen.{package}")]
        pages |= {room: room_page(title, names)} | {name: module_page(name, room, title) for name in names}
    for path in folder.glob("*.md"):
        if path.stem not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def index_page() -> str:
    """The first page: the package, and the rooms in the order of the stages."""
    names = "\n".join(ROOMS)
    return (
        "# Python interface\n\n```{eval-rst}\n.. automodule:: solen\n```\n\n"
        "Modules by the stages of the chain: each imports only those above it here.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{names}\n```\n"
    )


def room_page(title: str, names: list[str]) -> str:
    """Modules of a room, each with the first sentence of its text."""
    rows = "\n".join(f"- :mod:`{name}`: {first_sentence(name)}" for name in names)
    return f"# {title}\n\n```{{eval-rst}}\n{rows}\n```\n"


def first_sentence(name: str) -> str:
    """First sentence of a module's text, in one line."""
    text = " ".join((import_module(name).__doc__ or "").split("\n\n")[0].split())
    return text.partition(". ")[0].removesuffix(".") + "."


def module_page(name: str, room: str, title: str) -> str:
    """Page of one module, which its room's page links to."""
    return f"---\norphan: true\n---\n\n# {name}\n\n[{title}]({room}.md)\n\n```{{eval-rst}}\n{block(name)}```\n"


def modules(name: str) -> Iterator[str]:
    """A module and what is below it, as far as it is part of the reference."""
    if name in OPEN or not any(name.startswith(f"{inner}.") for inner in INNER):
        yield name
    for _, inner, _ in pkgutil.iter_modules(getattr(import_module(name), "__path__", ())):
        if not inner.startswith("_"):
            yield from modules(f"{name}.{inner}")


def block(name: str) -> str:
    """Directive for one module: a package by its text alone, a module with its members."""
    module = import_module(name)
    whole = next((one for one in WHOLE if name == one or name.startswith(f"{one}.")), None)
    lines = [f".. automodule:: {name}"]
    if name == whole or not hasattr(module, "__path__"):
        lines += ["   :members:", "   :show-inheritance:"]
        if left := ", ".join(filter(None, (LEFT_OUT.get(name), *elsewhere(name, whole)))):
            lines.append(f"   :exclude-members: {left}")
    return "\n".join(lines) + "\n"


def elsewhere(name: str, whole: str | None) -> list[str]:
    """Names of a module that its package documents, and names of a package that are also those of its modules."""
    if whole is None:
        return []
    inner = {one.name for one in pkgutil.iter_modules(import_module(whole).__path__)}
    return [one for one in import_module(whole).__all__ if (one in inner) == (name == whole)]
