"""Errors of the depth-averaged solver against exact answers, at three resolutions: README's table of accuracy."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "solvers"))
from column_scenes import dam_break, relative_l1

from mpmgis.effects.metric import WaterMetric

CELLS = (1.0, 0.5, 0.25)
# case -> (arguments of dam_break, where the error counts [m from the dam], errors of the prototype [%])
CASES = {
    "Ritter, dry dam break": ({"metric": WaterMetric()}, None, (2.3, 1.95, 1.8)),
    "Stoker, dam break on a wet bed": ({"metric": WaterMetric(), "tail": 1.0}, None, (1.20, 0.67, 0.34)),
    "dam break on a 22 degree slope, no friction": ({"degrees": 22}, -50, (2.65, 2.05, None)),
    "dam break on 30 degrees, friction 20": ({"degrees": 30, "friction_degrees": 20}, -50, (2.65, 2.05, None)),
    "dam break on 35 degrees, friction 25": ({"degrees": 35, "friction_degrees": 25}, -50, (2.65, 2.05, None)),
}


def rows():
    """Rows of the table: relative L1 error of the depth, and its ratio to the prototype's (design notes 6)."""
    for case, (arguments, start, published) in CASES.items():
        longer = {"reservoir": 80, "length": 160} if "degrees" in arguments else {}
        for dx, before in zip(CELLS, published, strict=True):
            x, h, exact, _ = dam_break(dx, **arguments, **longer)
            error = 100 * relative_l1(h, exact, x > start if start is not None else slice(None))
            reference = f"prototype {before:g} %" if before else "exact answer"
            yield f"{case}, cells {dx:g} m", error, "% of depth (L1)", reference, error / before if before else None
