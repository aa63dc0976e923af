"""Folder of a region: layer of the release areas with their results, runs, maps, record."""

import json
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..system.errors import FormatError, OutputError, one_line
from ..system.folder_lock import LOCK_FILE, sole_writer
from ..system.links import input_at, input_inside, refuse_links
from ..system.optional_libraries import GEOPACKAGE
from ..system.whole_files import output_error, refuse_other, whole_file
from .run_folder import versions

LAYER = "areas"  # name of the layer of the release areas
FOOTPRINTS = "footprints"  # name of the layer of the areas that the flows reach
RECORD_FILE, AREAS_FILE, RUNS, MAPS = "region.json", "areas.gpkg", "runs", "maps"


def write_layer(path: Path, layer: str, shapes: Sequence, columns: Mapping[str, Sequence], crs: Any) -> None:
    """Write a GeoPackage with one layer of shapes.

    Parameters
    ----------
    path : Path
    layer : str
        Name of the layer.
    shapes : sequence of shapely.Geometry [m]
    columns : dict of str to sequence
        Attributes of the shapes.
    crs : pyproj.CRS or None
    """
    import geopandas  # 0.5 s

    table = geopandas.GeoDataFrame(columns, geometry=shapes, crs=crs)
    with whole_file(path) as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a local frame has no CRS
        table.to_file(part, layer=layer, driver="GPKG", engine="pyogrio", dataset_options=GEOPACKAGE)


class RegionFolder:
    """One region on disk; every file in it appears whole or not at all.

    Parameters
    ----------
    path : str or Path
    digest : str
        Digest of all areas and of the scene; a folder with another digest is not continued.
    overwrite : bool
        Replace the region of another scene.

    Raises
    ------
    OutputError
        The folder holds other content, or another region without `overwrite`; it is a link or contains one under a name
        that the region uses.
    FormatError
        The record of an earlier start cannot be read.
    """

    def __init__(self, path: str | Path, digest: str, overwrite: bool = False):
        self.path, self.digest = Path(path), digest
        self.runs, self.maps, self.areas = self.path / RUNS, self.path / MAPS, self.path / AREAS_FILE
        refuse_links(self.path, (LOCK_FILE, RECORD_FILE, AREAS_FILE, RUNS, MAPS))
        if not self.path.exists():
            return
        if not (self.path / RECORD_FILE).is_file():
            if not self.path.is_dir() or any(entry.name != LOCK_FILE for entry in self.path.iterdir()):
                refuse_other(self.path, "a region")
        elif self._recorded() != digest and not overwrite:
            raise OutputError(
                f"{self.path} holds a region of another scene, DTM or other areas; give another -o, or --overwrite "
                "(runs that are in both are kept)"
            )

    def _recorded(self):
        file = self.path / RECORD_FILE
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise FormatError(f"{file} cannot be read ({one_line(error)[:80]}); give another folder") from error
        return record.get("digest") if isinstance(record, dict) else None

    def refuse_inputs(self, inputs: Iterable[Path]) -> None:
        """Refuse a folder where one of the `inputs`, under any name, would be replaced.

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
        for name in (LOCK_FILE, RECORD_FILE, AREAS_FILE):
            given = given or input_at(self.path / name, inputs)
        if given is not None:
            raise OutputError(f"{self.path} contains the input {given}; give another -o")

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
            yield

    def write_record(self, **record: object) -> None:
        """Write `region.json`.

        Parameters
        ----------
        **record
            Entries of the record, values that JSON can hold.
        """
        whole = {"format": "mpmgis-region", "format_version": 1, "digest": self.digest, "versions": versions()}
        with whole_file(self.path / RECORD_FILE) as part:
            text = json.dumps(whole | record, indent=1, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")
