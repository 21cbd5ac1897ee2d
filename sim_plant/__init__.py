"""The world that the machine meets: machine, field, camera picture, positions, phone."""

from numba_cache import follow_imports

follow_imports()
