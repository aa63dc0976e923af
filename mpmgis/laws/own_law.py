"""User-defined friction laws from a Python file: loading, completion and tests over the range of flows.

Such a law is a NamedTuple of its parameters with either

    basal_stress(self, density, gravity, normal_stress, thickness_normal, speed)  [Pa]

or three methods for the parts into which `friction` splits it, with arithmetic, `math` and `if` only. Kernels call its
`stress_parts`, which is made of these, and its `at_node`.
The file is executed; it is always the one that the user named.
"""

import hashlib
import importlib.util
import inspect
import itertools
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..system.errors import InputError, SceneError, one_line
from .friction import LEAST_SPEED, Parameter

SPLIT = ("dry_stress", "viscous_coefficient", "drag_coefficient")
WHOLE = "basal_stress"
ARGUMENTS = dict.fromkeys((WHOLE, *SPLIT[:2]), ("density", "gravity", "normal_stress", "thickness_normal", "speed"))
ARGUMENTS["drag_coefficient"] = ("gravity", "thickness_normal", "speed")
# test values of a law: density, gravity, thickness normal to the bed [m], tan of the slope, speed
TRIED = ((100.0, 2700.0), (9.81,), (1e-3, 0.1, 1.0, 30.0), (0.0, 0.5, 3.0), (1e-9, 0.01, 1.0, 20.0, 150.0))


class OwnLaws(NamedTuple):
    """The laws of one file: name in a scene (`my_law.py:MyLaw`) -> (law, {parameter: Parameter})."""

    path: str
    sha256: str
    laws: dict


NO_OWN_LAWS = OwnLaws("", "", {})


def load_laws(path: str | Path) -> OwnLaws:
    """Load the laws of a Python file, with the methods that the solver requires.

    Parameters
    ----------
    path : path
        A file with the suffix .py.

    Raises
    ------
    InputError
        No such file, an error in it, or no suitable law in it.
    """
    path = Path(path)
    if path.suffix != ".py":
        raise InputError(f"--law {path}, expected a Python file (.py) with a user-defined law in it")
    try:
        source = path.read_bytes()
    except OSError as error:
        raise InputError(f"--law {path} cannot be read ({one_line(error.strerror or error)})") from error
    sha256 = hashlib.sha256(source).hexdigest()
    module = _executed(path, f"mpmgis_own_law_{sha256[:16]}")
    laws = {}
    for name, kind in vars(module).items():
        if isinstance(kind, type) and kind.__module__ == module.__name__ and hasattr(kind, "_fields"):
            laws[f"{path.name}:{name}"] = _fitted(kind, f"{path.name}:{name}"), _parameters(kind)
    if not laws:
        raise InputError(f"{path} contains no law; expected a class such as MyLaw(NamedTuple) with a method {WHOLE}")
    return OwnLaws(str(path), sha256, laws)


def _executed(path, name):
    """The module of the file, run; known under `name`, by which compiled kernels find its classes again."""
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # no __pycache__ in the folder of the scene
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt):
            raise
        line = getattr(error, "lineno", None) or _line_in(error, path)
        at = f", line {line}" if line else ""
        raise InputError(f"{path}{at}: {type(error).__name__}: {one_line(error)[:160]}") from error
    finally:
        sys.dont_write_bytecode = written
    return module


def _line_in(error, path):
    """Last line of the file at `path` that the error's traceback passed."""
    line, step = None, error.__traceback__
    while step is not None:
        line = step.tb_lineno if step.tb_frame.f_code.co_filename == str(path) else line
        step = step.tb_next
    return line


def _parameters(kind):
    """The law's fields as parameters of a scene, with their defaults."""
    return {
        name: Parameter("its own", "of your law", -math.inf, math.inf, kind._field_defaults.get(name))
        for name in kind._fields
    }


