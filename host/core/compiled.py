"""Functions that are compiled, and how those that a driving machine calls are made ready before.

Numba compiles a function when it is first called with arguments of some types. That takes up to
seconds, and the firmware waits for a command no longer than 250 ms once it is armed. So a function
that Python calls while the machine drives declares the types of its arguments here. `make_ready`
compiles all of these, before anything is armed. From then on they come from numba's cache in
milliseconds, until their code changes (`numba_cache`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, TypeVar, cast

from numba import njit
from numba.core.sigutils import normalize_signature
from numba.core.types import Type

Function = TypeVar("Function", bound=Callable[..., Any])
Types = str | tuple[Type, ...]
"""Of a function's arguments: as numba's reference writes them, such as "(f8[:, ::1], i8)", or as
objects where one of them has no name there."""

_declared: Final[list[tuple[Any, Types]]] = []


def compiled(*types: Types, boundscheck: bool | None = None) -> Callable[[Function], Function]:
    """Compiles a function, which is called from Python with arguments of these types while the
    machine drives. A part of a picture is contiguous where it is as wide as the picture, and
    another type where not. `boundscheck`: as numba has it."""

    def made(function: Function) -> Function:
        found = njit(cache=True, nogil=True, boundscheck=boundscheck)(function)
        _declared.extend((found, each) for each in types)
        return cast(Function, found)

    return made


def make_ready() -> Iterator[tuple[int, int, str]]:
    """Compiles what the modules that are loaded by now have declared, one by one. Before each: how
    many are done, how many there are, and its name."""
    for done, (function, types) in enumerate(_declared):
        yield done, len(_declared), function.py_func.__name__
        # With types as an object: numba's cache takes a text for another key.
        function.compile(normalize_signature(types)[0])  # type: ignore[no-untyped-call]
