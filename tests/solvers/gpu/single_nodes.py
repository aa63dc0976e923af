"""The CPU's 3D step with its work on nodes in single precision, as the device does it for float32 points.

The functions are compiled for the processor from the copies that `device_functions` makes for the device.
"""

from functools import cache
from types import FunctionType

import numba
import numpy as np

from mpmgis.compiled.float32_constants import global_names, single, single_code
from mpmgis.compiled.jit import FASTMATH
from mpmgis.solvers.gpu.device_functions import SMALL
from mpmgis.solvers.points import (
    bed_drag,
    contact_shares,
    ground_contact,
    point_barriers,
    point_crests,
    point_density,
    point_faces,
    point_ground,
    point_layers,
    point_loop,
    point_nodes,
    point_peaks,
)
from mpmgis.solvers.points.point_rows import Settings
from mpmgis.solvers.points.point_solver import PointSolver

PHASES = {  # of `point_loop.advance`, by their names there
    "move_nodes": point_nodes.move_nodes,
    "weigh_contact": bed_drag.weigh_contact,
    "couple_layers": point_layers.couple_layers,
    "press_on_ground": ground_contact.press_on_ground,
    "press_on_faces": point_faces.press_on_faces,
    "press_on_crests": point_crests.press_on_crests,
    "hold_nodes": point_nodes.hold_nodes,
    "correct_density": point_density.correct_density,
}
ON_NODES = {module.__name__ for module in (contact_shares, point_barriers, point_ground, point_peaks)}
ON_NODES |= {kernel.py_func.__module__ for kernel in PHASES.values()}
CHANGED = ("peaks", "yields", "face_yields")  # arrays of the state in single precision
FIXED = ("zone_values", "barriers", "faces")  # arrays of the places in single precision


@cache
def in_single(kernel):
    """The compiled `kernel` in single precision, with all functions on nodes that it calls."""
    plain = kernel.py_func
    names = plain.__globals__ | {"float": np.float32}
    for name in global_names(plain.__code__):
        if name not in names:
            continue
        value = names[name]
        called = getattr(value, "py_func", None)
        on_nodes = called is not None and called.__module__ in ON_NODES
        names[name] = in_single(value) if on_nodes else single(value, SMALL)
    copy = FunctionType(single_code(plain.__code__, SMALL), names, plain.__name__, plain.__defaults__)
    return numba.njit(fastmath=FASTMATH, error_model="numpy")(copy)


@cache
def phase(kernel):
    """The compiled `kernel` in single precision for a caller that has its numbers in double precision."""
    code = kernel.py_func.__code__
    names = code.co_varnames[: code.co_argcount]
    casts = {name: f"np.float32({name})" for name in ("dt", "dx", "clearance")} | {"settings": "of_nodes(settings)"}
    call = f"kernel({', '.join(casts.get(name, name) for name in names)})"
    return written(f"def phase({', '.join(names)}):\n    return {call}", kernel=in_single(kernel), of_nodes=of_nodes())


@cache
def of_nodes():
    """Compiled function that makes Settings in single precision."""
    kinds = Settings.__annotations__.items()
    values = ", ".join(f"np.float32(s.{name})" if kind in (float, "float") else f"s.{name}" for name, kind in kinds)
    return written(f"def phase(s):\n    return Settings({values})", Settings=Settings)


def written(source, **names):
    """The compiled function `phase` of a `source`."""
    names["np"] = np
    exec(source, names)
    return numba.njit(error_model="numpy")(names["phase"])


@cache
def advance():
    """`point_loop.advance` with its PHASES in single precision."""
    plain = point_loop.advance.py_func
    names = plain.__globals__ | {name: phase(kernel) for name, kernel in PHASES.items()}
    return numba.njit(error_model="numpy")(FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__))


def law(values):
    """A law with parameters in single precision."""
    return type(values)(*(single(value, SMALL) for value in values))


def in_float32(record, names):
    """A `record` whose arrays with these `names` are in single precision."""
    return record._replace(**{name: np.ascontiguousarray(getattr(record, name), np.float32) for name in names})


class SingleNodes(PointSolver):
    """A 3D solver for float32 points whose ground, contact, layers and density are in single precision."""

    def _take_steps(self, until, after, max_steps):
        state, places = in_float32(self.arrays, CHANGED), in_float32(self._kernel_places(), FIXED)
        ground = places.ground
        ground = ground._replace(nodes=ground.nodes.astype(np.float32), exact=ground.exact.astype(np.float32))
        effects = self._effects._replace(contact=law(self._effects.contact))
        places = places._replace(ground=ground)
        reason = advance()(state, places, self._order, until, after, max_steps, self._settings, effects)
        for name in CHANGED:
            getattr(self.arrays, name)[...] = getattr(state, name)
        return reason
