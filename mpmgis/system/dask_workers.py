"""Workers of a Dask cluster, with the interface of worker processes.

Anyone who can reach the port of a Dask scheduler can execute code there: on a network or a machine with other users
use TLS (`tls://` addresses, certificates in the configuration of Dask).
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any

from .errors import InputError, one_line
from .optional_libraries import needed_for
from .worker_processes import RETRIES, arrived

if TYPE_CHECKING:
    from distributed import Client


@contextmanager
def dask_client(address: str) -> "Iterator[Client]":
    """Connect to a Dask scheduler for this block.

    Parameters
    ----------
    address : str
        For example ``tcp://host:8786``.

    Yields
    ------
    distributed.Client

    Raises
    ------
    InputError
        No scheduler answers, or Dask's scheduler is not installed.
    """
    with needed_for(f"`dask={address}`", "cluster"):
        from distributed import Client

    _silence_dask()
    try:
        client = Client(address, timeout="5s", set_as_default=False)
    except (OSError, ValueError, TimeoutError, ImportError) as error:
        raise InputError(
            f"`dask={address}`: no scheduler answers there ({one_line(error)[:80]}); start one with: dask scheduler"
        ) from error
    with client:
        yield client


def require_scheduler(address: str | None) -> None:
    """Refuse the address of a Dask cluster where no scheduler answers, before anything is written.

    Parameters
    ----------
    address : str or None
        None for work without a cluster.

    Raises
    ------
    InputError
        As `dask_client`.
    """
    if address is not None:
        with dask_client(address):
            pass


class DaskWorkers:
    """The workers of a Dask cluster, with the interface of `worker_processes.Workers`.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: "Client"):
        self._client = client

    def warm(self, function: Callable, *arguments: Any) -> None:
        """Call `function(*arguments)` in every worker at the same time; errors are ignored, the work repeats them.

        Parameters
        ----------
        function : callable
        *arguments : objects
        """
        futures = [
            self._client.submit(function, *arguments, workers=[address], pure=False)
            for address in self._client.nthreads()
        ]
        for future in futures:
            with suppress(Exception):
                future.result()

    def worked(
        self,
        function: Callable,
        pieces: Sequence,
        look: Callable = lambda: None,
        died: Callable = lambda piece, again: None,
    ) -> Iterator[tuple]:
        """Yield (piece, `function(piece)`) in the order of completion; None for a piece that killed all its workers.

        At most one piece per thread is submitted, so that a dying worker loses no other piece.

        Parameters
        ----------
        function : callable
        pieces : sequence of objects with a `number`
        look : callable () -> None
            Called a few times a second.
        died : callable (piece, again) -> None
            Called when a worker has died; `again` is whether the piece is repeated.

        Raises
        ------
        InputError
            The connection to the cluster is lost, or its workers cannot run this program.
        """
        from distributed import CancelledError, KilledWorker

        waiting, deaths, running, done = list(reversed(pieces)), {}, {}, SimpleQueue()
        try:
            while waiting or running:
                while waiting and len(running) < max(1, sum(self._client.nthreads().values())):
                    piece = waiting.pop()
                    future = self._client.submit(function, piece, pure=False)
                    running[future.key] = future, piece
                    future.add_done_callback(done.put)
                look()
                for future in arrived(done):
                    _, piece = running.pop(future.key)
                    try:
                        yield piece, future.result()
                    except KilledWorker:
                        number = deaths[piece.number] = deaths.get(piece.number, 0) + 1
                        died(piece, number <= RETRIES)
                        if number <= RETRIES:
                            waiting.append(piece)
                        else:
                            yield piece, None
                    except CancelledError as error:
                        raise _gone(error) from error
                    except (ImportError, AttributeError) as error:
                        raise InputError(
                            f"the workers cannot run this program ({one_line(error)[:100]}); install the same version "
                            "of mpmgis there"
                        ) from error
        except OSError as error:
            raise _gone(error) from error
        finally:
            with suppress(Exception):  # the cluster may be gone
                self._client.cancel([future for future, _ in running.values()])


def _gone(error):
    return InputError(
        f"the connection to the Dask cluster is lost ({one_line(error)[:80]}); start again: finished work is kept"
    )


def _silence_dask():
    """Suppress log messages of Dask: mpmgis prints one line."""
    import distributed

    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == distributed.__name__]
    for name in ("tornado", *names):
        logging.getLogger(name).setLevel(logging.CRITICAL)
