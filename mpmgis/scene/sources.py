"""What starts to move, as decisions: release, inflow over time, areas that the flow releases."""

from .decisions import as_asked, not_called_for


def decide_hydrograph(scene, facts, slots):
    """Inflow wherever the scene has some; the number is its volume [m3]."""
    table = scene.hydrograph
    if table is None:
        return not_called_for("hydrograph", "no [hydrograph] in the scene")
    if not facts.inflow:
        return as_asked("hydrograph", table.use, "")
    volume, begins, ends, batches = facts.inflow
    reason = f"{volume:.6g} m3, which is the number, from {begins:g} to {ends:g} s, in {batches} batches"
    return as_asked("hydrograph", table.use, reason, volume)


def decide_secondary_release(scene, facts, slots):
    """Secondary areas wherever the scene has some; the number is their mass over that which moves by itself."""
    if not scene.secondary_release:
        return not_called_for("secondary", "no [[secondary_release]] in the scene")
    if facts.secondary is None:
        return as_asked("secondary", "off", "")
    ratio, areas = facts.secondary
    uses = {table.use for table in scene.secondary_release if table.use != "off"}
    word = "1 area" if areas == 1 else f"{areas} areas"
    reason = f"{word}, released when the flow gets there; the number is their mass over the rest's"
    return as_asked("secondary", "on" if uses == {"on"} else "auto", reason, ratio)
