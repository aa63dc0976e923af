"""Run the tasks of a plan on workers, each with a record on disk: a second start runs those without a record.

A plan is a list of tasks. The digest of a task covers all inputs of its result, so that equal digests are one run.
"""

import hashlib
import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from .. import __version__
from ..frames.headline_numbers import error_tags, error_words
from ..simulation.cost_prediction import duration_words
from ..simulation.memory_need import MEMORY_SHARE
from ..simulation.scene_run import ASK_SECONDS
from ..system import operating_system
from ..system.dask_workers import DaskWorkers, dask_client, require_scheduler
from ..system.errors import InputError, SceneError, UnphysicalError, one_line
from ..system.memory import available_memory
from ..system.messages import log
from ..system.worker_processes import WorkerPool, started
from .ensemble_member import warm_worker, warmed

if TYPE_CHECKING:
    from ..frames.many_runs_folder import RunFiles
    from ..simulation.preparation import Prepared
    from .ensemble_member import MemberTask

DIGEST_LENGTH = 16  # [hexadecimal digits] of a run, also in the names of its files
LOST = {"status": "lost", "reason": "its worker process died each time"}  # record of a run, not on disk


class Task(Protocol):
    """One run of a plan, with all data that a worker needs; it is pickled."""

    @property
    def number(self) -> int:
        """Number in the plan, from 1."""
        ...

    @property
    def digest(self) -> str:
        """Digest of all inputs of its result."""
        ...

    @property
    def files(self) -> "RunFiles":
        """Paths of its files."""
        ...

    @property
    def companion(self) -> bool:
        """Its numerical error is that of all runs."""
        ...

    def record(self) -> dict | None:
        """Return the record of its finished run; None without one, or where wanted results are missing."""
        ...

    def result(self, look: Callable) -> dict:
        """Run, write the results and return their record.

        Parameters
        ----------
        look : callable
            Called a few times a second.

        Raises
        ------
        UnphysicalError, InputError
            No result: this is recorded.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class ManyRunsFound:
    """Results of many runs.

    Parameters
    ----------
    folder : Path
    files : tuple of Path
        The QGIS project first.
    statuses : dict of str to int
        Number of runs by status.
    before : int
        Number of runs that were finished earlier.
    start_seconds, run_seconds, map_seconds : float [s]
        Wall time until the workers were ready, until all runs were done, and of the maps.
    member_seconds : float [s]
        Sum of the wall times of the runs of this start.
    companion : dict or None
        Numerical errors of one run, and which run it is (`of`).
    """

    folder: Path
    files: tuple
    statuses: dict
    before: int
    start_seconds: float
    run_seconds: float
    map_seconds: float
    member_seconds: float
    companion: dict | None = None


def digest_of(inputs: Any) -> str:
    """Return the digest of values that JSON can hold.

    Parameters
    ----------
    inputs : object

    Returns
    -------
    str
    """
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:DIGEST_LENGTH]


def recorded(task: Task, look: Callable = lambda *state: None) -> dict:
    """Run a task unless it is finished; write and return its record.

    Parameters
    ----------
    task : Task
    look : callable
        Called a few times a second.

    Returns
    -------
    dict
    """
    done = task.record()
    if done is not None:
        return done
    began, used = time.perf_counter(), time.process_time()
    try:
        record = task.result(look)
    except UnphysicalError as error:
        record = {"status": "unphysical", "reason": one_line(error)}
    except InputError as error:
        record = {"status": "refused", "reason": one_line(error)}
    record |= {
        "digest": task.digest,
        "wall_seconds": time.perf_counter() - began,
        "processor_seconds": time.process_time() - used,
        "version": __version__,
    }
    task.files.write(record)
    return record


class ManyRuns:
    """The runs of a plan: records of those that have ended, and tasks of the others.

    Parameters
    ----------
    tasks : sequence of Task
    word : str
        What a run is: "member" or "area".
    workers : int or None
        Number of processes; None: one for each core.
    dask : str or None
        Address of the scheduler of a Dask cluster, in place of processes.
    reference : str
        What the run with the numerical error is, after its number.
    """

    def __init__(self, tasks: Sequence[Task], word: str, workers: int | None, dask: str | None, reference: str = ""):
        self.tasks, self.word, self.dask, self.reference = list(tasks), word, dask, reference
        found = {task.digest: task.record() for task in self.tasks}
        self.records = {digest: record for digest, record in found.items() if record is not None}
        self.before = sum(task.digest in self.records for task in self.tasks)
        self.to_run = list({task.digest: task for task in self.tasks if task.digest not in self.records}.values())
        self.workers = min(workers or operating_system.cores(), max(1, len(self.to_run)))
        if self.before:
            log.info(f"{self.before} of {len(self.tasks)} {word}s are already finished")

    def require_affordable(self, cost: Callable, confirm: Callable[[str], bool]) -> None:
        """Log the predicted cost of the runs; ask before runs of more than an hour or of most of the memory.

        Parameters
        ----------
        cost : callable
            Tasks -> (seconds of all in sequence, bytes of one).
        confirm : callable
            Question -> whether to start them.

        Raises
        ------
        SceneError
            The answer is no.
        InputError
            No Dask scheduler answers.
        """
        if not self.to_run:
            return
        seconds, memory = cost(self.to_run)
        at_once = "" if self.dask else f" on {self.workers} worker{'s' if self.workers > 1 else ''}"
        seconds, memory = (seconds, 0.0) if self.dask else (seconds / self.workers, memory * self.workers)
        need = f"{duration_words(seconds)}{at_once}" + (f" and {memory / 1e9:.2g} GB" if memory else " in all")
        count = len(self.to_run)
        log.info(f"{count} run{'s' if count != 1 else ''}, predicted: {need}")
        long = seconds > ASK_SECONDS or not memory < MEMORY_SHARE * available_memory()
        if long and not confirm(f"these {count} runs are predicted to take {need}"):
            raise SceneError(
                f"{count} runs are predicted to take {need}; give `yes` to run them, or fewer `samples`, fewer "
                "`workers` or larger cells"
            )
        require_scheduler(self.dask)

    def run(
        self,
        models: "Iterable[tuple[MemberTask, Prepared]]" = (),
        look: Callable = lambda *state: None,
        ended: Callable = lambda task, record: None,
    ) -> tuple[float, float]:
        """Run all tasks without a record; afterwards every task has one.

        Parameters
        ----------
        models : iterable of (MemberTask, Prepared)
            Runs whose kernels are compiled in this process and loaded in every worker, before the first task.
        look : callable
            Called with (runs that have ended, all runs, those without result) a few times a second.
        ended : callable
            Called with each task and its record.

        Returns
        -------
        start_seconds, run_seconds : float [s]
            Wall time until the workers were ready, and of the runs.
        """
        if not self.to_run:
            return 0.0, 0.0
        began, total, models = time.perf_counter(), len(self.records) + len(self.to_run), list(models)

        def looked(*state):
            left_out = sum(record["status"] != "finished" for record in self.records.values())
            look(len(self.records), total, left_out)

        for task, prepared in models:
            warmed(task, prepared)
        with ExitStack() as stack:
            pool = self._pool(stack)
            if pool is not None:
                pool.warm(warm_worker, [task for task, _ in models])
            ready = time.perf_counter()
            for task, record in self._done_by(pool, looked):
                self.records[task.digest] = record or LOST
                looked()
                ended(task, self.records[task.digest])
            return ready - began, time.perf_counter() - ready

    def _pool(self, stack: ExitStack) -> WorkerPool | None:
        """Return workers that end with `stack`; None: everything runs in this process."""
        if self.dask is not None:
            return DaskWorkers(stack.enter_context(dask_client(self.dask)))
        return stack.enter_context(started(self.workers)) if self.workers > 1 else None

    def _done_by(self, pool, look):
        """Yield each task with its record when it has ended, None if its worker died each time."""
        if pool is None:
            return ((task, recorded(task, look)) for task in self.to_run)

        def died(task, again):
            what = "it is run again" if again else "given up after 3 times"
            log.info(f"the worker of {self.word} {task.number} died; {what}")

        return pool.worked(recorded, self.to_run, look, died)

    def record(self, task: Task) -> dict:
        """Return the record of a task after `run`.

        Parameters
        ----------
        task : Task

        Returns
        -------
        dict
        """
        return self.records[task.digest]

    @property
    def in_order(self) -> list[dict]:
        """Records of all tasks in the order of the plan, after `run`."""
        return [self.record(task) for task in self.tasks]

    @property
    def finished(self) -> list[Task]:
        """Tasks with a result."""
        return [task for task in self.tasks if self.record(task)["status"] == "finished"]

    @property
    def statuses(self) -> dict[str, int]:
        """Number of runs by status."""
        return dict(Counter(record["status"] for record in self.in_order))

    def spent(self, name: str) -> float:
        """Return the sum of an entry of the records over the tasks of this start.

        Parameters
        ----------
        name : str

        Returns
        -------
        float [s]
        """
        return sum(self.record(task).get(name, 0.0) for task in self.to_run)

    @property
    def companion(self) -> dict | None:
        """Numerical errors of the run that has them, and which run it is (`of`); None without."""
        task = next((task for task in self.tasks if task.companion), None)
        found = self.record(task).get("companion") if task else None
        return found and found | {"of": f"{self.word} {task.number}{self.reference}"}

    def tags(self, digest: str, min_depth: float) -> dict:
        """Return the tags of maps of all runs: version, digest, least depth, numerical errors.

        Parameters
        ----------
        digest : str
        min_depth : float [m]

        Returns
        -------
        dict
        """
        errors = error_words(self.companion)
        tags = {"version": __version__, "digest": digest, "min_depth": min_depth}
        return tags | error_tags(errors)

    def log_moving(self) -> int:
        """Log how many runs with a result did not come to rest, and return their number.

        Returns
        -------
        int
        """
        finished = self.finished
        moving = sum(not self.record(task)["came_to_rest"] for task in finished)
        if moving:
            log.info(
                f"{moving} of {len(finished)} {self.word}s did not come to rest (`came_to_rest` in the table): their "
                "runout can grow, and their last step is no deposit; use a later [output] end_time"
            )
        return moving
