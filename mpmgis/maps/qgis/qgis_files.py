"""Write all QGIS files of an exported folder in one call, and VRT stacks with the steps as bands."""

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from ...laws.quantities import NODATA
from ...terrain.raster_tags import band_metadata, dataset_metadata
from .map_clock import Clock
from .xml_markup import node, reference_text

if TYPE_CHECKING:
    from ..averaging.exported_folder import ExportedRun
    from .outlines import StepSpool


def write_stacks(run: "ExportedRun") -> None:
    """Write a VRT for each band of the steps and of layers of height; band k + 1 refers to step k by relative path.

    Parameters
    ----------
    run : ExportedRun
    """
    decimals = Clock.of(run.times).decimals
    stacked = [(run.step_files, *numbered) for numbered in enumerate(run.step_bands, start=1)]
    stacked += [(run.layer_files, *numbered) for numbered in enumerate(run.layer_bands, start=1)]
    for files, source_band, quantity in stacked:
        root = _dataset(run, quantity)
        for k in range(len(run.times)):
            root.append(_band(files[k], run.times[k], source_band, quantity, k, decimals))
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


def _band(file, time, source_band, quantity, k, decimals):
    return node(
        "VRTRasterBand",
        {"dataType": "Float32", "band": k + 1},
        node("Description", text=f"{quantity.band} at t = {time:.{decimals}f} s"),
        _metadata(band_metadata(quantity, time)),
        node("NoDataValue", text=NODATA),
        node("UnitType", text=quantity.unit),
        node(
            "SimpleSource",
            None,
            node("SourceFilename", {"relativeToVRT": 1}, text=file),
            node("SourceBand", text=source_band),
        ),
    )


def load() -> tuple:
    """Import the writers and their libraries in advance (0.5 s)."""
    import netCDF4  # noqa: F401

    from . import flow_mesh, outlines, project, project_layers, raster_styles

    return flow_mesh, outlines, project, raster_styles, project_layers


def write_qgis_files(
    run: "ExportedRun", release: Sequence | None, steps: "StepSpool", qgis_min: str, threads: Executor
) -> None:
    """Write styles, stacks, mesh, outlines and the project.

    Parameters
    ----------
    run : ExportedRun
        With all of its rasters written.
    release : list of shapely polygons or None
    steps : StepSpool
        Data of its steps.
    qgis_min : str
        Oldest QGIS version that must animate the project.
    threads : Executor
        Mesh and outlines are written at the same time.
    """
    mesh, outlines, project, styles, surface = load()
    vectors = threads.submit(outlines.write_outlines, run, steps, release)
    write_stacks(run)
    surface.write_surface(run)
    styles.write_styles(run)
    mesh.write_mesh(run, steps, threads)
    vectors.result()
    project.write_project(run, qgis_min)
