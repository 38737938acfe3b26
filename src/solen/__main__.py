"""Entry point for ``python -m solen``."""

from solen.cli import main

main()
