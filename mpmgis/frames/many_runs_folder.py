"""Folder of many runs of one plan, an ensemble or a region: its record, the files of each run, the maps of all."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..system.errors import FormatError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import input_at, input_inside, refuse_links, remove
from ..system.trusted_files import require_file
from ..system.whole_files import output_error, refuse_other, whole_file
from .flow_end import DEPOSIT, LAST
from .run_folder import versions

MAPS = "maps"  # folder of the maps
PLAN_FILE, TABLE_FILE, AREAS_FILE = "plan.toml", "members.csv", "areas.gpkg"
FINAL = ("finished", "unphysical")  # final states of a run: a repetition gives the same


class FolderKind(NamedTuple):
    """What a folder of many runs contains.

    Parameters
    ----------
    what : str
        For messages.
    record : str
        Name of its record.
    format : str
        Written in the record.
    runs : str
        Name of the folder of the results of single runs.
    tables : tuple of str
        Names of its other files.
    refusal : str
        Of a folder with another digest: what it holds, and what to do.
    """

    what: str
    record: str
    format: str
    runs: str
    tables: tuple
    refusal: str


ENSEMBLE = FolderKind(
    "an ensemble",
    "ensemble.json",
    "mpmgis-ensemble",
    "members",
    (PLAN_FILE, TABLE_FILE),
    "an ensemble of another plan or scene; give another -o, or --overwrite to replace it (members that are in both "
    "are kept)",
)
REGION = FolderKind(
    "a region",
    "region.json",
    "mpmgis-region",
    "runs",
    (AREAS_FILE,),
    "a region of another scene, DTM or other areas; give another -o, or --overwrite (runs that are in both are kept)",
)


class ManyRunsFolder:
    """Many runs on disk; every file in it appears whole or not at all.

    Parameters
    ----------
    kind : FolderKind
    path : str or Path
    digest : str
        Digest of all runs; a folder with another digest is not continued.
    overwrite : bool
        Replace the runs of another plan.

    Raises
    ------
    OutputError
        The folder holds other content, or runs of another plan without `overwrite`; it is a link or contains one under
        a name that is used.
    FormatError
        The record of an earlier start cannot be read.
    """

    def __init__(self, kind: FolderKind, path: str | Path, digest: str, overwrite: bool = False):
        self.kind, self.path, self.digest = kind, Path(path), digest
        self.runs, self.maps = self.path / kind.runs, self.path / MAPS
        self._files = (LOCK_FILE, kind.record, *kind.tables)
        self._refuse_links()
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, expected a folder; give another -o")
        record = read_folder_record(kind, self.path)
        if record is None:
            if not (self.path.is_dir() and all(entry.name == LOCK_FILE for entry in self.path.iterdir())):
                refuse_other(self.path, kind.what)
        elif record.get("digest") != digest and not overwrite:
            raise OutputError(f"{self.path} holds {kind.refusal}")

    def _refuse_links(self):
        refuse_links(self.path, (*self._files, self.kind.runs, MAPS))
        refuse_links(self.runs)

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
        given = input_inside(self.runs, inputs) or input_inside(self.maps, inputs)
        for name in self._files:
            given = given or input_at(self.path / name, inputs)
        if given is not None:
            raise OutputError(f"{self.path} contains the input {given}; give another -o")

    @contextmanager
    def planned(self) -> Iterator[None]:
        """Remove the files of this block if it fails before the first start, so that the folder can be used again."""
        new = not self.path.exists()
        try:
            yield
        except BaseException:
            if self.runs.is_dir() and read_folder_record(self.kind, self.path) is None:
                remove(self.runs)
                if new and not any(self.path.iterdir()):
                    self.path.rmdir()
            raise

    @contextmanager
    def held(self) -> Iterator[None]:
        """Create the folder and lock it for this block.

        Raises
        ------
        OutputError
            Another process has locked it, or it cannot be created.
        """
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(self.path, error) from error
        with sole_writer(self.path):
            self._refuse_links()
            yield

    def keep_runs(self, digests: Iterable[str]) -> None:
        """Remove the results of all runs but those with the given digests.

        Parameters
        ----------
        digests : iterable of str
            Digests of the runs that are kept.
        """
        kept = set(digests)
        for entry in self.runs.iterdir():
            if entry.name.split(".")[0].split("_")[0] not in kept:
                remove(entry)

    def write_record(self, **record: object) -> None:
        """Write the record: request, versions, progress.

        Parameters
        ----------
        **record
            Entries of the record, values that JSON can hold.
        """
        whole = {"format": self.kind.format, "format_version": 1, "digest": self.digest, "versions": versions()}
        with whole_file(self.path / self.kind.record) as part:
            text = json.dumps(whole | record, indent=1, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")


def read_folder_record(kind: FolderKind, folder: str | Path) -> dict | None:
    """Read the record of the last start in a folder of many runs.

    Parameters
    ----------
    kind : FolderKind
    folder : str or Path

    Returns
    -------
    dict or None
        None where there is no record.

    Raises
    ------
    FormatError
        The record cannot be read.
    """
    file = Path(folder) / kind.record
    if not file.is_file():
        return None
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise FormatError(f"{file} cannot be read ({one_line(error)[:80]}); give another folder") from error
    return record if isinstance(record, dict) else {}


@dataclass(frozen=True)
class RunFiles:
    """Paths of the files of one run among many.

    Parameters
    ----------
    folder : Path
        Folder of the results of single runs.
    digest : str
        Of all inputs of the run.
    """

    folder: Path
    digest: str

    @property
    def record(self) -> Path:
        """Record of a run that has ended."""
        return self.folder / f"{self.digest}.json"

    @property
    def maxima(self) -> Path:
        """Raster of the maxima."""
        return self.folder / f"{self.digest}_max.tif"

    @property
    def frames(self) -> Path:
        """Folder of the frames."""
        return self.folder / self.digest

    def last_step(self, came_to_rest: bool) -> Path:
        """Return the path of the raster of the last step; it has the name of its only band.

        Parameters
        ----------
        came_to_rest : bool
            Only then the last step is a deposit.
        """
        return self.folder / f"{self.digest}_{DEPOSIT if came_to_rest else LAST}.tif"

    @property
    def release(self) -> Path:
        """Release area of the run, where it has one of its own."""
        return self.folder / f"{self.digest}.fgb"

    def read(self) -> dict | None:
        """Read the record of a run in a final state; None where there is none.

        Returns
        -------
        dict or None
        """
        require_file(self.record)
        try:
            record = json.loads(self.record.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(record, dict) or record.get("status") not in FINAL or record.get("digest") != self.digest:
            return None
        return record

    def write(self, record: dict) -> None:
        """Write the record of the run, after its results: a run with a record is complete.

        Parameters
        ----------
        record : dict
            Values that JSON can hold, with the `digest` of the run.
        """
        with whole_file(self.record) as part:
            part.write_text(json.dumps(record, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
