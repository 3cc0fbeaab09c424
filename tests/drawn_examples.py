"""How many examples hypothesis draws: 20 a test, and 200 with ``--release all``; never a limit of wall time.

The same code draws the same examples; to look for others, ``HYPOTHESIS_PROFILE=search``.
"""

import os
from unittest import mock

from hypothesis import settings

EXAMPLES, MANY = 20, 200


def load_profile(many: bool) -> None:
    """Let tests that are imported from now on draw `MANY` examples or `EXAMPLES`."""
    # Hypothesis also draws constants of the modules that are loaded, which hangs on the order of tests.
    mock.patch("hypothesis.internal.conjecture.providers.is_local_module_file", return_value=False).start()
    count = MANY if many else EXAMPLES
    settings.register_profile("same", derandomize=True, deadline=None, max_examples=count)
    settings.register_profile("search", derandomize=False, deadline=None, max_examples=MANY)
    settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


def few_examples(count: int) -> settings:
    """Draw `count` examples where others draw `EXAMPLES`, ten times as many for a release: each is dear."""
    return settings(max_examples=count * settings().max_examples // EXAMPLES)
