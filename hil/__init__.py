"""The bench: firmware in the loop, scenarios, the judge, studies and reports."""

from numba_cache import follow_imports

follow_imports()
