"""What is known of a machine that stands still before its run: a few positions and pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from host.core.messages import Fix
from host.core.vehicle import Mount
from host.runs.drive import PERIOD_S, fitted
from host.sensors.camera_stream import Picture
from host.sensors.jpeg import Bgr, JpegDecoder
from host.sensors.newest import Feed
from host.vision.view import CropView
from host.vision.watched import WatchedDetector

FIXES: Final = (3, 4.0)
"""Positions that tell where it stands, and how long they are waited for (s)."""
PICTURES: Final = (4, 3.0)
"""Likewise."""

Wait = Callable[[float], object]
"""Lets so many seconds pass; the board is listened to meanwhile."""


def some_fixes(feed: Feed[Fix] | None, wait: Wait, clock: Callable[[], float]) -> list[Fix]:
    """The next positions."""
    count, patience_s = FIXES
    found: list[Fix] = []
    end = clock() + patience_s
    while feed is not None and len(found) < count and clock() < end:
        wait(PERIOD_S)
        fix = feed.take()
        if fix is not None:
            found.append(fix)
    return found


def look(
    feed: Feed[Picture],
    eye: WatchedDetector,
    mount: Mount,
    wait: Wait,
    clock: Callable[[], float],
) -> tuple[CropView | None, Bgr | None]:
    """What a new detector makes of the next pictures, and the last of them; None where none
    comes."""
    decoder, view, bgr = JpegDecoder(), None, None
    count, patience_s = PICTURES
    end = clock() + patience_s
    while count > 0 and clock() < end:
        wait(PERIOD_S)
        picture = feed.take()
        if picture is not None:
            frame = fitted(picture, decoder, mount, 0.0)
            view = eye.see(frame.bgr)
            bgr = frame.bgr if frame.bgr.size else bgr
            count -= 1
    return view, bgr
