"""``python -m solen`` is the command ``solen``."""

from solen.cli import main

main()
