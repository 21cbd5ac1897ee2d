"""Of all tests: how long an example takes says nothing about whether a fact holds.

The examples of `make test` are the same in every run, so that a change is judged by what it
changed. HYPOTHESIS_PROFILE=explore draws new ones, as `make test-long` does.
"""

import os

from hypothesis import settings

settings.register_profile("daranti", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "daranti"))
