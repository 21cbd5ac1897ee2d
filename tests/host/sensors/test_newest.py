"""Facts about feeds: newest only, once each, and no silent death."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator

from host.sensors.newest import Feed, SourceLostError

LIMIT_S = 10.0


def no_clock() -> float:
    return 0.0


def running(feed: Feed[int]) -> bool:
    """Whether its thread, which bears its name, still lives."""
    return any(thread.name == feed.name for thread in threading.enumerate())


def test_only_the_newest_item_is_kept_and_it_is_given_once() -> None:
    given = threading.Event()

    def source(_feed: Feed[int]) -> Iterator[int]:
        yield from (1, 2, 3)
        given.set()
        raise SourceLostError("end", final=True)

    feed = Feed("numbers", source, no_clock, lambda _: None)
    feed.start()
    assert given.wait(LIMIT_S)
    assert feed.wait(0.0)
    assert feed.take() == 3
    assert feed.take() is None
    assert not feed.wait(LIMIT_S), "a source that ended for good is not waited for"


def test_a_programming_error_in_a_source_is_reported_and_survived() -> None:
    reports: list[str] = []
    tries = iter((ValueError("broken"), None))

    def source(feed: Feed[int]) -> Iterator[int]:
        error = next(tries)
        if error:
            raise error
        yield 7
        feed.pause(LIMIT_S)

    feed = Feed("numbers", source, no_clock, reports.append, retry_s=0.0)
    feed.start()
    assert feed.wait(LIMIT_S)
    assert reports == ["numbers lost: internal error: ValueError: broken"]
    feed.close()


def test_closing_ends_a_source_that_pauses() -> None:
    entered = threading.Event()

    def source(feed: Feed[int]) -> Iterator[int]:
        entered.set()
        while not feed.stopping:
            feed.pause(LIMIT_S)
        yield 1

    feed = Feed("numbers", source, no_clock, lambda _: None)
    feed.start()
    assert entered.wait(LIMIT_S)
    feed.close()
    assert not running(feed)


def test_what_stays_lost_is_reported_once() -> None:
    reports: list[str] = []
    tries = itertools.count()
    enough = threading.Event()

    def source(_feed: Feed[int]) -> Iterator[int]:
        if next(tries) == 5:
            enough.set()
        raise SourceLostError("nobody answers")
        yield 0

    feed = Feed("numbers", source, no_clock, reports.append, retry_s=0.0)
    feed.start()
    assert enough.wait(LIMIT_S)
    feed.close()
    assert reports == ["numbers lost: nobody answers"]


def test_closing_ends_a_source_that_always_has_more() -> None:
    feed = Feed("numbers", lambda _feed: itertools.count(), no_clock, lambda _: None)
    feed.start()
    assert feed.wait(LIMIT_S)
    feed.close()
    assert not running(feed)
