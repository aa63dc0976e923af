"""Continue a run to a later [output] end_time: check that nothing else differs, and find its last usable frame."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ..frames.flow_end import END_TIME
from ..frames.run_folder import FRAME_PATTERN
from ..scene.tables import WITHOUT_EFFECT
from ..system.errors import InputError, MpmgisError
from ..system.messages import muted
from .preparation import prepare_scene
from .stage_sequence import stage_number

if TYPE_CHECKING:
    from ..frames.particles import Frame
    from ..frames.run_folder import RunFolder
    from ..scene import Scene
    from .preparation import Prepared
    from .stage_sequence import StageSequence

DIFFERENCES = 3  # number of keys that a message names
LONGEST = 60  # [characters] of a value in a message


def earlier_run(prepared: "Prepared", record: dict) -> "Prepared | None":
    """Prepare the run of a `record` again, if it differs from `prepared` only by an earlier end_time.

    Parameters
    ----------
    prepared : Prepared
    record : dict
        Content of the `run.json` of the earlier run.

    Returns
    -------
    Prepared or None
        None if anything else differs.
    """
    earlier_end = ((record.get("scene") or {}).get("output") or {}).get("end_time")
    output = prepared.scene.output
    if not isinstance(earlier_end, (int, float)) or not 0 < earlier_end < output.end_time:
        return None
    try:
        earlier = muted()(prepare_scene)(replace(prepared.scene, output=replace(output, end_time=earlier_end)))
    except MpmgisError:  # its inputs have changed
        return None
    return earlier if earlier.digest == record.get("digest") else None


def differences(record: dict, scene: "Scene") -> str:
    """Return the differences of `scene` from that of a `record` in words, except end_time and keys WITHOUT_EFFECT.

    Parameters
    ----------
    record : dict
        Content of the `run.json` of the earlier run.
    scene : Scene
    """
    before, now = (_keys(tables) for tables in (record.get("scene") or {}, scene.as_tables()))
    ignored = ("[output] end_time", *(f"[numerics] {key}" for key in WITHOUT_EFFECT))
    found = [key for key in {**before, **now} if key not in ignored and before.get(key) != now.get(key)]
    if not found:
        before, now = (keys.get("[output] end_time") for keys in (before, now))
        earlier = isinstance(before, (int, float)) and isinstance(now, (int, float)) and now < before
        return f"[output] end_time = {now:g} is earlier than {before:g}" if earlier else "its input files have changed"
    shown = [f"{key} = {_value(now, key)} (was {_value(before, key)})" for key in found[:DIFFERENCES]]
    more = f" and {len(found) - DIFFERENCES} more" if len(found) > DIFFERENCES else ""
    return f"{', '.join(shown)}{more}"


def _keys(tables):
    """Return {"[table] key": value} of the tables of a scene, "[[table]] N key" of those that are listed."""
    found = {}
    for name, table in tables.items():
        if isinstance(table, Mapping):
            found |= {f"[{name}] {key}": value for key, value in table.items()}
        elif isinstance(table, list) and all(isinstance(one, Mapping) for one in table):
            found |= {f"[[{name}]] {k} {key}": value for k, one in enumerate(table, 1) for key, value in one.items()}
        else:
            found[name] = table
    return found


def _value(keys, key):
    """Return the value of `key` as JSON, shortened, or "not given"."""
    if key not in keys:
        return "not given"
    text = json.dumps(keys[key])
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def can_continue(record: dict) -> bool:
    """Return whether a later end has an effect: not if the run ended by itself, at rest or without mass.

    Parameters
    ----------
    record : dict
        Content of the `run.json` of the earlier run.
    """
    return record.get("state") != "finished" or record.get("reason") == END_TIME


def continue_earlier(folder: "RunFolder", sequence: "StageSequence", earlier: "Prepared") -> "Frame":
    """Set `sequence` to the newest frame in `folder` up to which the `earlier` run equals the longer one.

    Newer frames are removed; the others are assigned to the longer run.

    Parameters
    ----------
    folder : RunFolder
        Of the earlier run.
    sequence : StageSequence
        Of the longer run.
    earlier : Prepared

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        No such frame has the state for a restart, or other effects are on with the later end.
    """
    prepared = sequence.prepared
    _require_same_effects(earlier, prepared)
    for number, frame in folder.restartable(earlier.digest, prepared.digest):
        if _is_shared(frame, earlier, prepared):
            sequence.restore(replace(frame, digest=prepared.digest))
            folder.go_back_to(number, prepared.digest)
            return frame
    if next(folder.path.glob(FRAME_PATTERN), None) is None:
        raise InputError(f"{folder.path} contains no frame ({FRAME_PATTERN}); start again with `overwrite`")
    end = earlier.scene.output.end_time
    raise InputError(
        f"{folder.path} has no frame for continuing to a later end: all frames with the state of a restart depend on "
        f"end_time = {end:g} s; give another `output`, or `overwrite`"
    )


def _require_same_effects(earlier, prepared):
    before, now = (
        [[(decision.effect, decision.state) for decision in stage.decisions] for stage in run.stages]
        for run in (earlier, prepared)
    )
    if before != now:
        changed = {effect for a, b in zip(before, now, strict=True) for effect, _ in set(a) ^ set(b)}
        raise InputError(
            f"with the later [output] end_time other effects are on ({', '.join(sorted(changed))}); set their `use` as "
            "before, or give another `output`"
        )


def _is_shared(frame, earlier, prepared):
    """Return whether the longer run passes the state of this `frame` of the `earlier` one."""
    output, stages = earlier.scene.output, len(prepared.stages)
    if frame.time >= output.end_time:  # the longer run checks here whether a stage ends, and may have no frame
        at_frame = round(frame.time / output.frame_interval) * output.frame_interval == frame.time
        if not at_frame or (stages > 1 and stage_number(frame) < stages - 1):
            return False
    let_in = earlier.events.batches_in(frame)
    return all(
        (a.times[:count, 0] == b.times[:count, 0]).all() and (a.volumes[:count] == b.volumes[:count]).all()
        for a, b, count in zip(earlier.events.inlets, prepared.events.inlets, let_in, strict=True)
    )
