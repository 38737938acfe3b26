"""Run the command `solen` as ``python -m solen``."""

from solen.cli import main

main()
