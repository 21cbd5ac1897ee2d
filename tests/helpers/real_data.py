"""Real photographs and tracks, which are no part of the project."""

from __future__ import annotations

from pathlib import Path

import pytest

from host.vision.photo.comparison import data_folder


def real(path: str) -> Path:
    """A file or folder of the real data. Skips the test, saying where it looked, where it is not
    there."""
    found = data_folder() / path
    if not found.exists():
        pytest.skip(f"no real data at {found.absolute()} (DARANTI_DATA names the folder)")
    return found
