"""``python -m solen`` is the ``solen`` command."""

import sys

from solen.cli import main

sys.exit(main())
