"""Workers of a Dask cluster.

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
from .worker_processes import WorkerPool, arrived

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


class DaskWorkers(WorkerPool):
    """The workers of a Dask cluster; each has one piece of work per thread.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: "Client"):
        self._client, self._running, self._done = client, {}, SimpleQueue()

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
        """Do pieces of work, see `WorkerPool.worked`.

        Parameters
        ----------
        function : callable
        pieces : sequence of objects with a `number`
        look : callable () -> None
        died : callable (piece, again) -> None

        Raises
        ------
        InputError
            The connection to the cluster is lost, or its workers cannot run this program.
        """
        try:
            yield from super().worked(function, pieces, look, died)
        except OSError as error:
            raise _gone(error) from error
        finally:
            with suppress(Exception):  # the cluster may be gone
                self._client.cancel([*self._running.values()])

    def _has_room(self, running):
        return running < max(1, sum(self._client.nthreads().values()))

    def _begin(self, function, piece):
        future = self._client.submit(function, piece, pure=False)
        self._running[future.key] = future
        future.add_done_callback(self._done.put)
        return future.key

    def _ended(self):
        from distributed import CancelledError, KilledWorker

        for future in arrived(self._done):
            del self._running[future.key]
            try:
                value = (future.result(),)
            except KilledWorker:
                value = None
            except CancelledError as error:
                raise _gone(error) from error
            except (ImportError, AttributeError) as error:
                raise InputError(
                    f"the workers cannot run this program ({one_line(error)[:100]}); install the same version of "
                    "mpmgis there"
                ) from error
            yield future.key, value


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
