"""What is done once, before a board may be armed: all that drives is compiled."""

from __future__ import annotations

# Loaded for what they declare: whatever a pilot and its eyes call.
import host.pilot.pilot
import host.vision.watched  # noqa: F401
from host.core import compiled
from host.core.progress import Watch

FIRST: str = "preparing vision and navigation, once on this computer"


def make_ready(watch: Watch | None = None) -> None:
    """Compiles, or loads what was compiled before: about half a minute of one core the first time
    and after an update, less than a second from then on."""
    for done, of, name in compiled.make_ready():
        if watch is not None:
            watch.reach(done / of, name)


def make_ready_visibly() -> None:
    """The same with a bar, or a line now and then."""
    with Watch(FIRST, 1.0) as watch:
        make_ready(watch)
