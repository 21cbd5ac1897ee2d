"""Compiles `render.cpp` on this machine for this machine, and loads it.

The library lies beside numba's compiled code, under a name that follows from its source, how it is
compiled, and the processor's features. So whatever of these changes compiles anew (three seconds).
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from numba import config

SOURCE: Final = Path(__file__).with_name("render.cpp")
FLAGS: Final = (
    "-std=c++17",
    "-O3",
    "-march=native",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-strict-aliasing",
    # A picture has the same bits on every processor: nothing is contracted or reassociated.
    "-ffp-contract=off",
    "-shared",
    "-fPIC",
    *(
        # To gather from a table takes longer than to look its entries up one by one.
        (
            "-mprefer-vector-width=512",
            "-mtune-ctrl=^use_gather,^use_gather_2parts,^use_gather_4parts",
        )
        if platform.machine() == "x86_64"
        else ()
    ),
)


def _processor() -> str:
    """What the compiler's code for this processor must not be shared beyond."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return platform.machine() + features


def compile_into(folder: Path, source: Path = SOURCE) -> Path:
    """The library in a folder, compiled where it is not there. RuntimeError where that fails."""
    made_of = hashlib.sha256("\0".join((_processor(), *FLAGS)).encode())
    made_of.update(source.read_bytes())
    library = folder / f"render-{made_of.hexdigest()[:16]}.so"
    if library.exists():
        return library
    compiler = os.environ.get("CXX") or shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        raise RuntimeError("the camera's pictures need a C++ compiler: apt-get install g++")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as room:
        fresh = Path(room) / library.name
        done = subprocess.run(
            [*compiler.split(), *FLAGS, "-o", str(fresh), str(source)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise RuntimeError(f"{compiler} cannot compile {source}:\n{done.stderr[-2000:]}")
        # Whoever else compiles it meanwhile makes the same.
        fresh.replace(library)
    return library


@functools.cache
def library() -> ctypes.CDLL:
    """The compiled kernels. A call releases the interpreter's lock."""
    folder = Path(config.CACHE_DIR or SOURCE.parent / "__pycache__")  # type: ignore[attr-defined]
    try:
        path = compile_into(folder)
    except OSError:
        # A read-only installation.
        path = compile_into(Path(tempfile.mkdtemp(prefix="daranti-")))
    return ctypes.CDLL(str(path))
