"""Compiled code is cached as long as nothing changes that went into it.

Numba compiles the constants that a function names, and the functions that it calls, into it. Its
own rule looks at the file of the cached function alone: after a change in another file the old
code would go on running, silently. Host, plant and bench name `locator.ByImports` instead.
"""

from __future__ import annotations

import os
import sys
from typing import Final

LOCATOR: Final = f"{__name__}.locator.ByImports"


def follow_imports() -> None:
    """Has numba keep compiled code by the content of all files that went into it. To be called
    before the first function is compiled; numba itself is not loaded."""
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = LOCATOR
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_LOCATOR_CLASSES = LOCATOR
