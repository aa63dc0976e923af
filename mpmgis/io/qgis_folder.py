"""All that makes an exported folder open in QGIS by a double click, beside the rasters themselves."""


def load():
    """Import the writers and the libraries behind them; half a second that need not be waited for."""
    import netCDF4  # noqa: F401

    from . import mesh, outlines, qgis, stack, styles

    return mesh, outlines, qgis, stack, styles


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
    mesh, outlines, qgis, stack, styles = load()
    vectors = threads.submit(outlines.write_outlines, run, steps, release)
    stack.write_stacks(run)
    styles.write_styles(run)
    mesh.write_mesh(run, steps, threads)
    vectors.result()
    qgis.write_project(run, qgis_min)
