"""Number of fuzzed inputs: FUZZ_EXAMPLES for each test, a few by default.

``make fuzz EXAMPLES=10000`` sets it. Tests take `settings.get_profile("fuzz")`.
"""

import os

from hypothesis import HealthCheck, Phase, settings

settings.register_profile(
    "fuzz",
    max_examples=int(os.environ.get("FUZZ_EXAMPLES", "15")),
    derandomize="FUZZ_EXAMPLES" not in os.environ,  # results of the suite do not depend on chance
    # Inputs are small, and shrinking them would repeat a slow failure a thousand times.
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
    deadline=None,  # the first call of a kernel may compile it
    suppress_health_check=list(HealthCheck),
)
