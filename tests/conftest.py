"""What holds for every test: seeded examples and no display."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

os.environ["MPLBACKEND"] = "Agg"

# Examples are derived from each test's source, so that a run repeats; deadlines would measure the machine.
settings.register_profile(
    "default", derandomize=True, deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("thorough", parent=settings.get_profile("default"), max_examples=250)
settings.load_profile(os.environ.get("PARAOPT_TEST_PROFILE", "default"))
