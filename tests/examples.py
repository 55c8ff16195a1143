"""Random examples: how many, and how they are drawn.

As they come, so that each run looks elsewhere; alike each time with ``HYPOTHESIS_PROFILE=derandomized`` (as `.ci/run`
has it, so that it fails for what was changed and for nothing else). A long random look, to be taken now and then:

    THERMOCORR_EXAMPLES=50 python -m pytest tests/test_online.py tests/test_averages.py tests/test_lags.py
"""

import os

from hypothesis import settings

settings.register_profile("derandomized", derandomize=True, database=None, deadline=None)


def examples(count):
    """So many examples, times ``THERMOCORR_EXAMPLES``, without a limit on their time."""
    return settings(max_examples=count * int(os.environ.get("THERMOCORR_EXAMPLES", "1")), deadline=None)
