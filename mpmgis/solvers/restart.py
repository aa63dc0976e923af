"""Restarts: the digest of a run's input, and the checks of a saved state.

The digest of a file detects accidental changes. Compiled kernels do not check indices: an index out of range writes
anywhere in memory. All numbers of a state are therefore checked before use.
"""

import hashlib

import numpy as np

from ..errors import FormatError
from ..kernels.point_contact import MOST_YIELD
from ..kernels.point_rows import BLOCK, GHOSTS, MASS, X
from ..peaks import PEAK_STATE


def start_digest(terrain, frame, events, *places, shapes=()):
    """Hex digest of all input that a run reads from the files of its scene.

    It is computed from the data read, not from files: a comment in a table or statistics of a raster have no effect;
    a height in the second file of a virtual raster, or a layer of a database in a folder, has.

    Parameters
    ----------
    terrain : Terrain
    frame : Frame
        The columns at the start.
    events : Events
    places : Places
        Of each stage.
    shapes : sequence of shapely.Geometry
        Further input of stages: windows and end conditions.
    """
    digest = hashlib.sha256()
    crs = terrain.grid.crs
    _add(digest, terrain=terrain.elevation, transform=terrain.grid.transform[:6])
    _add(digest, crs=np.frombuffer(("" if crs is None else crs.to_wkt()).encode(), np.uint8))
    _add_frame(digest, frame)
    for inlet in events.inlets:
        first = np.zeros(1, int)  # the other columns have the same speed, each along its ground
        entry = [inlet.velocity(time, first) for time in inlet.times[:, 0]]
        _add_frame(digest, inlet.frame)
        _add(digest, times=inlet.times, volumes=inlet.volumes, entry=entry, slabs=inlet.slabs)
    for area in events.secondary:
        _add_frame(digest, area.frame)
        _add(digest, trigger=area.trigger_thickness or 0.0)
    for known in places:
        given = {name: values for name, values in vars(known).items() if isinstance(values, np.ndarray)}
        _add(digest, **given)
    for shape in shapes:
        _add(digest, shape=np.frombuffer(shape.wkb, np.uint8))
    return digest.hexdigest()


def _add_frame(digest, frame):
    _add(digest, origin=frame.origin, density=frame.header["density"], **frame.particles.arrays())


def _add(digest, **arrays):
    for name, values in arrays.items():
        values = np.ascontiguousarray(values)
        digest.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        digest.update(values.view(np.uint8).reshape(-1) if values.size else b"")


LARGEST_COUNT = 2**53
YIELD_STATE = ("yield_columns", "yields")  # of points: node columns where the ground yields, and the yield [m]
LEFT_STATE = ("left_blocks", "left_sums")  # of a frame: blocks with outflow and their sums


class StateCheck:
    """Checks of the state of the frame at `time` [s].

    Parameters
    ----------
    time : float [s]
    state : dict of str to array
    """

    def __init__(self, time, state):
        self._time, self._state = time, state

    def require(self, holds, what):
        """Raise FormatError with the message `what` unless `holds`."""
        if not holds:
            raise FormatError(
                f"the frame at t = {self._time:g} s has no valid state for a restart: {what}; start with --overwrite"
            )

    def array(self, name, dtype, shape, finite=True):
        """The array `name`, which must have that type and shape, and finite values by default."""
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray), f"{name} is missing")
        got = f"{name} is {values.dtype}{list(values.shape)}, expected {np.dtype(dtype)}{list(shape)}"
        self.require(values.dtype == dtype and values.shape == tuple(shape), got)
        if finite and values.dtype.kind == "f":
            self.require(np.isfinite(values).all(), f"{name} has values that are NaN or infinite")
        return values

    def within(self, name, values, low, high):
        """Require `values`, called `name` in the message, from `low` to `high`."""
        values = np.asarray(values)
        if values.size:
            least, most = values.min(), values.max()
            self.require(low <= least and most <= high, f"{name} is {least} to {most}, expected {low} to {high}")

    def like(self, arrays):
        """Require each of `arrays` (name -> array) with the same type and shape, finite where `arrays` are."""
        for name, now in arrays.items():
            values = self.array(name, now.dtype, now.shape, finite=False)
            if now.dtype.kind == "f":
                known = np.isfinite(values) | ~np.isfinite(now)
                self.require(known.all(), f"{name} has values that are NaN or infinite")

    def places(self, name, size):
        """The array `name` of flat indices into `size` entries, which ascend."""
        values = self._state.get(name)
        self.require(isinstance(values, np.ndarray) and values.ndim == 1, f"{name} is not a list of indices")
        self.require(values.dtype.kind in "iu", f"{name} is {values.dtype}, expected whole numbers")
        self.within(name, values, 0, size - 1)
        self.require((np.diff(values.astype(np.int64)) > 0).all(), f"{name} is not in order")
        return values

    def counts(self, kernel, alive):
        """Counts of a solver with the module `kernel` that has `alive` particles."""
        counts = self._state["counts"]
        names = {kernel.ROWS: "the number of rows", kernel.ALIVE: "of particles"}
        for place, name in names.items():
            self.require(counts[place] == alive, f"{name} in counts is {counts[place]}, expected {alive}")
        self.within("the number of particles that are not finite", counts[kernel.BAD], 0, 0)
        self.within("the number of steps", counts[kernel.STEP], 0, LARGEST_COUNT)
        self.within("the number of steps since the last sort", counts[kernel.SINCE_REORDER], 0, LARGEST_COUNT)
        self.require(self._state["clock"][kernel.TIME] == self._time, "the time in its clock differs")

    def peaks(self, peaks):
        """Check running peaks at some of the nodes of `peaks` [rows, columns, entries]."""
        values, where = PEAK_STATE
        nodes = self.places(where, peaks[..., 0].size)
        self.array(values, peaks.dtype, (len(nodes), peaks.shape[-1]))

    def left(self, sums):
        """Check sums of the outflow at some of the entries of `sums` [ways, blocks, blocks, entries]."""
        blocks = self.places(LEFT_STATE[0], sums[..., 0].size)
        self.array(LEFT_STATE[1], sums.dtype, (len(blocks), sums.shape[-1]))


