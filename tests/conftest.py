"""Settings of all tests."""

import functools
import gc
import os

import docstring_parser
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("solen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("solen")  # test cases may be slow on a busy machine

# Help and completion parse the docstring of the pydantic base class for every options class; here it is cached.
docstring_parser.parse_from_object = functools.cache(docstring_parser.parse_from_object)

gc.set_threshold(20_000, 50, 50)  # as on the command line; this saves 7 % of the time

# Tests run in parallel, and most matrices are small: more threads for linear algebra would only compete.
# numpy reads these variables when it is imported, later; programs started by tests inherit them.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

SLOW = {
    "agreement/test_lens_in_space.py",
    "bench/test_kills.py",
    "bench/test_meters.py",
    "bench/test_wire_runs.py",
    "explore/test_tuning.py",
    "house/test_documents.py",
    "house/test_every_command.py",
    "house/test_examples.py",
    "material/test_fringes.py",
    "studio/test_page.py",
    "studio/test_search.py",
}
"""Files that take 15 s or more. They run first; otherwise the last one would run alone at the end of a parallel run."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: "/".join(item.path.parts[-2:]) not in SLOW)