def _fitted(kind, name):
    """`kind` with the methods that the solver calls, made of those that it has."""
    split = [method for method in SPLIT if callable(getattr(kind, method, None))]
    if len(split) == len(SPLIT):
        kind.stress_parts = _parts_of_split
    elif callable(getattr(kind, WHOLE, None)):
        kind.stress_parts = _parts_of_whole
    else:
        missing = ", ".join(method for method in SPLIT if method not in split)
        raise InputError(f"{name} has neither {WHOLE} nor {missing}; give it {WHOLE}")
    _require_signatures(kind, name)
    kind.at_node = _at_node_of(kind)
    return kind


def _parts_of_split(self, density, gravity, normal_stress, thickness_normal, speed):
    return (
        self.dry_stress(density, gravity, normal_stress, thickness_normal, speed),
        self.viscous_coefficient(density, gravity, normal_stress, thickness_normal, speed),
        self.drag_coefficient(gravity, thickness_normal, speed),
    )


def _parts_of_whole(self, density, gravity, normal_stress, thickness_normal, speed):
    """The stress at rest, or at this speed if that is smaller; its increase as the chord from rest to this speed."""
    at_rest = self.basal_stress(density, gravity, normal_stress, thickness_normal, 0.0)
    here = self.basal_stress(density, gravity, normal_stress, thickness_normal, speed)
    return min(at_rest, here), max(here - at_rest, 0.0) / max(speed, LEAST_SPEED), 0.0


def _at_node_of(kind):
    """The method that creates the law from the values of a node, in the form that the compiler requires."""
    values = ", ".join(f"values[j, i, {k}]" for k in range(len(kind._fields)))
    namespace = {"kind": kind}
    exec(f"def at_node(self, values, j, i):\n    return kind({values})", namespace)
    return namespace["at_node"]


def _require_signatures(kind, name):
    """Refuse methods with other arguments than those of the solver, and laws without a parameter."""
    if not kind._fields:
        raise InputError(f"{name} has no parameter, but the compiler requires one; add `null: float = 0.0`")
    for method, arguments in ARGUMENTS.items():
        function = getattr(kind, method, None)
        if function is None:
            continue
        got = list(inspect.signature(function).parameters)
        if len(got) != len(arguments) + 1:
            wanted = ", ".join(["self", *arguments])
            raise InputError(f"{name}.{method} takes ({', '.join(got)}), expected ({wanted})")


def tried_inputs() -> Iterator[tuple[float, float, float, float, float]]:
    """Yield the arguments for which laws are tested.

    Returns
    -------
    iterator of (density, gravity, normal_stress, thickness_normal, speed)
        [kg m-3], [m s-2], [Pa], [m], [m s-1]
    """
    for density, gravity, thickness, slope, speed in itertools.product(*TRIED):
        yield density, gravity, density * gravity * thickness / math.sqrt(1.0 + slope * slope), thickness, speed


def require_sound(law: tuple, name: str) -> None:
    """Refuse a law that in the range of flows fails, accelerates the flow, or gives a number that is not finite.

    Parameters
    ----------
    law : law
    name : str
        Name of the law in a scene, for messages.

    Raises
    ------
    SceneError
        With the method, its result and its arguments.
    """
    for density, gravity, normal_stress, thickness, speed in tried_inputs():
        arguments = {
            "density": density,
            "gravity": gravity,
            "normal_stress": normal_stress,
            "thickness_normal": thickness,
            "speed": speed,
        }
        for method in (WHOLE, *SPLIT):
            if not hasattr(law, method):
                continue
            given = {key: value for key, value in arguments.items() if key in ARGUMENTS[method]}
            _require_value(law, method, given, name)
            if method == WHOLE:
                _require_value(law, method, given | {"speed": 0.0}, name)


def _require_value(law, method, given, name):
    where = ", ".join(f"{key} {value:.4g}" for key, value in given.items())
    try:
        value = float(getattr(law, method)(*given.values()))
    except Exception as error:
        raise SceneError(
            f"{name}.{method} fails ({type(error).__name__}: {one_line(error)[:120]}) at {where}"
        ) from error
    if not (math.isfinite(value) and value >= 0.0):
        raise SceneError(f"{name}.{method} is {value:g} at {where}; it must be finite and at least 0")
