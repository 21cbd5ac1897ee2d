"""Work spread over processes of this machine, or over a Dask cluster."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from host.core.errors import UserError

ANSWER_S = 10.0
"""Within which a scheduler answers."""

Item = TypeVar("Item")


Result = TypeVar("Result")


@contextmanager
def client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A Dask client: of the scheduler at an address, or of as many processes on this machine."""
    import distributed  # noqa: PLC0415 (takes a second to import)

    if scheduler is not None:
        try:
            pool = distributed.Client(scheduler, timeout=ANSWER_S)  # type: ignore[no-untyped-call]
        except (OSError, ValueError, TimeoutError) as error:
            raise UserError(
                f"no Dask scheduler answers at {scheduler}: start one with `dask scheduler` and "
                "workers with `dask worker ADDRESS --nthreads 1`"
            ) from error
        with pool:
            yield pool
        return
    local = Path(tempfile.gettempdir()) / f"daranti-dask-{os.getuid()}"
    with (
        _quiet(),
        distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            local_directory=str(local),
            silence_logs="ERROR",
        ) as cluster,
        distributed.Client(cluster) as pool,  # type: ignore[no-untyped-call]
    ):
        yield pool


@contextmanager
def _quiet() -> Iterator[None]:
    """Two campaigns at a time are none of the operator's worries: each finds ports of its own."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Port .* is already in use")
        yield


def spread(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int = 2,
    scheduler: str | None = None,
) -> Iterator[tuple[Item, Result]]:
    """`function` of every item, as they finish, each in a process of its own kind. What a function
    raises is raised here; a worker that dies gets its item replaced by another."""
    if not items:
        return
    if workers == 1 and scheduler is None:
        for item in items:
            yield item, function(item)
        return
    import distributed  # noqa: PLC0415

    with client(workers, scheduler) as pool:
        futures = {pool.submit(function, item, pure=False): item for item in items}
        done = distributed.as_completed(list(futures))  # type: ignore[no-untyped-call]
        for future in done:
            yield futures[future], future.result()
            future.release()
