"""Folder of an ensemble: plan, record, table and results of the members."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..scene.scene_text import toml_value
from ..system.csv_rows import write_records
from ..system.errors import FormatError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import input_at, input_inside, refuse_links, remove
from ..system.trusted_files import require_file
from ..system.whole_files import output_error, refuse_other, whole_file
from .flow_end import DEPOSIT, LAST
from .run_folder import versions

PLAN_FILE, RECORD_FILE, TABLE_FILE, MEMBERS, MAPS = "plan.toml", "ensemble.json", "members.csv", "members", "maps"
_WORD = re.compile(f"_(max|{DEPOSIT}|{LAST})$")  # after the digest, in the name of a raster
FINAL = ("finished", "unphysical")  # final states of a member: a repetition gives the same


class EnsembleFolder:
    """One ensemble on disk; every file in it appears whole or not at all.

    Parameters
    ----------
    path : str or Path
    digest : str
        Digest of the plan and the scene; a folder with another digest is not continued.
    overwrite : bool
        Replace the ensemble of another plan.

    Raises
    ------
    OutputError
        The folder holds other content, or another ensemble without `overwrite`; it is a link or contains one under
        a name that the ensemble uses.
    """

    def __init__(self, path: str | Path, digest: str, overwrite: bool = False):
        self.path, self.digest = Path(path), digest
        self._refuse_links()
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, expected a folder; give another -o")
        record = read_ensemble_record(self.path)
        if record is None:
            self._refuse_filled()
        elif record.get("digest") != digest and not overwrite:
            raise OutputError(
                f"{self.path} holds an ensemble of another plan or scene; give another -o, or --overwrite to replace "
                "it (members that are in both are kept)"
            )

    def _refuse_links(self):
        refuse_links(self.path, (LOCK_FILE, PLAN_FILE, RECORD_FILE, TABLE_FILE, MEMBERS, MAPS))
        refuse_links(self.members)

    def refuse_inputs(self, inputs: Iterable[Path]) -> None:
        """Refuse a folder where one of the `inputs`, under any name, would be replaced or removed.

        Parameters
        ----------
        inputs : iterable of Path

        Raises
        ------
        OutputError
            The folder contains an input.
        """
        if not self.path.is_dir():
            return
        inputs = list(inputs)
        given = input_inside(self.members, inputs) or input_inside(self.maps, inputs)
        for name in (LOCK_FILE, PLAN_FILE, RECORD_FILE, TABLE_FILE):
            given = given or input_at(self.path / name, inputs)
        if given is not None:
            raise OutputError(f"{self.path} contains the input {given}; give another -o")

    def _refuse_filled(self):
        if self.path.is_dir() and all(entry.name == LOCK_FILE for entry in self.path.iterdir()):
            return
        refuse_other(self.path, "an ensemble")

    @property
    def members(self) -> Path:
        """Folder of the members' results."""
        return self.path / MEMBERS

    @property
    def plan(self) -> Path:
        """Path of the plan."""
        return self.path / PLAN_FILE

    @property
    def maps(self) -> Path:
        """Folder of the maps."""
        return self.path / MAPS

    @contextmanager
    def held(self) -> Iterator[None]:
        """Create the folder and lock it for this block.

        Raises
        ------
        OutputError
            Another process has locked it, or it cannot be created.
        """
        try:
            self.members.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(self.path, error) from error
        with sole_writer(self.path):
            self._refuse_links()
            yield

    def keep_members(self, digests: Iterable[str]) -> None:
        """Remove the results of all members but those with the given digests.

        Parameters
        ----------
        digests : iterable of str
            Digests of the members that are kept.
        """
        kept = set(digests)
        for entry in self.members.iterdir():
            if _WORD.sub("", entry.name.split(".")[0]) in kept:
                continue
            remove(entry)

    def write_plan(self, tables: dict, note: str) -> None:
        """Write the plan as a TOML file that the option --plan reads.

        Parameters
        ----------
        tables : dict
            Keys and tables of the plan.
        note : str
            Comment in the first line.
        """
        with whole_file(self.plan) as part:
            part.write_text(plan_text(tables, note), encoding="utf-8", newline="\n")

    def write_record(self, **record: object) -> None:
        """Write `ensemble.json`: request, versions, progress.

        Parameters
        ----------
        **record
            Entries of the record, values that JSON can hold.
        """
        whole = {"format": "mpmgis-ensemble", "format_version": 1, "digest": self.digest, "versions": versions()}
        with whole_file(self.path / RECORD_FILE) as part:
            text = json.dumps(whole | record, indent=1, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")

    def write_table(self, names: Sequence[str], rows: Iterable[Sequence]) -> Path:
        """Write `members.csv`.

        Parameters
        ----------
        names : sequence of str
            Headings of the columns.
        rows : iterable of sequences
            Values of one member each.

        Returns
        -------
        Path
            Path of the table.
        """
        write_records(self.path / TABLE_FILE, names, rows)
        return self.path / TABLE_FILE


def read_ensemble_record(folder: str | Path) -> dict | None:
    """Read the record of the last start in `folder`.

    Parameters
    ----------
    folder : str or Path
        Folder of the ensemble.

    Returns
    -------
    dict or None
        None where there is no record.

    Raises
    ------
    FormatError
        The record cannot be read.
    """
    file = Path(folder) / RECORD_FILE
    if not file.is_file():
        return None
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{file} cannot be read ({one_line(error)[:80]}); give another folder") from error
    return record if isinstance(record, dict) else {}


def plan_text(tables: dict, note: str) -> str:
    """Return a plan as TOML text.

    Parameters
    ----------
    tables : dict
        Keys and tables of the plan.
    note : str
        Comment in the first line.
    """
    lines = [f"# {note}"]
    lines += [f"{key} = {toml_value(value)}" for key, value in tables.items() if not isinstance(value, dict)]
    for name, table in tables.items():
        if isinstance(table, dict):
            lines += ["", f"[{name}]"] + [f'"{key}" = {toml_value(value)}' for key, value in table.items()]
    return "\n".join(lines) + "\n"


def member_files(folder: str | Path, digest: str) -> tuple[Path, Path, Path]:
    """Return the paths of the files of the member with a digest.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    digest : str
        Digest of the member.

    Returns
    -------
    record, maxima, frames : Path
        Record, raster of the maxima, folder of the frames.
    """
    folder = Path(folder)
    return folder / f"{digest}.json", folder / f"{digest}_max.tif", folder / digest


def last_step_file(folder: str | Path, digest: str, came_to_rest: bool) -> Path:
    """Return the path of the raster of the last step of the member with a digest; it has the name of its only band.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    digest : str
        Digest of the member.
    came_to_rest : bool
        Only then the last step is a deposit.
    """
    return Path(folder) / f"{digest}_{DEPOSIT if came_to_rest else LAST}.tif"


def read_member(folder: str | Path, digest: str, frames: bool = False, last: bool = False) -> dict | None:
    """Read the record of a member in a final state.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    digest : str
        Digest of the member.
    frames : bool
        Its frames are needed.
    last : bool
        The raster of its last step is needed.

    Returns
    -------
    dict or None
        None where there is no such record, or needed results are missing.
    """
    record_file, raster, kept = member_files(folder, digest)
    require_file(record_file)
    try:
        record = json.loads(record_file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or record.get("status") not in FINAL or record.get("digest") != digest:
        return None
    if record["status"] == "finished" and not (raster.is_file() and (kept.is_dir() or not frames)):
        return None
    wanted = last and record["status"] == "finished"
    if wanted and not last_step_file(folder, digest, bool(record.get("came_to_rest"))).is_file():
        return None
    return record


def write_member(folder: str | Path, record: dict) -> None:
    """Write the record of a member after its results: a member with a record is complete.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    record : dict
        Record of the member, with its `digest`.
    """
    with whole_file(member_files(folder, record["digest"])[0]) as part:
        part.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