def require_column_state(frame, solver, changing):
    """Refuse a `frame` without a valid state of the ColumnSolver `solver`; `changing` are the arrays of that state.

    Raises
    ------
    FormatError
    """
    kernel, state, n = solver.kernel, frame.state, len(frame.particles.id)
    check = StateCheck(frame.time, state)
    ny, nx = solver.grid.inside.shape
    rows = check.array("rows", np.float64, (n, kernel.ROW))
    check.like(changing)
    check.counts(kernel, n)
    size = solver.grid.cell_size
    check.within("the place of a column east of the domain's corner [m]", rows[:, kernel.X], 0.0, nx * size)
    check.within("the place of a column north of the domain's corner [m]", rows[:, kernel.Y], 0.0, ny * size)
    for name, column in (("mass [kg]", kernel.MASS), ("area [m2]", kernel.AREA)):
        check.within(f"the {name} of a column", rows[:, column], np.nextafter(0.0, 1.0), np.finfo(float).max)
    _require_window(check, kernel, rows, size, state["counts"], ((nx + 2) // kernel.BLOCK, (ny + 2) // kernel.BLOCK))
    nodes = (ny + 3) * (nx + 3)
    check.within("the number of wet nodes", state["counts"][kernel.WET], 0, nodes)
    check.array("reached", np.uint8, (ny + 3, (nx + 3 + 7) // 8))
    check.left(solver.left_sums)
    if solver.numerics.maxima:
        check.peaks(solver.peaks)


def _require_window(check, kernel, rows, size, counts, last):
    """Require that the window of blocks in `counts` contains the columns of `rows` and ends at blocks `last`."""
    if not len(rows):
        return
    keys = np.zeros(len(rows), np.int32)
    west, south, east, north = kernel.initial_keys(np.ascontiguousarray(rows), keys, size)
    check.within("the west of the window of blocks", counts[kernel.WEST], 0, west)
    check.within("the south of the window of blocks", counts[kernel.SOUTH], 0, south)
    check.within("the east of the window of blocks", counts[kernel.EAST], east, last[0])
    check.within("the north of the window of blocks", counts[kernel.NORTH], north, last[1])


def require_point_state(frame, solver, changing, like):
    """As `require_column_state`, for a PointSolver; `like` is an array of rows of its type and width.

    Raises
    ------
    FormatError
    """
    kernel, state, n = solver.kernel, frame.state, len(frame.particles.id)
    check = StateCheck(frame.time, state)
    rows = check.array("rows", like.dtype, (n, like.shape[-1]))
    keys = check.array("keys", np.int64, (n,))
    check.like(changing)
    check.counts(kernel, n)
    for axis in range(3):
        check.within("the place of a point in its block [cells]", rows[:, X + axis], 0.0, BLOCK + 1.0)
    tiny = np.finfo(like.dtype).smallest_subnormal
    check.within("the mass of a point [kg]", rows[:, MASS], tiny, np.finfo(like.dtype).max)
    row, column = kernel.rows_and_columns(keys)
    for name, blocks, cells in (("row", row, solver.grid.inside.shape[0]), ("column", column,
                                solver.grid.inside.shape[1])):  # fmt: skip
        check.within(f"the block {name} of a point", blocks, 0, (cells + GHOSTS) // BLOCK)
    check.left(solver.left_sums)
    _require_yields(check, solver)
    if solver.numerics.maxima:
        check.peaks(solver.peaks)
    for name, shape in (("stress", (n, 6)), ("affine", (n, 3, 3))):
        if name in state:
            check.array(name, np.float64, shape)


def _require_yields(check, solver):
    """Check the yields [m] of the ground at some node columns, from 0 to the largest possible yield."""
    where, yields = YIELD_STATE
    columns = check.places(where, solver.yields[0, ..., 0].size)
    values = check.array(yields, np.float64, (len(columns),))
    most = MOST_YIELD * solver.grid.cell_size * (1.0 + 1e-6)
    check.within("the yield of the ground [m]", values, 0.0, most)
