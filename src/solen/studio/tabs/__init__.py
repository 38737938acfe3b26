"""Tabs of the page next to the design: one module each, which lists the commands that it offers.

A module states ``OFFERS``, and a function `commands_for` that returns the names of those that accept a dropped file,
the most probable first.
"""

import importlib
from pathlib import Path
from types import ModuleType

from solen.errors import SpecError
from solen.studio.offers import Offer

TABS = ("resin", "print", "microscope", "bench")
"""Names of the tabs, and of their modules here."""


def tab(name: str) -> ModuleType:
    """Return the module of a tab; `SpecError` for any other name."""
    if name not in TABS:
        raise SpecError("tab", value=name, limit=f"must be one of {', '.join(TABS)}")
    return importlib.import_module(f"{__name__}.{name}")


def offers_of(name: str) -> tuple[Offer, ...]:
    """Return the commands that a tab offers."""
    found: tuple[Offer, ...] = tab(name).OFFERS
    return found


def offer(name: str) -> Offer:
    """Return an offered command by its name; `SpecError` if there is none."""
    for each in TABS:
        for one in offers_of(each):
            if one.name == name:
                return one
    raise SpecError("command", value=name, limit="is not offered by any tab")


def commands_for(name: str, path: Path) -> tuple[str, ...]:
    """Return the names of a tab's commands that accept a file, the most probable first."""
    found: tuple[str, ...] = tab(name).commands_for(path)
    return found
