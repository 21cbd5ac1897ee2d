"""Of all tests: how long an example takes says nothing about whether a fact holds."""

from hypothesis import settings

settings.register_profile("daranti", deadline=None)
settings.load_profile("daranti")
