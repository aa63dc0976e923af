"""A small exported run without a solver: a blob that slides down a rough hill, 12 steps of 0.2 s."""

import itertools
import zipfile
from xml.etree import ElementTree

import numpy as np
import rasterio

from mpmgis.frames.flow_end import FlowEnd
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import BAND, NODATA
from mpmgis.maps.averaging.exported_folder import ExportedRun
from mpmgis.maps.qgis.flow_mesh import write_mesh
from mpmgis.maps.qgis.outlines import BANDS, StepSpool, shown_particles, step_outline, write_outlines
from mpmgis.maps.qgis.project import write_project
from mpmgis.maps.qgis.project_layers import write_surface
from mpmgis.maps.qgis.qgis_files import write_stacks
from mpmgis.maps.qgis.raster_styles import write_styles
from mpmgis.terrain.grid import Grid

_numbers = itertools.count()

STEPS = ("h", "t", "Un", "Ut")
MAXIMA = ("h_max", "t_max", "Un_max", "Un_min", "Ut_max", "p_max", "t_arrival")
DEPOSIT = ("h", "t", "t_vol")


def make_run(folder, crs, name="slide", times=None, shape=(120, 160), step_bands=STEPS, corner=(686000.0, 5212000.0)):
    """An ExportedRun in `folder`, its rasters written."""
    times = tuple(np.round(0.2 * np.arange(12), 10)) if times is None else tuple(times)
    grid = Grid.north_up(crs, *corner, 5.0, shape)
    x, y = grid.xy(*np.indices(shape))
    x, y = x - corner[0], y - corner[1]
    write(folder / "dtm.tif", grid, ("elevation",), [hill(x, y)])
    largest, steps, peaks = {}, [], None
    for k, time in enumerate(times):
        fields = blob(x, y, k / max(len(times) - 1, 1), grid)
        values = [fields[band] for band in step_bands]
        (folder / "rasters").mkdir(exist_ok=True)
        steps.append(f"rasters/{name}_{k:04d}.tif")
        write(folder / steps[-1], grid, [BAND[band].band for band in step_bands], values)
        for band in step_bands:
            largest[band] = max(largest.get(band, 0.0), float(np.nanmax(np.abs(fields[band]))))
        peaks = peak(peaks, fields, time)
    write(folder / "rasters" / f"{name}_max.tif", grid, [BAND[b].band for b in MAXIMA], [peaks[b] for b in MAXIMA])
    write(
        folder / "rasters" / f"{name}_deposit.tif", grid, [BAND[b].band for b in DEPOSIT], [fields[b] for b in DEPOSIT]
    )
    return ExportedRun(
        folder=folder,
        name=name,
        grid=grid,
        terrain_file="dtm.tif",
        times=times,
        step_files=tuple(steps),
        step_bands=tuple(BAND[band] for band in step_bands),
        maxima_file=f"rasters/{name}_max.tif",
        maxima_bands=tuple(BAND[band] for band in MAXIMA),
        last_bands=tuple(BAND[band] for band in DEPOSIT),
        end=FlowEnd(times[-1], 0.0, True),
        largest=largest,
        min_depth=0.05,
    )


def hill(x, y):
    """Elevation [m] of a slope that falls to the south-east, with gullies and roughness."""
    slope = 1500.0 - 0.45 * x + 0.30 * y
    return slope + 15.0 * np.sin(x / 60.0) * np.cos(y / 45.0) + 4.0 * np.sin((x + 2 * y) / 17.0)


def blob(x, y, progress, grid):
    """Fields of a paraboloid of flow `progress` (0 to 1) of its way down."""
    width, height = grid.shape[1] * 5.0, grid.shape[0] * 5.0
    centre = (width * (0.2 + 0.5 * progress), -height * (0.2 + 0.5 * progress))
    radius = 60.0 * width / 800.0 * (1.0 + progress)
    rest = ((x - centre[0]) / radius) ** 2 + ((y - centre[1]) / (0.6 * radius)) ** 2
    h = np.clip(4.0 / (1.0 + progress) * (1.0 - rest), 0.0, None)
    speed = np.where(h >= 0.05, 24.0 * np.sin(np.pi * (0.1 + 0.8 * progress)) * (1 - 0.5 * rest), np.nan)
    direction = np.array([width, -height]) / np.hypot(width, height)
    normal = np.where(h >= 0.05, 1.5 * (x - centre[0]) / radius, np.nan)
    return {
        "h": h,
        "t": 0.9 * h,
        "t_vol": 0.6 * h,
        "Un": normal,
        "Ut": speed,
        "Ut_E": speed * direction[0],
        "Ut_N": speed * direction[1],
        "p": 300.0 * speed**2,
    }


