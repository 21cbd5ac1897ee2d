"""What is done once, before a board may be armed, so that no step takes long: all that drives is
compiled, and what is loaded is no more looked through for garbage."""

from __future__ import annotations

import gc

# Loaded for what they declare: whatever a pilot and its eyes call.
import host.pilot.pilot
import host.vision.watched  # noqa: F401
from host.core import compiled
from host.core.progress import Watch


def make_ready(watch: Watch | None = None) -> None:
    """Compiles, or loads what was compiled before: about half a minute of one core the first time
    and after an update, less than a second from then on. A collection of Python's garbage that
    looks through all modules takes 0.1 s, and on a slow laptop longer than the 250 ms for which
    the firmware waits."""
    for done, of, name in compiled.make_ready():
        if watch is not None:
            watch.reach(done / of, name)
    gc.collect()
    gc.freeze()


def make_ready_visibly() -> None:
    """The same with a bar, or a line now and then."""
    with Watch("preparing vision and navigation", 1.0) as watch:
        make_ready(watch)
