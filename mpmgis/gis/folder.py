"""All files that make an exported folder open in QGIS, in one call; the steps as time bands of one VRT."""

from xml.etree import ElementTree

from ..fields import NODATA
from ..io.raster_meaning import band_metadata, dataset_metadata
from .clock import Clock
from .markup import node, reference_text


def write_stacks(run):
    """Write a VRT for each band of the steps; its band k + 1 is that band of step k, by relative path."""
    decimals = Clock.of(run.times).decimals
    for source_band, quantity in enumerate(run.step_bands, start=1):
        root = _dataset(run, quantity)
        for k in range(len(run.times)):
            root.append(_band(run, k, source_band, quantity, decimals))
        ElementTree.indent(root)
        (run.folder / run.stack_file(quantity)).write_text(
            ElementTree.tostring(root, encoding="unicode"), encoding="utf-8", newline="\n"
        )


def _dataset(run, quantity):
    rows, columns = run.grid.shape
    transform = ", ".join(repr(float(value)) for value in run.grid.transform.to_gdal())
    return node(
        "VRTDataset",
        {"rasterXSize": columns, "rasterYSize": rows},
        node("SRS", text=reference_text(run.grid.crs)),
        node("GeoTransform", text=transform),
        _metadata(dataset_metadata([quantity], {})),
    )


def _metadata(tags):
    return node("Metadata", None, *(node("MDI", {"key": key}, text=value) for key, value in tags.items()))


def _band(run, k, source_band, quantity, decimals):
    return node(
        "VRTRasterBand",
        {"dataType": "Float32", "band": k + 1},
        node("Description", text=f"{quantity.band} at t = {run.times[k]:.{decimals}f} s"),
        _metadata(band_metadata(quantity, run.times[k])),
        node("NoDataValue", text=NODATA),
        node("UnitType", text=quantity.unit),
        node(
            "SimpleSource",
            None,
            node("SourceFilename", {"relativeToVRT": 1}, text=run.step_files[k]),
            node("SourceBand", text=source_band),
        ),
    )


def load():
    """Import the writers and the libraries behind them; half a second that need not be waited for."""
    import netCDF4  # noqa: F401

    from . import folder, mesh, outlines, project, styles

    return mesh, outlines, project, folder, styles


def write_qgis_files(run, release, steps, qgis_min, threads):
    """Write styles, stacks, mesh, outlines and the project.

    Parameters
    ----------
    run : ExportedRun
        With all of its rasters written.
    release : list of shapely polygons or None
    steps : StepSpool
        What its steps held.
    qgis_min : str
        Oldest QGIS that must show the project as it is meant.
    threads : Executor
        Mesh and outlines are written at the same time.
    """
    mesh, outlines, project, folder, styles = load()
    vectors = threads.submit(outlines.write_outlines, run, steps, release)
    folder.write_stacks(run)
    styles.write_styles(run)
    mesh.write_mesh(run, steps, threads)
    vectors.result()
    project.write_project(run, qgis_min)
