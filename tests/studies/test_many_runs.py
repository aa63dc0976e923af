"""The engine of many runs with trivial jobs: records, second starts, kills, interrupted writes, lost workers."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpmgis.frames.many_runs_folder import RunFiles
from mpmgis.studies.many_runs import LOST, ManyRuns, digest_of, recorded
from mpmgis.system.errors import InputError, SceneError, UnphysicalError
from mpmgis.system.messages import collected


@dataclass(frozen=True)
class Job:
    """Writes its number; other jobs become unphysical, are refused, kill their process, or stop half-way."""

    number: int
    folder: str
    what: str = "fine"

    @property
    def digest(self):
        return digest_of([self.number])

    @property
    def files(self):
        return RunFiles(Path(self.folder), self.digest)

    @property
    def needed(self):
        return (self.files.maxima,)

    def result(self, look):
        look()
        if self.what == "unphysical":
            raise UnphysicalError("step 3")
        if self.what == "refused":
            raise InputError("no such file")
        with open(Path(self.folder) / "log", "a") as log:
            log.write(f"{self.number} ")
        if self.what == "deadly":
            os.kill(os.getpid(), signal.SIGKILL)
        self.files.maxima.write_text(str(self.number))
        if self.what == "half-way":
            raise KeyboardInterrupt
        if self.what == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        return {"status": "finished", "reason": "done", "came_to_rest": self.number % 2}


def jobs(folder, count=4, **what):
    """Jobs 1 to `count`, some of them of another kind: `_3="deadly"`."""
    return [Job(number, str(folder), what.get(f"_{number}", "fine")) for number in range(1, count + 1)]


def ended(tasks, workers=1, **options):
    """ManyRuns whose tasks have been run."""
    runs = ManyRuns(tasks, "member", workers, None)
    runs.run(**options)
    return runs


def done_in(folder):
    """Numbers of the jobs that were run, in order of their start."""
    log = Path(folder) / "log"
    return [int(word) for word in log.read_text().split()] if log.exists() else []


def results(folder):
    return {path.name: path.read_bytes() for path in Path(folder).glob("*_max.tif")}


def test_every_task_is_run_once_and_a_second_start_runs_nothing(tmp_path):
    states = []
    runs = ended(jobs(tmp_path), look=lambda *state: states.append(state))
    assert runs.statuses == {"finished": 4} and runs.before == 0 and done_in(tmp_path) == [1, 2, 3, 4]
    assert states[0] == (0, 4, 0) and states[-1] == (4, 4, 0)
    with collected() as said:
        again = ended(jobs(tmp_path))
    assert again.before == 4 and again.to_run == [] and again.records == runs.records
    assert said == ["4 of 4 members are already finished"] and done_in(tmp_path) == [1, 2, 3, 4]


def test_tasks_with_one_digest_are_one_run(tmp_path):
    runs = ended([*jobs(tmp_path, 2), Job(1, str(tmp_path))])
    assert runs.statuses == {"finished": 3} and done_in(tmp_path) == [1, 2]


def test_processes_give_the_same_as_one(tmp_path):
    for name, workers in (("one", 1), ("two", 2)):
        (tmp_path / name).mkdir()
        assert ended(jobs(tmp_path / name, 5), workers).statuses == {"finished": 5}
    assert results(tmp_path / "one") == results(tmp_path / "two")


def test_an_interrupted_start_keeps_what_is_finished_and_a_second_one_runs_the_rest(tmp_path):
    runs = ManyRuns(jobs(tmp_path, _3="half-way"), "member", 1, None)
    with pytest.raises(KeyboardInterrupt):
        runs.run()
    assert len(runs.records) == 2 and len(list(tmp_path.glob("*.json"))) == 2
    again = ended(jobs(tmp_path))
    assert again.before == 2 and done_in(tmp_path) == [1, 2, 3, 3, 4] and again.statuses == {"finished": 4}


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_a_result_without_record_is_of_a_killed_run_and_is_made_again(tmp_path):
    program = f"from test_many_runs import ended, jobs; ended(jobs({str(tmp_path)!r}, _3='killed'))"
    path = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    code = subprocess.run([sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": path}).returncode
    assert code == -signal.SIGKILL and len(results(tmp_path)) == 3
    again = ended(jobs(tmp_path))
    assert again.before == 2 and done_in(tmp_path) == [1, 2, 3, 3, 4] and again.statuses == {"finished": 4}


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_a_task_that_kills_each_worker_is_lost_and_the_rest_is_done(tmp_path):
    with collected() as said:
        runs = ended(jobs(tmp_path, 5, _3="deadly"), 2)
    assert runs.statuses == {"finished": 4, "lost": 1} and runs.records[digest_of([3])] == LOST
    assert [line for line in said if "died" in line] == [
        *["the worker of member 3 died; it is run again"] * 2,
        "the worker of member 3 died; given up after 3 times",
    ]
    assert done_in(tmp_path).count(3) == 3 and len(runs.finished) == 4
    assert ended(jobs(tmp_path, 5)).statuses == {"finished": 5}  # a lost run is tried again


def test_unphysical_runs_are_final_and_refused_ones_are_tried_again(tmp_path):
    seen = []
    tasks = jobs(tmp_path, _2="unphysical", _3="refused")
    runs = ended(tasks, ended=lambda task, record: seen.append((task.number, record["status"], record["reason"])))
    assert seen[1:3] == [(2, "unphysical", "step 3"), (3, "refused", "no such file")]
    assert runs.statuses == {"finished": 2, "unphysical": 1, "refused": 1}
    assert [task.number for task in runs.finished] == [1, 4]
    again = ManyRuns(jobs(tmp_path), "member", 1, None)
    assert [task.number for task in again.to_run] == [3]


def damaged(path, kind):
    match kind:
        case "cut":
            path.write_text(path.read_text()[:20])
        case "no record":
            path.write_text("[1]")
        case "of another run":
            path.write_text(path.read_text().replace(digest_of([2]), digest_of([1])))
        case "unfinished":
            path.write_text(path.read_text().replace('"finished"', '"running"'))
        case "binary":
            path.write_bytes(b"\xff\x00")


@pytest.mark.parametrize("kind", ["cut", "no record", "of another run", "unfinished", "binary", "no result"])
def test_a_damaged_record_or_a_missing_result_is_no_finished_run(tmp_path, kind):
    tasks = jobs(tmp_path)
    ended(tasks)
    files = tasks[1].files
    files.maxima.unlink() if kind == "no result" else damaged(files.record, kind)
    runs = ended(jobs(tmp_path))
    assert runs.before == 3 and done_in(tmp_path) == [1, 2, 3, 4, 2] and runs.statuses == {"finished": 4}
    assert not list(tmp_path.glob(".*part*"))


def test_a_worker_runs_nothing_that_another_start_has_finished(tmp_path):
    (job,) = jobs(tmp_path, 1)
    first = recorded(job)
    assert recorded(job) == first and done_in(tmp_path) == [1]
    assert {"digest", "wall_seconds", "processor_seconds", "version"} < set(first)


def test_long_or_large_runs_are_asked_for(tmp_path):
    runs, asked = ManyRuns(jobs(tmp_path), "member", 2, None), []

    def no(question):
        asked.append(question)
        return False

    runs.require_affordable(lambda tasks: (60.0 * len(tasks), 1e6), no)
    assert not asked
    for cost in ((7201.0 * 4, 1e6), (1.0, 1e18)):
        with pytest.raises(SceneError, match=r"4 runs are predicted to take .* on 2 workers .*; give `yes`"):
            runs.require_affordable(lambda tasks, cost=cost: cost, no)
    assert len(asked) == 2 and asked[0].startswith("these 4 runs are predicted to take")
    ended(jobs(tmp_path))
    ManyRuns(jobs(tmp_path), "member", 2, None).require_affordable(lambda tasks: (1e9, 1e18), no)  # nothing to run
    assert len(asked) == 2


def test_a_scheduler_that_does_not_answer_is_reported_before_the_first_run(tmp_path):
    pytest.importorskip("distributed")
    runs = ManyRuns(jobs(tmp_path), "member", None, "tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="no scheduler answers"):
        runs.require_affordable(lambda tasks: (1.0, 1.0), lambda question: True)
    assert not done_in(tmp_path)


STATES = st.lists(st.sampled_from([("finished", 1), ("finished", 0), ("unphysical", None)]), max_size=12)


@given(STATES)
def test_runs_that_still_move_are_counted_and_named(states):
    runs = ManyRuns([], "member", 1, None)
    runs.tasks = [Job(number, "") for number, _ in enumerate(states, 1)]
    runs.records = {
        task.digest: {"status": status} | ({} if rest is None else {"came_to_rest": rest})
        for task, (status, rest) in zip(runs.tasks, states, strict=True)
    }
    with collected() as said:
        moving = runs.log_moving()
    count, finished = states.count(("finished", 0)), len(runs.finished)
    assert moving == count
    assert [text.split(" did not")[0] for text in said] == ([f"{count} of {finished} members"] if count else [])