def peak(peaks, fields, time):
    """Running maxima with the fields of one more step; NaN without flow."""
    wet = np.where(fields["h"] > 0, 1.0, np.nan)
    new = {f"{name}_max": fields[name] * wet for name in ("h", "t", "Un", "Ut", "p")}
    new |= {"Un_min": fields["Un"] * wet, "t_arrival": np.where(fields["h"] >= 0.05, time, np.nan)}
    if peaks is None:
        return new
    return {n: (np.fmin if n in ("Un_min", "t_arrival") else np.fmax)(peaks[n], new[n]) for n in new}


def write(path, grid, descriptions, bands):
    """A GeoTIFF with the layout of an export."""
    rows, columns = grid.shape
    path.parent.mkdir(exist_ok=True)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=columns,
        height=rows,
        count=len(bands),
        dtype="float32",
        crs=grid.crs,
        transform=grid.transform,
        nodata=NODATA,
        tiled=True,
        blockxsize=256,
        blockysize=256,
        compress="deflate",
        predictor=3,
        interleave="band",
        sparse_ok=True,
    ) as file:
        for k, (description, band) in enumerate(zip(descriptions, bands, strict=True), start=1):
            file.write(np.where(np.isfinite(band), band, NODATA).astype("float32"), k)
            file.set_band_description(k, description)


def steps(run, arrows=True, count=5000):
    """The StepSpool of the steps: values of the blob in wet cells, and a cloud of particles."""
    spool = StepSpool(run.folder.parent / f"{run.folder.name}_steps_{next(_numbers)}")
    x, y = run.grid.xy(*np.indices(run.grid.shape))
    x, y = x - run.grid.transform.c, y - run.grid.transform.f
    for k, cloud in enumerate(particles(run, count)):
        fields = blob(x, y, k / max(len(run.times) - 1, 1), run.grid)
        index = np.flatnonzero(fields["h"] > 0)
        names = BANDS if arrows else BANDS[:4]
        values = {name: fields[name].ravel()[index].astype(np.float32) for name in names}
        outline = step_outline(index, values["h"], values["Ut"], run.grid, run.min_depth)
        spool.add(index, values, outline, shown_particles(cloud, count) if count else None)
    return spool


def particles(run, count):
    """Yield frames of a cloud of particles that moves with the blob."""
    cloud = np.random.default_rng(1).normal(size=(count, 2)) * [30.0, 18.0]
    west, south, east, north = run.grid.bounds
    for k, time in enumerate(run.times):
        progress = k / max(len(run.times) - 1, 1)
        x = (east - west) * (0.2 + 0.5 * progress) + cloud[:, 0]
        y = -(north - south) * (0.2 + 0.5 * progress) + cloud[:, 1]
        flow = np.tile([8.0, -6.0, -3.0], (count, 1)) * (0.2 + progress)
        place = np.stack([x, y, hill(x, y)], axis=1)
        cloud_now = Particles(place, flow, np.ones(count), np.ones(count), id=np.arange(count, dtype=np.uint64))
        yield Frame(cloud_now, time=float(time), dimension=3, origin=(west, north, 0.0))


def write_all(run, release=None, qgis_min="3.38"):
    """Write all files except the rasters, in the order of the export."""
    kept = steps(run)
    write_styles(run)
    write_stacks(run)
    write_surface(run)
    write_mesh(run, kept)
    write_outlines(run, kept, release)
    write_project(run, qgis_min)
    return run


def project_root(run):
    """The project's XML."""
    with zipfile.ZipFile(run.folder / run.project_file) as archive:
        (inner,) = archive.namelist()
        return ElementTree.fromstring(archive.read(inner))
