"""The tabs of the page next to the design; each has a module that lists its commands.

A module defines ``COMMANDS``, and a function `suitable_commands` that returns the names of the commands that accept a
dropped file, the most probable first.
"""

import importlib
from pathlib import Path
from types import ModuleType

from solen.errors import SpecError
from solen.studio.page_commands import PageCommand

TABS = ("resin", "print", "microscope", "bench")
"""Names of the tabs and of their modules."""


def tab(name: str) -> ModuleType:
    """Return the module of a tab; raise `SpecError` for any other name."""
    if name not in TABS:
        raise SpecError("tab", value=name, limit=f"must be one of {', '.join(TABS)}")
    return importlib.import_module(f"{__name__}.{name}")


def commands_of(name: str) -> tuple[PageCommand, ...]:
    """Return the commands of a tab."""
    commands: tuple[PageCommand, ...] = tab(name).COMMANDS
    return commands


def command(name: str) -> PageCommand:
    """Return the command of a tab with this name; raise `SpecError` if there is none."""
    for tab_name in TABS:
        for command in commands_of(tab_name):
            if command.name == name:
                return command
    raise SpecError("command", value=name, limit="is not a command of any tab")


def suitable_commands(name: str, path: Path) -> tuple[str, ...]:
    """Return the names of the commands of a tab that accept a file, the most probable first."""
    commands: tuple[str, ...] = tab(name).suitable_commands(path)
    return commands
