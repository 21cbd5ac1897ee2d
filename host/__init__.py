"""The program that drives the machine in the field."""

from numba_cache import follow_imports

follow_imports()
