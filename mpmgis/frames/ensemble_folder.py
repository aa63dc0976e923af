"""Folder of an ensemble: plan, records of the members, and windows of all members' rasters."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rasterio

from ..scene.scene_text import toml_value
from ..system.csv_rows import write_records
from ..system.disguised_files import require_undisguised
from ..system.errors import FormatError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import one_of, refuse_links, remove, within
from ..system.trusted_files import require_file
from ..system.whole_files import output_error, refuse_other, whole_file
from ..terrain.raster_output import BLOCK
from .run_folder import versions

if TYPE_CHECKING:
    from ..terrain.grid import Grid


PLAN_FILE, RECORD_FILE, TABLE_FILE, MEMBERS, MAPS = "plan.toml", "ensemble.json", "members.csv", "members", "maps"
STACK_BYTES = 64_000_000  # of members' values in memory at a time, all threads together
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
        given = within(self.members, inputs) or within(self.maps, inputs)
        for name in (LOCK_FILE, PLAN_FILE, RECORD_FILE, TABLE_FILE):
            given = given or one_of(self.path / name, inputs)
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
            if entry.name.split(".")[0].removesuffix("_max").removesuffix("_deposit") in kept:
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


def deposit_file(folder: str | Path, digest: str) -> Path:
    """Return the path of the deposit of the member with a digest.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    digest : str
        Digest of the member.
    """
    return Path(folder) / f"{digest}_deposit.tif"


def read_member(folder: str | Path, digest: str, frames: bool = False, deposit: bool = False) -> dict | None:
    """Read the record of a member in a final state.

    Parameters
    ----------
    folder : str or Path
        Folder of the members' results.
    digest : str
        Digest of the member.
    frames : bool
        Its frames are needed.
    deposit : bool
        Its deposit is needed.

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
    if record["status"] == "finished" and deposit and not deposit_file(folder, digest).is_file():
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


class MemberStack:
    """The maxima of many members on one grid, read a window at a time.

    Memory is bounded by the window, whose size follows from the number of members.

    Parameters
    ----------
    paths : list of Path
        Rasters of the members.
    grid : Grid
    extent : (int, int, int, int) or None
        First and one past the last row, first and one past the last column that any member reached.
    bands : sequence of str
        Names of the bands in each raster, in order.
    threads : int
    """

    def __init__(
        self,
        paths: list[Path],
        grid: "Grid",
        extent: tuple[int, int, int, int] | None,
        bands: Sequence[str],
        threads: int = 1,
    ):
        self.paths, self.grid, self.extent, self.bands = list(paths), grid, extent, list(bands)
        self.threads = max(1, threads)

    def windows(self, first: int, last: int) -> list[tuple[int, int, int, int]]:
        """Return windows that cover the reached cells of the rows first <= row < last, small enough for memory.

        Parameters
        ----------
        first, last : int
            First row, and one past the last row.

        Returns
        -------
        list of (int, int, int, int)
            First and one past the last row, first and one past the last column.
        """
        if self.extent is None:
            return []
        top, bottom, left, right = self.extent
        first, last = max(first, top), min(last, bottom)
        cells = max(1, STACK_BYTES // (4 * len(self.paths) * self.threads))
        width = min(BLOCK, cells)
        height = max(1, cells // width)
        rows = [(row, min(row + height, last)) for row in range(first, last, height)]
        columns = [(column, min(column + width, right)) for column in range(left - left % width, right, width)]
        return [(*row, max(column, left), end) for row in rows for column, end in columns]

    def read(self, band: str, window: tuple[int, int, int, int]) -> np.ndarray:
        """Read a band of all members in a window.

        Parameters
        ----------
        band : str
            Name of the band.
        window : (int, int, int, int)
            First and one past the last row, first and one past the last column.

        Returns
        -------
        float32[members, rows, columns]
            NaN where there is no data.
        """
        row, row_end, column, column_end = window
        number = self.bands.index(band) + 1
        stack = np.empty((len(self.paths), row_end - row, column_end - column), np.float32)
        for values, path in zip(stack, self.paths, strict=True):
            require_undisguised(path)
            with rasterio.open(path) as source:
                source.read(number, window=((row, row_end), (column, column_end)), out=values)
                values[values == np.float32(source.nodata)] = np.nan
        return stack

    def rows_of(
        self, count: int, sources: Sequence[str], compute: Callable[[str, np.ndarray], dict[int, np.ndarray]]
    ) -> Callable[[int, int, int], np.ndarray]:
        """Return a function that computes rows of `count` bands, for `raster_output.write_rows`.

        The bands of a strip of rows are computed together, once.

        Parameters
        ----------
        count : int
            Number of bands to write.
        sources : sequence of str
            Bands of the members to read.
        compute : callable
            (source, stack) -> {number of a band: float32[rows, columns]}.

        Returns
        -------
        callable
            (band, first, last) -> float32[last - first, columns].
        """
        strip = {}

        def rows(band, first, last):
            if strip.get("rows") != (first, last):
                strip["rows"], strip["values"] = (first, last), self._strip(count, sources, compute, first, last)
            return strip["values"][band]

        return rows

    def _strip(self, count: int, sources: Sequence[str], compute: Callable, first: int, last: int) -> np.ndarray:
        """Return the bands of a strip of rows, float32[count, rows, columns]."""
        strip = np.full((count, last - first, self.grid.shape[1]), np.nan, np.float32)

        def fill(window):
            row, row_end, column, column_end = window
            for source in sources:
                for number, values in compute(source, self.read(source, window)).items():
                    strip[number, row - first : row_end - first, column:column_end] = values

        with ThreadPoolExecutor(self.threads) as threads:
            list(threads.map(fill, self.windows(first, last)))
        return strip
