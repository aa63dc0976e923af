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
        "results/hazard/hazard_files": OWN,
        "results/hazard/intensity_files": OWN,
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
        "results/reports/file_facts": "after hdf5_reading has found all values in the file",
    },
    "np.load": {"maps/qgis/outlines": OWN},
    "xarray.open_dataset": {},
    "open_rasterio": {},
    "gdal.Open": {},
    "fiona.open": {},
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


def _writes(node):
    mode = node.args[1] if len(node.args) > 1 else None
    return isinstance(mode, ast.Constant) and mode.value in ("w", "r+")


def test_the_formats_page_names_every_driver():
    from mpmgis.terrain.allowed_drivers import RASTER_DRIVERS, VECTOR_DRIVERS

    page = (PACKAGE / "docs" / "formats.md").read_text(encoding="utf-8")
    rows = {line.split("|")[1].strip(): line for line in page.splitlines() if line.startswith("|")}
    for row, drivers in (("rasters", RASTER_DRIVERS), ("vector files", VECTOR_DRIVERS)):
        for driver, words in drivers.items():
            assert f"{words} (`{driver}`)" in rows[row]
        assert rows[row].count("(`") == len(drivers)
