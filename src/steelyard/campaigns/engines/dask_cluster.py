"""Workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from typing import Any

from steelyard.campaigns.tasks import Lost, Outcome, TaskT, Work
from steelyard.errors import InputError
from steelyard.processes.heap import give_back, keep_for_reuse

_CONNECT = 10.0
"""How long a scheduler may take to answer [s]."""
_PER_THREAD = 3
"""Tasks under way for each thread of the cluster: workers do not wait for the client, and the
scheduler holds few."""
_FEWEST = 4
"""Tasks under way where the cluster tells no threads yet."""
_ALONE = threading.Lock()
"""Of a worker process: buffers of the compiled equations are shared by its threads."""


@dataclass(frozen=True)
class DaskCluster:
    """The workers that a client of Dask reaches."""

    client: Any
    """:class:`distributed.Client`."""

    def __call__(
        self, work: Work, tasks: Iterable[TaskT]
    ) -> Generator[tuple[TaskT, Outcome | Lost], None, None]:
        """Results as they end. Dask itself does a task again whose worker was killed, three times
        at most.

        Raises:
            InputError: The scheduler is lost.
        """
        from distributed import as_completed

        rest = iter(tasks)
        running: dict[str, tuple[TaskT, Any]] = {}
        ended = as_completed()
        try:
            while True:
                room = max(_FEWEST, _PER_THREAD * sum(self.client.nthreads().values()))
                for task in islice(rest, max(0, room - len(running))):
                    future = self.client.submit(_alone, work, task, pure=False)
                    running[future.key] = (task, future)
                    ended.add(future)
                if not running:
                    return
                future = next(ended)
                task, _ = running.pop(future.key)
                yield task, _outcome(future)
        except (OSError, TimeoutError) as error:
            raise _lost() from error
        finally:
            _cancel(self.client, [future for _, future in running.values()])


def _cancel(client: Any, futures: list[Any]) -> None:
    """Let go of what is under way; of a scheduler that is gone there is nothing to let go."""
    if futures and client.status == "running":
        client.cancel(futures, force=True)


def _outcome(future: Any) -> Outcome | Lost:
    """Of a future that has ended; one whose worker is gone with its result is waited for again.

    Raises:
        InputError: It was cancelled, which Dask does to all of them where the scheduler is lost.
    """
    try:
        found = future.result()
    except CancelledError as error:
        raise _lost() from error
    except Exception as error:
        if future.cancelled():
            raise _lost() from error
        if type(error).__name__ == "KilledWorker":
            return Lost("its workers were killed again and again (out of memory, perhaps)")
        return Lost(f"{type(error).__name__}: {error}")
    return found if isinstance(found, Outcome) else Lost("its worker sent no outcome")


def _lost() -> InputError:
    return InputError(
        "--scheduler: expected a Dask scheduler that answers until the end, found it gone; what was"
        " done is in the table: start the scheduler and the same campaign again to go on"
    )


def _alone(work: Work, task: Any) -> Outcome:
    """One task at a time in a process, whatever the number of its threads."""
    with _ALONE:
        keep_for_reuse()
        try:
            return work(task)
        finally:
            give_back()


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address.

    Args:
        address: ``tcp://HOST:PORT``.

    Raises:
        InputError: Nothing answers there, or Dask is not installed.
    """
    require_dask()
    from distributed import Client

    _silence()
    client = None
    with suppress(OSError, ValueError, TypeError):
        if _is_scheduler(address):
            client = Client(address, timeout=_CONNECT)
    if client is None:
        raise InputError(
            f"--scheduler: expected the address of a Dask scheduler (tcp://HOST:PORT), found"
            f" '{address}', where none answers; check the address, or start one with 'dask"
            " scheduler'"
        )
    try:
        yield client
    finally:
        client.close(timeout=2)


def _is_scheduler(address: str) -> bool:
    """Whether a scheduler answers at an address, asked without a client.

    A client that nobody answered lives on in the thread of its loop, and closes itself whenever it
    is collected. Where that comes within the beginning of another one, both want the same lock of
    Dask, and wait for ever. So none is made before a scheduler has answered.

    Raises:
        OSError: Nothing answers in time.
        ValueError: This is no address.
        TypeError: It is one of a kind that needs certificates or packages.
    """
    from distributed import rpc

    async def asked() -> bool:
        async with rpc(address, timeout=_CONNECT) as there:
            answer = await asyncio.wait_for(there.identity(), _CONNECT)
        return bool(answer.get("type") == "Scheduler")

    # In a thread of its own: a notebook's has a loop that runs.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(lambda: asyncio.run(asked())).result()


def _silence() -> None:
    """No log of connections that Dask loses: the sentence of the verb says it.

    To the end of the process, for that is when Dask lets go of a scheduler that is gone.
    """
    # Those of Dask have levels of their own, each.
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    for name in (*names, "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def require_dask() -> None:
    """Raise InputError unless Dask is installed."""
    if find_spec("distributed") is None:
        raise InputError(
            "--scheduler: expected the package distributed, found it missing; install it with: pip"
            ' install "steelyard[dask]"'
        )
