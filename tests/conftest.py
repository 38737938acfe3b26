"""Settings of all tests."""

import functools
import gc
import os

import docstring_parser
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("solen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("solen")  # a busy machine is no fault of what is tested

# Help and completion parse the source of pydantic's base class anew for every options class; once is enough here.
docstring_parser.parse_from_object = functools.cache(docstring_parser.parse_from_object)

gc.set_threshold(20_000, 50, 50)  # as the command line does: a fourteenth of all time

# Tests run side by side, and most matrices are small: threads of the linear algebra would only wait for one another.
# numpy reads this when it is imported, which happens later; programs that tests start inherit it.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

LONG = {
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
"""Files of 15 s and more. They come first: side by side, the last one would otherwise run alone."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: "/".join(item.path.parts[-2:]) not in LONG)
