"""Settings of hypothesis for tests of random scenes."""

from __future__ import annotations

import os
from typing import Any

from hypothesis import HealthCheck

#: Number of mutated scenes, where the environment asks for more than the suite has, each time from another seed.
MANY = int(os.environ.get("CABLEPOD_FUZZ", "0"))
COMMON: dict[str, Any] = {
    "deadline": None,  # a first example compiles; hangs are seen by their own clock
    "database": None,
    "derandomize": not MANY,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
}
