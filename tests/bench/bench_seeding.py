"""Algorithm 1 on the 100 x 100 test of the paper (MOX 15/2025, section 4.1): time, linearity, memory, 1e8 columns."""

import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import shapely
from affine import Affine
from scipy.interpolate import RegularGridInterpolator

from mpmgis.frames.particle_files import write_columns
from mpmgis.seeding.column_seeding import plan_seed, seed_columns
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.release_parts import ReleaseArea, ReleasePart, ThicknessRaster

COUNTS = (10_000, 100_000, 1_000_000, 2_000_000, 4_000_000)
REPEATS = 7
MANY = 100_000_000
FREE_DISK = 20e9  # [bytes] that the case of 1e8 columns wants
PAPER_SECONDS = 25.0  # "never exceeding", for 4e6 particles


def scene(polygon=None):
    """(Terrain, ReleaseArea): 100 x 100 pixels of 1 m, thickness of eq (9) on all of it or on `polygon`."""
    grid = Grid(None, Affine(1, 0, 0, 0, -1, 100), (100, 100))
    x, y = grid.xy(*np.indices(grid.shape))
    hump = ThicknessRaster(1 + 2 * np.exp(-((x - 50) ** 2 + (y - 50) ** 2) / 150), grid)
    part = ReleasePart("psi", polygon or shapely.box(0, 0, 100, 100), hump)
    return Terrain(grid, 500 - 0.4 * x + np.sin(y / 9)), ReleaseArea((part,), "vertical")


def star(vertices):
    """A star-shaped release with the given number of vertices."""
    angle = np.linspace(0, 2 * np.pi, vertices, endpoint=False)
    radius = 40 + 4 * (np.arange(vertices) % 2) * np.random.default_rng(1).random(vertices)
    return shapely.Polygon(np.column_stack((50 + radius * np.cos(angle), 50 + radius * np.sin(angle))))


def seconds(work, repeats=REPEATS):
    """Least time [s] of `work()`, after a first call."""
    work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def with_libraries(terrain, release, count):
    """The same points with common libraries: shapely finds points inside, SciPy interpolates bed and thickness."""
    part = release.parts[0]
    west, south, east, north = part.polygon.bounds
    spacing = np.sqrt(part.polygon.area / count)
    x, y = np.meshgrid(np.arange(west + spacing / 2, east, spacing), np.arange(south + spacing / 2, north, spacing))
    shapely.prepare(part.polygon)
    inside = shapely.contains_xy(part.polygon, x, y)
    points = np.column_stack((y[inside], x[inside]))
    centres = np.arange(100) + 0.5
    values = [
        RegularGridInterpolator((centres, centres), raster[::-1], bounds_error=False, fill_value=None)(points)
        for raster in (terrain.elevation, part.thickness.values)
    ]
    mass = 1000.0 * spacing**2 * values[1]
    return np.column_stack((points[:, ::-1], values[0])), mass


def peak_memory(work):
    """(growth of the resident memory during `work()` [bytes], or None if it is unknown; the result of `work()`)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts again (proc(5))
        start = _status("VmRSS")
        kept = work()
        return _status("VmHWM") - start, kept
    except OSError:
        return None, work()


def _status(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(name))


def rows():
    """Yield (case, value, unit, reference, ratio)."""
    terrain, release = scene()
    times = [seconds(lambda count=count: seed_columns(terrain, release, count=count)) for count in COUNTS]
    for count, taken in zip(COUNTS, times, strict=True):
        reference = seconds(lambda count=count: with_libraries(terrain, release, count), 1)
        name = f"shapely.contains_xy + RegularGridInterpolator {reference:.3g} s"
        yield f"seed {count:,} columns, paper's test", taken, "s", name, taken / reference
    yield "the same, the most", times[-1], "s", f"paper {PAPER_SECONDS:g} s", times[-1] / PAPER_SECONDS
    yield "linearity: R2 of time over columns", linearity(COUNTS, times), "1", "wanted above 0.99", None
    yield from memory_rows(terrain, release)
    yield from other_rows()
    yield from many_rows(terrain, release)


def linearity(counts, times):
    """Coefficient of determination of the straight line through (columns, seconds)."""
    counts, times = np.asarray(counts, float), np.asarray(times)
    left = times - np.polyval(np.polyfit(counts, times, 1), counts)
    return 1 - (left**2).sum() / ((times - times.mean()) ** 2).sum()


def memory_rows(terrain, release):
    """Peak memory of the largest case over the memory of its result."""
    peak, frame = peak_memory(lambda: seed_columns(terrain, release, count=COUNTS[-1]))
    result = sum(values.nbytes for values in frame.particles.arrays().values())
    if peak is None:
        yield "peak memory, 4e6 columns", None, "MB", "this system does not tell", None
    else:
        yield "peak memory, 4e6 columns", peak / 1e6, "MB", f"the result, {result / 1e6:.0f} MB", peak / result


def other_rows():
    """Other point sets and mass modes, and a release with many vertices."""
    terrain, release = scene()
    plain = seconds(lambda: seed_columns(terrain, release, count=COUNTS[-1]), 3)
    for options in ({"points": "jittered"}, {"points": "halton"}, {"points": "random"}, {"mass": "equal"}):
        taken = seconds(lambda options=options: seed_columns(terrain, release, count=COUNTS[-1], **options), 3)
        words = " ".join(options.values())
        yield f"seed {COUNTS[-1]:,} columns, {words}", taken, "s", f"lattice {plain:.3g} s", taken / plain
    yield star_row(201, COUNTS[-1])
    yield star_row(5001, COUNTS[-1])


def star_row(vertices, count):
    """A release with many vertices, against common libraries."""
    terrain, release = scene(star(vertices))
    taken = seconds(lambda: seed_columns(terrain, release, count=count), 3)
    reference = seconds(lambda: with_libraries(terrain, release, count), 1)
    name = f"shapely.contains_xy + RegularGridInterpolator {reference:.3g} s"
    return f"seed {count:,} columns, {vertices} spiky vertices", taken, "s", name, taken / reference


def many_rows(terrain, release):
    """1e8 columns on disk in bounded memory."""
    case = f"{MANY:.0e} columns to .h5"
    with tempfile.TemporaryDirectory() as folder:
        free = shutil.disk_usage(folder).free
        if free < FREE_DISK:
            yield case, None, "s", f"skipped: {free / 1e9:.0f} GB of disk free, wants {FREE_DISK / 1e9:.0f} GB", None
            return
        path = Path(folder) / "many.h5"

        def work():
            plan = plan_seed(terrain, release, count=MANY)
            write_columns(path, plan.empty_frame(), plan.count, plan.slabs())
            return plan.count

        began = time.perf_counter()
        peak, count = peak_memory(work)
        taken, size = time.perf_counter() - began, path.stat().st_size
        path.unlink()
        plain = plain_write(Path(folder) / "plain", size)
        yield (
            f"{count:,} columns to .h5",
            taken,
            "s",
            f"plain write of {size / 1e9:.1f} GB {plain:.0f} s",
            taken / plain,
        )
        if peak is not None:
            yield "the same: peak memory", peak / 1e6, "MB", f"the file, {size / 1e6:.0f} MB", peak / size


def plain_write(path, size):
    """Time [s] to write and sync `size` bytes."""
    block = np.random.default_rng(0).bytes(1 << 24)
    began = time.perf_counter()
    with open(path, "wb") as sink:
        for _ in range(size // len(block)):
            sink.write(block)
        sink.flush()
        os.fsync(sink.fileno())
    return time.perf_counter() - began
