"""Sources that come and go: a feed runs one in a thread, keeps what is newest, and reconnects.

The pilot is given what is newest. Where a source falls silent nothing is given, the pilot sees its
picture age and stops by itself; here it is only reported and connected again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from host.core.terminal import plain

T = TypeVar("T")

RETRY_S = 0.5
"""Before a lost source is tried again."""
SILENCE_S = 3.0
"""After which a source that is connected and gives nothing counts as lost."""


MOST_WORDS = 200
"""Characters of a reason: what a server says may have thousands."""


class SourceLostError(Exception):
    """A source ended or cannot be reached; `final` where connecting again is pointless."""

    def __init__(self, reason: str, *, final: bool = False) -> None:
        super().__init__(plain(reason[:MOST_WORDS]))
        self.final = final


class Feed(Generic[T]):
    """Runs a source in a daemon thread, keeps its newest item, and connects again when it is lost.

    `source(feed)` yields items until it raises SourceLostError; it looks at `stopping` at least
    every `silence_s`. `report` gets one line whenever the source is lost and when it is back; it is
    called in the feed's thread.
    """

    def __init__(
        self,
        name: str,
        source: Callable[[Feed[T]], Iterator[T]],
        clock: Callable[[], float],
        report: Callable[[str], None],
        *,
        retry_s: float = RETRY_S,
        silence_s: float = SILENCE_S,
    ) -> None:
        self.name = name
        self.clock = clock
        self.silence_s = silence_s
        self.retry_s = retry_s
        self.problem: str | None = "not connected yet"
        """Why nothing comes at present, None while it does."""
        self.count = 0
        self.latest: T | None = None
        """The newest item, whether it was taken or not."""
        self._source = source
        self._report = report
        self._changed = threading.Condition()
        self._item: T | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def stopping(self) -> bool:
        """The source should return."""
        return self._stop.is_set()

    def pause(self, seconds: float) -> None:
        """Waits in the source's thread; ends at once when the feed is closed."""
        self._stop.wait(seconds)

    def doubt(self, reason: str) -> None:
        """Says why nothing comes of a source that is connected and speaks; the next item takes it
        back. Called in the source's thread."""
        self._lost(plain(reason))

    def start(self) -> None:
        """Connects, in the feed's own thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; waits for it briefly (a read in progress has its own timeout)."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(2 * self.silence_s)

    def take(self) -> T | None:
        """The newest item, once; None when nothing has come since."""
        with self._changed:
            item, self._item = self._item, None
            return item

    def wait(self, timeout_s: float) -> bool:
        """Waits until an item is there to be taken; False when none came in time, or the source is
        lost for good."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None or self.stopping, timeout_s)
            return self._item is not None

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                for item in self._source(self):
                    self._put(item)
                    if self._stop.is_set():
                        return
            except SourceLostError as lost:
                if self._stop.is_set():
                    return
                self._lost(str(lost))
                if lost.final:
                    with self._changed:
                        self._stop.set()
                        self._changed.notify_all()
            except Exception as error:  # a thread must not die unseen
                self._lost(f"internal error: {type(error).__name__}: {error}")
            self._stop.wait(self.retry_s)

    def _put(self, item: T) -> None:
        with self._changed:
            self._item = self.latest = item
            self.count += 1
            self._changed.notify_all()
        if self.problem is not None:
            if self.count > 1:
                self._report(f"{self.name} is back")
            self.problem = None

    def _lost(self, reason: str) -> None:
        if self.problem != reason:
            self._report(f"{self.name} lost: {reason}")
        self.problem = reason
