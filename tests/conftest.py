"""Settings of all tests."""

import functools

import docstring_parser
from hypothesis import HealthCheck, settings

settings.register_profile("solen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("solen")  # a busy machine is no fault of what is tested

# Help and completion parse the source of pydantic's base class anew for every options class; once is enough here.
docstring_parser.parse_from_object = functools.cache(docstring_parser.parse_from_object)
