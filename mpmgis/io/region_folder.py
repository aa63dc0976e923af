"""The folder of a region: results of the areas, maps, record."""

import json
from contextlib import contextmanager
from pathlib import Path

from ..errors import FormatError, OutputError, one_line
from .atomic import output_error, refuse_existing, whole_file
from .links import one_of, refuse_links, within
from .lock import LOCK_FILE, sole_writer
from .run_folder import versions

RECORD_FILE, AREAS_FILE, RUNS, MAPS = "region.json", "areas.gpkg", "runs", "maps"


class RegionFolder:
    """One region on disk; every file in it appears whole or not at all.

    Parameters
    ----------
    path : path
    digest : str
        Of all areas and of the scene; a folder with another digest is not continued without `overwrite`.

    Raises
    ------
    OutputError
    """

    def __init__(self, path, digest, overwrite=False):
        self.path, self.digest = Path(path), digest
        self.runs, self.maps, self.areas = self.path / RUNS, self.path / MAPS, self.path / AREAS_FILE
        refuse_links(self.path, (LOCK_FILE, RECORD_FILE, AREAS_FILE, RUNS, MAPS))
        if not self.path.exists():
            return
        if not (self.path / RECORD_FILE).is_file():
            if not self.path.is_dir() or any(entry.name != LOCK_FILE for entry in self.path.iterdir()):
                refuse_existing(self.path, overwrite=False)
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

    def spare(self, inputs):
        """Refuse a folder where one of the `inputs` would be replaced."""
        if not self.path.is_dir():
            return
        inputs = list(inputs)
        given = within(self.runs, inputs) or within(self.maps, inputs)
        for name in (LOCK_FILE, RECORD_FILE, AREAS_FILE):
            given = given or one_of(self.path / name, inputs)
        if given is not None:
            raise OutputError(f"{self.path} contains the input {given}; give another -o")

    @contextmanager
    def held(self):
        """Create the folder and lock it for this block."""
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error(self.path, error) from error
        with sole_writer(self.path):
            yield

    def write_record(self, **record):
        """Write `region.json`."""
        whole = {"format": "mpmgis-region", "format_version": 1, "digest": self.digest, "versions": versions()}
        with whole_file(self.path / RECORD_FILE) as part:
            text = json.dumps(whole | record, indent=1, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8", newline="\n")
