"""The exporter: particles per second against maximum.at and bincount of NumPy, and the whole command."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyproj
from avalanche_frames import END_TIME, write_frames

from mpmgis.exchange.frame_list import list_frames
from mpmgis.frames.frame_files import write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import BAND, Quantity
from mpmgis.maps.averaging import binning, cell_places
from mpmgis.maps.averaging.cell_averages import bin_frame
from mpmgis.maps.averaging.export_resolution import export_grid
from mpmgis.maps.averaging.frame_values import Averaging, average_frame
from mpmgis.maps.averaging.placement import Bed, place
from mpmgis.maps.qgis.flow_mesh import step_chunks
from mpmgis.maps.qgis.outlines import BANDS, StepSpool, step_outline
from mpmgis.terrain.dtm import read_terrain
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import SparseBands, write_geotiff, write_rows

FRAMES, COUNT, REPEATS = 40, 500_000, 15
BUDGET, STARTUP = 250.0, 1.5  # ns per particle and frame; s
# The job of Vicari et al. (2025): points, frames, cells [m], and the time allowed for it on two cores
POINTS, JOB_FRAMES, CELLS, SECONDS, MEGABYTES = 900_000, 750, 1.0, 180.0, 2000.0
SIDE = 1.25  # 16 columns a DTM cell of 5 m
ORIGIN = np.array([600000.0, 5167000.0, 0.0])


def surface(x, y):
    """A rough slope [m]."""
    return 2500 - 0.5 * x + 40 * np.sin(y / 300) + 10 * np.cos(x / 90)


def ground(rows=1000):
    """Ground of `rows` x 1000 pixels of 5 m; the last pixel is always at the same place."""
    grid = Grid.north_up(pyproj.CRS.from_epsg(32632), 600000.0, 5167000.0 + 5 * rows, 5.0, (rows, 1000))
    x, y = grid.xy(*np.mgrid[:rows, :1000])
    return Terrain(grid, surface(x - ORIGIN[0], y - ORIGIN[1]))


def flow(step, dimension, count=COUNT):
    """Frame number `step` of a sheet that slides and shears."""
    per_row = int(np.sqrt(count))
    i = np.arange(count)
    x, y = 500 + (i % per_row) * SIDE + 30.0 * step, 2000 + (i // per_row) * SIDE
    x, y = x + np.sin(y / 50) * step * 5, y + np.cos(x / 70) * step * 3
    thickness = 1.0 + 0.5 * np.sin(i / 1000)
    height = surface(x, y)
    if dimension == 3:
        height = height + np.random.default_rng(step).random(count) * 2 * thickness
    velocity = np.stack([20 + 0 * x, 5 * np.sin(y / 100), -10 + 0 * x], axis=1)
    volume = SIDE**2 * thickness
    extra = {"thickness": thickness, "area": np.full(count, SIDE**2)} if dimension == 2 else {}
    particles = Particles(np.stack([x, y, height], axis=1), velocity, 1000 * volume, volume, id=i.astype("u8"), **extra)
    return Frame(
        particles,
        time=2.0 * step,
        step=step,
        dimension=dimension,
        crs=pyproj.CRS.from_epsg(32632),
        origin=tuple(ORIGIN),
        dem="terrain.tif",
        digest="bench",
        header={"density": 1000.0},
    )


def least(work, repeats=REPEATS):
    """Least time [s] of `work()`, after a first call."""
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def moments_with_numpy(cell, distance, velocity, mass, cells):
    """Results of `bin_points` in NumPy: the highest, the lowest, the number and the sums over mass."""
    top, lowest = np.full(cells, -np.inf), np.full(cells, np.inf)
    np.maximum.at(top, cell, distance)
    np.minimum.at(lowest, cell, distance)
    sums = [np.bincount(cell, minlength=cells), np.bincount(cell, mass, cells)]
    return top, lowest, sums + [np.bincount(cell, mass * velocity[:, axis], cells) for axis in range(3)]


def binning_rows():
    """Time of binning alone: from cells and distances to the moments of each cell."""
    terrain, frame = ground(), flow(3, 3)
    bed, grid, n = Bed.of(terrain), export_grid(terrain.grid), COUNT
    particles, placed = frame.particles, place(frame, bed)
    row, column, bounds = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(4, np.int64)
    origin = np.asarray(frame.origin)
    cell_places.cells_of_points(
        particles.position, placed.pixel, origin, grid.corner, grid.axes, grid.shape, False, row, column, bounds
    )
    records = np.empty((min(n, binning.SLAB), binning.RECORD))
    flat = row.astype(np.int64) * grid.shape[1] + column

    def ours():
        window = np.zeros((bounds[1] - bounds[0], bounds[3] - bounds[2]), np.int32)
        binning.mark_points(row, column, bounds, window)
        k = int(window.sum())
        cells = np.empty(k, np.int64)
        binning.number_cells(window, bounds, grid.shape[1], cells)
        tiles = [-(-length // binning.TILE) for length in window.shape]
        table, start = np.empty((k, binning.ROW)), np.empty(tiles[0] * tiles[1] + 1, np.int64)
        points = binning.PointsInCells(
            row, column, placed.pixel, placed.distance, particles.velocity, particles.mass, particles.volume
        )
        binning.bin_points(points, bounds, window, bed.gradient_by_pixel, table, records, start)
        return cells, table[:, binning.TOP], table[:, binning.LOWEST], table[:, binning.COUNT]

    def numpys():
        return moments_with_numpy(
            flat, placed.distance, particles.velocity, particles.mass, grid.shape[0] * grid.shape[1]
        )

    cells, top, lowest, count = ours()
    expected = numpys()
    assert np.array_equal(top, expected[0][cells]) and np.array_equal(lowest, expected[1][cells])
    assert np.array_equal(count, expected[2][0][cells])
    mine, reference = n / least(ours), n / least(numpys)
    text = f"NumPy maximum.at, minimum.at, 5 bincount: {reference / 1e6:.1f} M/s"
    yield "binning points, 12 sums and 2 extremes", mine / 1e6, "M particles/s", text, mine / reference


def frame_rows():
    """Time from a frame in memory to the sums of its cells."""
    terrain = ground()
    bed, grid = Bed.of(terrain), export_grid(terrain.grid)
    for dimension, percentile in ((2, 100.0), (3, 100.0), (3, 90.0)):
        frame = flow(3, dimension)
        seconds = least(lambda f=frame, p=percentile: bin_frame(f, place(f, bed), bed, grid, 1000.0, p))
        name = f"{'columns' if dimension == 2 else 'points'} to cells, percentile {percentile:g}, one thread"
        yield name, seconds / COUNT * 1e9, "ns/particle", None, None


def command(*words):
    """(time [s], peak memory [MB]) of `mpmgis export-raster` with the arguments `words`, in a separate process."""
    words = [sys.executable, "-m", "mpmgis", "export-raster", *map(str, words), "-q", "--overwrite"]
    began = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    return time.perf_counter() - began, used.ru_maxrss / 1024


def command_rows():
    """The whole command with the QGIS folder; one frame of 100 columns on a smaller DTM gives the start-up time."""
    with tempfile.TemporaryDirectory() as place_for_runs:
        runs = Path(place_for_runs)
        small = _write(runs / "small", 1, 2, 100, rows=410)
        command(small)  # compiles, once for all
        startup = min(command(small)[0] for _ in range(3))
        yield (
            "export-raster: start-up, one frame of 100 columns",
            startup,
            "s",
            f"budget {STARTUP} s",
            startup / STARTUP,
        )
        for dimension, kind in ((2, "columns"), (3, "points")):
            run = _write(runs / kind, FRAMES, dimension, COUNT)
            seconds = min(command(run)[0] for _ in range(3)) - startup
            value = seconds / (FRAMES * COUNT) * 1e9
            case = f"export-raster: {FRAMES} frames of {COUNT} {kind}, QGIS folder"
            yield case, value, "ns/particle/frame", f"budget {BUDGET:.0f} ns", value / BUDGET


SCATTERED = 150.0  # ns per particle and frame that points in random order may take


def scattered(step, count=COUNT, east=300.0, north=400.0):
    """Frame number `step` of points in random order over `east` x `north` [m], which slide by 5 m per frame."""
    random = np.random.default_rng(0)
    x, y = 500 + random.random(count) * east + 5.0 * step, 2000 + random.random(count) * north
    height = surface(x, y) + 3.0 * random.random(count)
    velocity = np.stack([20 + 0 * x, 5 * np.sin(y / 50), -6 + 0 * x], axis=1)
    volume = np.full(count, east * north * 1.5 / count)
    particles = Particles(
        np.stack([x, y, height], axis=1), velocity, 1000 * volume, volume, id=np.arange(count, dtype="u8")
    )
    return Frame(
        particles,
        time=0.5 * step,
        step=step,
        dimension=3,
        crs=pyproj.CRS.from_epsg(32632),
        origin=tuple(ORIGIN),
        dem="terrain.tif",
        digest="bench",
        header={"density": 1000.0, "cell_size": 1.0},
    )


def scattered_rows():
    """Points in random order on cells of 1 m: time of the whole command minus that of two frames."""
    with tempfile.TemporaryDirectory() as place_for_runs:
        run = _write(
            Path(place_for_runs) / "scattered", FRAMES, 3, COUNT, rows=500, frame_of=lambda k, *_: scattered(k)
        )
        frames = sorted(run.glob("*.h5"))
        command(*frames[:1], "--cs-e", CELLS)  # compiles
        few = min(command(*frames[:2], "--cs-e", CELLS)[0] for _ in range(3))
        seconds = min(command(run, "--cs-e", CELLS)[0] for _ in range(3)) - few
        value = seconds / ((FRAMES - 2) * COUNT) * 1e9
        case = f"export-raster: {FRAMES} frames of {COUNT} points in random order, {CELLS:g} m, QGIS folder"
        yield case, value, "ns/particle/frame", f"budget {SCATTERED:.0f} ns", value / SCATTERED


def _write(folder, frames, dimension, count, rows=1000, frame_of=flow):
    folder.mkdir()
    terrain = ground(rows)
    write_geotiff(folder / "terrain.tif", terrain.grid, [(Quantity("elevation", "m", ""), terrain.elevation)], {})
    for step in range(frames):
        write_frame(folder / f"frame_{step:06d}.h5", frame_of(step, dimension, count))
    return folder


def job_rows():
    """The job of 900 000 points and 750 frames: measured on 40 frames of the whole event, then for each phase."""
    with tempfile.TemporaryDirectory() as place_for_runs:
        runs = Path(place_for_runs)
        frames = write_frames(runs / "avalanche", np.linspace(0.0, END_TIME, FRAMES), POINTS)
        options = ("--cs-e", CELLS, "--extent", "dtm")
        command(*frames[:1], *options)  # compiles
        startup = min(command(*frames[:1], *options)[0] for _ in range(3))
        what = f"export-raster, {FRAMES} frames of {POINTS} points, {CELLS:g} m"
        rasters = min(command(*frames, *options, "--no-qgis")[0] for _ in range(3)) - startup
        yield f"{what}: rasters only", rasters / (FRAMES - 1) * 1e3, "ms/frame", None, None
        both = [command(*frames, *options) for _ in range(3)]
        seconds, memory = min(both)[0] - startup, max(peak for _, peak in both)
        each, budget = seconds / (FRAMES - 1), SECONDS / JOB_FRAMES
        yield f"{what}: QGIS folder", each * 1e3, "ms/frame", f"budget {budget * 1e3:.0f} ms", each / budget
        whole = startup + each * (JOB_FRAMES - 1)
        yield f"the same, extrapolated to {JOB_FRAMES} frames", whole, "s", f"budget {SECONDS:.0f} s", whole / SECONDS
        yield "the same, peak memory", memory, "MB", f"budget {MEGABYTES:.0f} MB", memory / MEGABYTES
        yield from phase_rows(frames[FRAMES // 2], runs)


def phase_rows(path, folder):
    """Time of each phase of one frame, on one thread."""
    (entry,), ground = list_frames([path]), read_terrain(path.parent / "terrain.tif")
    grid = export_grid(ground.grid, CELLS)
    averaging = Averaging(Bed.of(ground), grid, 850.0, ("h", "t", "Un", "Ut", "Ut_E", "Ut_N", "t_vol", "p"))
    frame = entry.read()
    values = average_frame(frame, averaging)
    bands, names, steps = values.values, ("h", "t", "Un", "Ut"), StepSpool(folder / "spool")
    outline = step_outline(values.index, bands["h"], bands["Ut"], grid, 0.05)
    steps.add(values.index, bands, outline)
    sparse = SparseBands(grid, values.index, [(bands[n], 0.0 if n in "ht" else np.nan) for n in names])
    phases = {
        "reading": entry.read,
        "averaging": lambda: average_frame(frame, averaging),
        "outline": lambda: step_outline(values.index, bands["h"], bands["Ut"], grid, 0.05),
        "raster of four bands": lambda: write_rows(folder / "x.tif", grid, [BAND[n] for n in names], {}, sparse),
        "mesh": lambda: step_chunks(steps, 0, values.index, BANDS),
    }
    for name, work in phases.items():
        yield f"a frame of {POINTS} points: {name}, one thread", least(work, 5) * 1e3, "ms", None, None


def rows():
    """(case, value, unit, reference, ratio) of every measurement."""
    yield from binning_rows()
    yield from frame_rows()
    yield from command_rows()
    yield from scattered_rows()
    yield from job_rows()
