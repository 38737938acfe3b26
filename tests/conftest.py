"""Settings of all tests."""

from hypothesis import HealthCheck, settings

settings.register_profile("solen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("solen")  # a busy machine is no fault of what is tested
