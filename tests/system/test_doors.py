"""Files that users name are opened in few places, where all guards stand."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "mpmgis"
OWN = "writes it, or reads what it has just written"
# call: modules that may have it, and why
DOORS = {
    "DatasetReader": {"terrain/raster_input": "the door for rasters"},
    "WarpedVRT": {"terrain/terrain_reprojection": "of a raster that the door has opened"},
    "rasterio.open": {  # for writing
        "frames/region_maps": OWN,
        "frames/run_folder": OWN,
        "frames/run_maps": OWN,
        "terrain/class_rasters": OWN,
        "terrain/raster_output": OWN,
    },
    "list_layers": {
        "terrain/vector_table": "the door for vector files",
        "terrain/spatial_inputs": "within open_vector",
        "results/reports/map_facts": "within open_vector",
    },
    "read_dataframe": {
        "results/reports/map_facts": "within open_vector",
        "results/reports/particle_facts": "within open_vector",
    },
    "read_info": {"results/reports/particle_facts": "within open_vector"},
    "read_file": {},
    "read_parquet": {"terrain/vector_table": "the door", "results/reports/map_facts": "within open_vector"},
    "open_arrow": {},
    "read_bounds": {},
    "h5py.File": {
        "system/hdf5_reading": "the door for HDF5",
        "system/hdf5_writing": OWN,
        "frames/frame_files": OWN,
        "maps/qgis/flow_mesh": OWN,
    },
    "netCDF4.Dataset": {
        "maps/qgis/flow_mesh": OWN,
        "results/reports/map_facts": "after hdf5_reading has found all values in the file",
    },
    "np.load": {"maps/qgis/outlines": OWN},
    "np.genfromtxt": {},
    "np.loadtxt": {},
    "np.memmap": {},
    "np.fromfile": {"exchange/readers/ply": "after its header was read by the door for particle files"},
    "mmap.mmap": {"exchange/readers/mapped_files": "the door for tables of particles"},
    "csv.read_csv": {"exchange/readers/record_parsing": "of bytes that the door has read"},
    "zipfile.ZipFile": {
        "system/zip_archives": "the door for archives",
        "maps/qgis/kml": OWN,
        "maps/qgis/plugin_zip": OWN,
        "maps/qgis/project": OWN,
        "qgis_plugin/mpmgis_qgis/result_layers": "a project that this program wrote, opened in QGIS",
    },
    "sqlite3.connect": {
        "system/settled_databases": "a copy, so that waiting changes stay beside the original",
        "maps/qgis/outlines": OWN,
        "maps/qgis/vector_styles": OWN,
    },
    "xarray.open_dataset": {},
    "open_rasterio": {},
    "gdal.Open": {},
    "fiona.open": {},
}
# modules that read a file as bytes or text with open(), read_text or read_bytes, and why
FIRST_BYTES = "the first bytes only, to see what it is"
FACTS = "facts of files that this program writes, for `info`"
PLAIN = {
    "__init__": "the index of the package",
    "commands/shell/answers": OWN,
    "compiled/cache_folder": "the cache of compiled programs",
    "compiled/checked_cache": "the cache of compiled programs",
    "exchange/declarations": "the door for declarations",
    "exchange/readers/anura3d": "a text beside particles, which the reader recognizes",
    "exchange/readers/general_hdf5": FIRST_BYTES,
    "exchange/readers/mapped_files": "the door for tables of particles",
    "exchange/readers/matter": "a text beside particles, which the reader recognizes",
    "exchange/readers/ply": "the door for PLY",
    "exchange/readers/reader_interface": "the door for settings beside particles",
    "exchange/readers/reader_list": FIRST_BYTES,
    "exchange/writers/cbgeo_start": OWN,
    "exchange/writers/geotaichi_start": OWN,
    "exchange/writers/kratos_start": OWN,
    "exchange/writers/mpm_geomechanics_start": OWN,
    "frames/ensemble_members": "the table of an ensemble",
    "frames/load_table": "the table of a run",
    "frames/many_runs_folder": "the record of an ensemble or a region, and those of its runs",
    "frames/run_folder": "the record of a run",
    "laws/own_law": "a law that the user names by --law",
    "maps/export/export_inputs": "the scene in the folder of a run",
    "maps/qgis/kml": OWN,
    "maps/qgis/outlines": OWN,
    "maps/qgis/plugin_zip": "files of the package",
    "maps/qgis/xml_markup": "files of the package",
    "results/reports/flow_player": "files of the package",
    "results/hazard/guideline_files": "the door for tables of guidelines",
    "results/reports/fact_table": FACTS,
    "results/reports/file_facts": FACTS,
    "results/reports/particle_facts": FACTS,
    "results/reports/qgis_facts": "a QGIS project, for `info`",
    "results/reports/report_pages": OWN,
    "results/reports/run_report": OWN,
    "scene/scene_reading": "the door for scenes",
    "simulation/scene_files": FIRST_BYTES,
    "system/file_references": "what a file leads to, before any library opens it",
    "system/memory": "a file of the operating system",
    "system/operating_system": "a file of the operating system",
    "system/text_tables": "the door for tables and texts",
    "system/whole_files": OWN,
    "system/zip_archives": FIRST_BYTES,
    "terrain/complete_files": "the header, to see whether the file ends early",
    "terrain/raster_input": FIRST_BYTES + ", and the digest",
    "terrain/raster_scale": "a sidecar that GDAL has read, to see what stands in it",
    "terrain/virtual_rasters": "names in a virtual raster, after `require_local`",
}


def calls():
    """(module, name, node) of every call that DOORS names: `a.b` and `b` of a.b(...)."""
    words = {name.rpartition(".")[2] for name in DOORS}
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if not any(f"{word}(" in text for word in words):
            continue
        module = path.relative_to(PACKAGE).with_suffix("").as_posix()
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call):
                continue
            names = ast.unparse(node.func).rsplit(".", 2)
            for name in {names[-1], ".".join(names[-2:])} & set(DOORS):
                yield module, name, node


def test_files_of_users_are_opened_at_the_doors():
    wrong, used = [], set()
    for module, name, node in calls():
        used.add((name, module))
        reads = name == "rasterio.open" and not _writes(node)
        if module not in DOORS[name] or reads:
            wrong.append(f"{module}:{node.lineno} calls {name}; use the door")
    assert not wrong
    assert used == {(name, module) for name, modules in DOORS.items() for module in modules}


def test_files_are_read_as_bytes_or_text_by_named_modules():
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).with_suffix("").as_posix()
        if module.startswith("qgis_plugin"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and _reads_plainly(node):
                found.setdefault(module, node.lineno)
    wrong = [f"{module}:{line} reads a file; use a door" for module, line in found.items() if module not in PLAIN]
    assert not wrong
    assert set(found) == set(PLAIN)


def _reads_plainly(node):
    """Whether a call is open() for reading, or .read_text(), .read_bytes() or .open() of a path."""
    if isinstance(node.func, ast.Name):
        return node.func.id == "open" and not _writes(node)
    if not isinstance(node.func, ast.Attribute):
        return False
    if node.func.attr == "read_text":
        return True
    path_method = node.func.attr == "open" and "path" in ast.unparse(node.func.value).lower()
    return node.func.attr == "read_bytes" or (path_method and not _writes(node, 0))


def _writes(node, place=1):
    named = [word.value for word in node.keywords if word.arg == "mode"]
    mode = (named or node.args[place : place + 1] or [None])[0]
    return isinstance(mode, ast.Constant) and mode.value in ("w", "wb", "x", "xb", "w+b", "r+")


def test_the_formats_page_names_every_driver():
    from mpmgis.terrain.allowed_drivers import RASTER_DRIVERS, VECTOR_DRIVERS

    page = (PACKAGE / "docs" / "formats.md").read_text(encoding="utf-8")
    rows = {line.split("|")[1].strip(): line for line in page.splitlines() if line.startswith("|")}
    for row, drivers in (("rasters", RASTER_DRIVERS), ("vector files", VECTOR_DRIVERS)):
        for driver, words in drivers.items():
            assert f"{words} (`{driver}`)" in rows[row]
        assert rows[row].count("(`") == len(drivers)
