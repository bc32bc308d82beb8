"""How long the fuzzers run: FUZZ_EXAMPLES inputs for each test, a few by default.

``make fuzz EXAMPLES=10000`` sets it. Tests take `settings.get_profile("fuzz")`.
"""

import os

from hypothesis import HealthCheck, Phase, settings

settings.register_profile(
    "fuzz",
    max_examples=int(os.environ.get("FUZZ_EXAMPLES", "15")),
    derandomize="FUZZ_EXAMPLES" not in os.environ,  # a run of the suite depends on no luck
    # Inputs are small, and making them smaller would run a slow failure a thousand times.
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
    deadline=None,  # the first call of a kernel may compile it
    suppress_health_check=list(HealthCheck),
)
