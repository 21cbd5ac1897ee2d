"""A phone that always shows the same picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from host.sensors.camera_stream import Picture
from host.sensors.newest import Feed


def always(jpeg: bytes) -> Callable[..., Feed[Picture]]:
    """What makes a camera's feed, as `camera_feed` does, of this one picture."""

    def source(feed: Feed[Picture]) -> Iterator[Picture]:
        while not feed.stopping:
            yield Picture(feed.clock(), jpeg)
            feed.pause(0.05)

    def made(_url: str, clock: Callable[[], float], report: Callable[[str], None]) -> Feed[Picture]:
        return Feed("camera", source, clock, report)

    return made
