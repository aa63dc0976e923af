"""Plan an ensemble: options and plan file, the scene of each member, digests, predicted cost."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from .. import __version__
from ..compiled.cache_folder import source_digest
from ..maps.averaging.export_resolution import report_cells, require_cells_within
from ..scene.key_checks import meant
from ..scene.scene_reading import read_toml
from ..scene.scene_text import toml_value
from ..simulation.cost_prediction import predicted
from ..simulation.numerical_parameters import COST_POWER
from ..simulation.preparation import scene_to_prepare
from ..simulation.scene_files import input_files
from ..system.errors import InputError, MpmgisError, SceneError
from ..system.messages import log
from .ensemble_member import FIGURES, MemberTask
from .ensemble_options import AskedEnsemble
from .ensemble_statistics import Products, exceedances
from .many_runs import digest_of
from .sampling_plan import SamplingPlan, with_values
from .varied_keys import variation

if TYPE_CHECKING:
    from ..scene import Scene
    from ..simulation.preparation import Prepared
    from ..terrain.grid import Grid

PLAN_KEYS = ("sampling", "samples", "seed", "vary", "exceed", "percentiles")
TABLE_HEAD = ("number",)  # of `members.csv`, before the varied keys
TABLE_TAIL = ("digest", "status", "wall_seconds", "processor_seconds", *FIGURES, "reason")


def read_plan(asked: AskedEnsemble) -> tuple[SamplingPlan, Products]:
    """Read the plan file, overridden by the options.

    Parameters
    ----------
    asked : AskedEnsemble

    Returns
    -------
    plan : SamplingPlan
    products : Products

    Raises
    ------
    InputError
        An unknown key, a wrong value, or a key that is given twice.
    """
    file, samples = asked["plan"], asked["samples"]
    stored = {} if file is None else _plan_file(file)
    varied = {key: variation(values, f"{file} [vary] {key}") for key, values in stored.get("vary", {}).items()}
    given = {}
    for key, values in _key_values(asked["vary"]):
        if key in given:
            raise InputError(f"`vary={key}` is given twice; give it once")
        given[key] = variation(values, f"`vary={key}`")
    exceed, percentiles = asked["exceed"], asked["percentiles"]
    exceed = exceedances(exceed) if isinstance(exceed, (tuple, list)) else exceed
    plan = SamplingPlan.of(
        varied | given,
        asked["sampling"] or stored.get("sampling"),
        samples or stored.get("samples"),
        stored.get("seed", 0) if asked["seed"] is None else asked["seed"],
    )
    if samples is not None and plan.sampling == "grid" and plan.has_only_lists:
        log.info(
            f"`samples={samples}` has no effect: all keys have lists of values, and their {plan.count} "
            "combinations are run; `sampling=lhs` draws samples from them"
        )
    return (
        plan,
        Products.of(
            stored.get("exceed") if exceed is None else exceed,
            stored.get("percentiles") if percentiles is None else percentiles,
        ),
    )


def _key_values(vary):
    """Yield (key, values) from texts KEY=VALUES or from a dictionary."""
    if isinstance(vary, dict):
        yield from vary.items()
        return
    for text in vary:
        key, equals, values = text.partition("=")
        if not (equals and key.strip()):
            raise InputError(f"`vary={text}`: expected KEY=VALUES, for example friction.mu=0.1:0.3")
        yield key.strip(), values


def _plan_file(path):
    """Return the tables of a plan file, with checked keys and types."""
    tables = read_toml(path)
    for name in tables:
        if name not in PLAN_KEYS:
            raise InputError(f"{path}: unknown key {name!r}{meant(name, PLAN_KEYS)}; it takes {', '.join(PLAN_KEYS)}")
    for name, kind, words in (
        ("sampling", str, "text"),
        ("samples", int, "a whole number above 0"),
        ("seed", int, "a whole number from 0"),
        ("vary", dict, "a table of keys"),
        ("exceed", dict, "a table like {h = [0.5, 1]}"),
        ("percentiles", list, "a list of numbers"),
    ):
        value = tables.get(name, kind())
        wrong = not isinstance(value, kind) or isinstance(value, bool) or (kind is int and value < (name == "samples"))
        if name in tables and wrong:
            raise InputError(f"{path}: {name} = {value!r}, expected {words}")
    if "exceed" in tables:
        tables["exceed"] = {name: of if isinstance(of, list) else [of] for name, of in tables["exceed"].items()}
    return tables | {"vary": dict(_flat(tables.get("vary", {})))}


def _flat(table, before=""):
    """Yield (key, value) of a table whose keys can be dotted or nested tables."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


@dataclass(frozen=True)
class PlannedRuns:
    """A scene with its checked members, and a prepared run of each group of members that read the same files.

    Parameters
    ----------
    asked : AskedEnsemble
    scene : Scene
    tables : dict
        Of the scene, with maxima of all steps.
    plan : SamplingPlan
    members : list of Member
    groups : dict
        Varied texts (names of files and laws) -> (MemberTask of the scene with them, Prepared).
    """

    asked: AskedEnsemble
    scene: "Scene"
    tables: dict
    plan: SamplingPlan
    members: list
    groups: dict

    @classmethod
    def of(cls, asked: AskedEnsemble, plan: SamplingPlan) -> "PlannedRuns":
        """Check all members, and prepare a run of each group.

        Parameters
        ----------
        asked : AskedEnsemble
        plan : SamplingPlan

        Raises
        ------
        InputError, SceneError
            A member that cannot run, or members with different grids.
        """
        scene = scene_to_prepare(asked["scene"], asked["law"])
        name, tables = Path(asked["scene"]).name, with_peaks(scene, asked["min_depth"])
        members = plan.members(tables, scene.folder, name, scene.own_laws)
        study = cls(asked, scene, tables, plan, members, {})
        for member in members:
            texts = study._texts(member)
            if texts not in study.groups:
                task = study._task(0, "", with_values(tables, dict(texts)), name, "")
                try:
                    study.groups[texts] = task, task.prepared()
                except SceneError:
                    raise
                except MpmgisError as error:
                    raise type(error)(f"{name}: {error}") from error
        study._require_one_grid()
        return study

    def _texts(self, member):
        """Return (key, text) of varied text values: only these can change which files are read."""
        values = zip(self.plan.varied, member.values, strict=True)
        return tuple((key, value) for key, value in values if isinstance(value, str))

    def _require_one_grid(self):
        if "terrain.window" in self.plan.varied:
            raise SceneError(
                "`vary` terrain.window: runs with different windows have no common grid; set it once in the scene"
            )
        grids = {(p.terrain.grid.transform, p.terrain.grid.shape) for _, p in self.groups.values()}
        if len(grids) > 1:
            raise SceneError("`vary` terrain: the DTMs have different grids; resample them to one grid")
        task, prepared = self.first
        require_cells_within(prepared.terrain.grid, self.asked["cell_size"], north_up=True)
        grid = task.averaging(prepared).grid  # raises for too many cells
        report_cells(grid, prepared.terrain.grid, prepared.coarsest_cells, self.asked["cell_size"])

    def _task(self, number: int, digest: str, tables: dict, name: str, output: str | Path) -> MemberTask:
        folder, asked = Path(self.scene.folder).resolve(), self.asked
        law = None if asked["law"] is None else str(Path(asked["law"]).resolve())
        return MemberTask(
            number,
            digest,
            tables,
            str(folder),
            name,
            law,
            str(output),
            asked["cell_size"],
            asked["min_depth"],
            asked["keep"],
        )

    def input_files(self) -> Iterator[Path]:
        """Yield the path of every file that a member reads."""
        for _, prepared in self.groups.values():
            yield from input_files(self.asked["scene"], prepared.scene, self.asked["law"])

    @property
    def first(self) -> "tuple[MemberTask, Prepared]":
        """Task and prepared run of the first group; the terrain and the grid are the same for every member."""
        return next(iter(self.groups.values()))

    @property
    def grid(self) -> "Grid":
        """Grid of all rasters."""
        task, prepared = self.first
        return task.averaging(prepared).grid

    @cached_property
    def digests(self) -> list[str]:
        """Digest of each member: its scene, the contents of its files, the raster, the program and its source."""
        asked = self.asked
        known = [__version__, source_digest(), asked["cell_size"], asked["min_depth"]]
        inputs = {texts: prepared.digest for texts, (_, prepared) in self.groups.items()}
        return [digest_of([member.tables, inputs[self._texts(member)], *known]) for member in self.members]

    @property
    def digest(self) -> str:
        """Digest of all members in order."""
        return digest_of(self.digests)

    def tasks(self, output: Path) -> list[MemberTask]:
        """Return the tasks of all members; identical members share a digest and one run, the first has a companion.

        Parameters
        ----------
        output : Path
            Folder for the results of members.
        """
        name = Path(self.asked["scene"]).name
        tasks = (
            self._task(member.number, digest, member.tables, f"{name}, member {member.number}", output)
            for member, digest in zip(self.members, self.digests, strict=True)
        )
        return [replace(task, companion=task.digest == self.digests[0]) for task in tasks]

    def cost(self, tasks: list[MemberTask]) -> tuple[float, float]:
        """Predict the cost of tasks.

        Parameters
        ----------
        tasks : list of MemberTask

        Returns
        -------
        seconds : float [s]
            Of all tasks in sequence.
        memory : float [bytes]
            Of one.
        """
        _, prepared = self.first
        ahead = predicted(prepared, 1)  # as many threads as a worker has
        return ahead.seconds * sum(self._factor(task) for task in tasks), ahead.memory

    def _factor(self, task):
        """Return the cost of a member relative to the scene, estimated from [numerics] and end_time."""
        own, base = task.tables.get("numerics", {}), self.tables.get("numerics", {})
        output = task.tables["output"]["end_time"] / self.tables["output"]["end_time"]
        ratio = {
            key: own.get(key) / base.get(key)
            for key in base
            if isinstance(own.get(key), (int, float)) and not isinstance(own.get(key), bool) and base.get(key)
        }
        more = ratio.get("particles_per_cell", 1.0) * ratio.get("points_per_cell", 1.0) / ratio.get("cfl", 1.0)
        return output * more * ratio.get("cell_size", 1.0) ** -COST_POWER[self.scene.solver]

    def table(self, records: dict[str, dict]) -> tuple[tuple, list[list]]:
        """Return the table `members.csv`; unfinished members have no figures.

        Parameters
        ----------
        records : dict of str to dict
            Record by digest.

        Returns
        -------
        names : tuple of str
        rows : list of list
        """
        rows = []
        for member, digest in zip(self.members, self.digests, strict=True):
            record = records.get(digest, {"status": "open"}) | {"digest": digest}
            stored = [record.get(name) for name in TABLE_TAIL]
            values = [str(value).lower() if isinstance(value, bool) else value for value in member.values]
            rows.append([member.number, *values, *(float("nan") if value is None else value for value in stored)])
        return (*TABLE_HEAD, *self.plan.varied, *TABLE_TAIL), rows


def with_peaks(scene: "Scene", min_depth: float) -> dict:
    """Return the tables of a scene with storage of the maxima of all steps.

    Parameters
    ----------
    scene : Scene
    min_depth : float [m]
        From which the flow has arrived, where the scene does not say it.
    """
    tables = scene.as_tables()
    tables["output"] = {"arrival_thickness": min_depth} | tables["output"] | {"maxima": True}
    return tables


def plan_text(tables: dict, note: str) -> str:
    """Return a plan as TOML text, which the option --plan reads.

    Parameters
    ----------
    tables : dict
        Keys and tables of the plan.
    note : str
        Comment in the first line.

    Returns
    -------
    str
    """
    lines = [f"# {note}"]
    lines += [f"{key} = {toml_value(value)}" for key, value in tables.items() if not isinstance(value, dict)]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"[{name}]"] + [f'"{key}" = {toml_value(value)}' for key, value in table.items()]
    return "\n".join(lines) + "\n"
