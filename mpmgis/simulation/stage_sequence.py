"""Run the stages of a run one after another: frames of each solver, and the account of each switch."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..frames.peaks import combined_peaks
from ..scene.point_effects import stiffness_in_hindsight
from ..solvers.columns.bed_changes import with_density
from ..system.errors import FormatError, InputError, one_line
from ..system.messages import log
from .coupled_solver import parts_of
from .run_summary import flight_lines, resolution_words, stood_still, volume_words
from .time_integration import TimeIntegration

if TYPE_CHECKING:
    from ..frames.flow_end import FlowEnd
    from ..frames.particles import Frame
    from .preparation import Prepared
    from .stage import Stage

STATE = "stages"  # of a frame: data of the stages so far, as JSON


def _stage_state(frame):
    """Return the data of the stages so far in a `frame` with state."""
    if STATE not in frame.state:
        raise FormatError(f"the frame at t = {frame.time:g} s contains no stage; start with `overwrite`")
    try:
        stored = json.loads(bytes(frame.state[STATE]))
        return stored if isinstance(stored, dict) else {}
    except (ValueError, TypeError, RecursionError) as error:
        raise FormatError(
            f"the frame at t = {frame.time:g} s contains no stage ({one_line(error)[:60]}); start with `overwrite`"
        ) from error


def _checked_stage(stored, stages):
    """Return (number, past, checks) of the data `stored` in a frame, for a run with that many `stages`.

    Raises
    ------
    ValueError
        Invalid data.
    """
    number, past, checks = stored["number"], stored["past"], stored.get("checks", {})
    if type(number) is not int or not 0 <= number < stages or not isinstance(past, list) or len(past) != number:
        raise ValueError(f"stage {number} of {stages}")
    for stage in past:
        if not (isinstance(stage["balances"], dict) and isinstance(stage["switch"], dict)):
            raise ValueError("a stage that is over has no balances")
        if type(stage["steps"]) is not int or not math.isfinite(stage["time"]):
            raise ValueError("a stage that is over has no steps or time")
    if not isinstance(checks, dict) or not math.isfinite(stored["calm_since"]):
        raise ValueError("no checks of the stage")
    return number, past, checks


def stage_number(frame: "Frame") -> int:
    """Return the number, from 0, of the stage of a frame with the state of a restart.

    Parameters
    ----------
    frame : Frame

    Raises
    ------
    FormatError
        The frame contains no stage.
    """
    number = _stage_state(frame).get("number")
    return number if isinstance(number, int) else 0


class StageSequence:
    """An iterator of the frames of a run, from its first stage to its last.

    At a switch there is one frame: the first of the new stage. A scene without [[stage]] is one stage.

    Parameters
    ----------
    prepared : Prepared
    observe : callable
        Called with (solver, end time [s]) a few times a second.

    Attributes
    ----------
    number : int
        Of the current stage, from 0.
    solver : FlowSolver
    past : list of dict
        Results of finished stages, and the account of the switch after each, in plain numbers.
    reason : str
        Of the end of the run.
    end : FlowEnd or None
        State at the end of the run; None before it.
    particle_steps : int
        Number of particles, summed over the steps.
    troubles : list of str
        Warnings: problems solved with shorter steps; a flow that never moved; points that lost volume.
    checks : dict of dict
        Of the current stage, if it is of points: `resolution`, number of cells over the depth at its start, and
        `volume`, whether the points fill their volume at its end, in plain numbers.
    """

    def __init__(self, prepared: "Prepared", observe: Callable = lambda solver, end: None) -> None:
        self.prepared, self.observe = prepared, observe
        self.number, self.past, self.reason, self.particle_steps, self.troubles = 0, [], "", 0, []
        self.end: FlowEnd | None = None
        self._peaks_before = {}  # of finished stages, as in frames
        self._bed_before = {}
        self.checks = self._resolution(prepared.stages[0], prepared.seen)
        self.solver = prepared.solver()
        self._resumed, self._integration = False, None
        self._end = self._stage_end()

    @property
    def stage(self) -> "Stage":
        """The current Stage."""
        return self.prepared.stages[self.number]

    @property
    def steps(self) -> int:
        """Number of steps taken, in all stages."""
        return sum(stage["steps"] for stage in self.past) + self.solver.step

    @property
    def stepped(self) -> tuple[float, int, int]:
        """Wall time [s], particle-steps and steps of the current stage, since a restart."""
        integration = self._integration
        return (integration.step_seconds, integration.particle_steps, integration.steps) if integration else (0.0, 0, 0)

    def __iter__(self) -> "Iterator[Frame]":
        prepared = self.prepared
        output = prepared.scene.output
        if self.checks and not self._resumed:
            log.info(resolution_words(self.checks["resolution"]))
        while True:
            integration = self._integration = TimeIntegration(
                self.solver,
                output.end_time,
                output.frame_interval,
                lambda s: self.observe(s, output.end_time),
                self._resumed,
                prepared.events,
                self._end,
            )
            for frame in integration:
                self._log_troubles(integration.troubles)
                yield self._with_stages(self._with_bed(frame))
            self.particle_steps += integration.particle_steps
            self._log_stiffness()
            if not integration.switch:
                self.reason, self.end = integration.reason, integration.end
                still = stood_still(self.balances())
                if still:
                    self._log_troubles([still])
                self._check_volume()
                return
            self._switch(integration.switch)

    @staticmethod
    def _resolution(stage, columns):
        """Return the `checks` of a `stage` that starts with a Frame of columns, if they become points."""
        found = stage.resolution(columns) if stage.scene.solver == "points" else None
        return {} if found is None else {"resolution": found.as_numbers()}

    def _check_volume(self):
        """Add to `checks`, and log, whether the points of a stage that ends fill their volume."""
        stage, solver = self.stage, self.solver
        if stage.scene.solver != "points":
            return
        points, _ = solver.parts()
        volume = stage.volume(points, self.prepared.terrain).as_numbers()
        if volume["kept"]:
            log.info(volume_words(volume))
        else:
            self._log_troubles([volume_words(volume)])
        self.checks["volume"] = volume

    def _log_stiffness(self):
        """Log the speed used to check the stiffness of points, if that of the flow was different."""
        if self.stage.scene.solver == "points":
            balances = self.solver.balances()
            words = stiffness_in_hindsight(
                self.stage.facts, self.stage.numerics.density, balances["speed_max"], balances["mach_max"]
            )
            if words:
                log.info(words)

    def _log_troubles(self, troubles):
        """Log and store the warnings since the previous frame."""
        for words in troubles:
            log.info(words)
        self.troubles += troubles
        troubles.clear()

    def _with_bed(self, frame):
        """Return `frame` with the density of the eroded bed; for points, with the bed change of the columns before."""
        if not frame.bed_change:
            return replace(frame, bed_change=self._bed_before)
        bed = self.stage.scene.entrainment
        density = (bed and bed.density) or self.stage.numerics.density
        return replace(frame, bed_change=with_density(frame.bed_change, density))

    def _with_stages(self, frame):
        """Return `frame` with the data of the stages for a restart, and with the steps of all of them."""
        if len(self.prepared.stages) == 1:
            return frame
        stored = {
            "number": self.number,
            "past": self.past,
            "started": self.solver.started(),
            "calm_since": self._end.calm_since,
            "checks": self.checks,
        }
        state = frame.state | {STATE: np.frombuffer(json.dumps(stored).encode(), np.uint8)}
        maxima = combined_peaks(frame.maxima, self._peaks_before)
        return replace(frame, step=self.steps, maxima=maxima, state=state)

    def maxima(self) -> dict:
        """Return the running peaks of all stages so far, as in a frame."""
        return combined_peaks(self.solver.maxima(), self._peaks_before)

    def restore(self, frame: "Frame") -> None:
        """Continue from a frame of this run with the state of a restart.

        Parameters
        ----------
        frame : Frame

        Raises
        ------
        FormatError
            The frame has no valid state, or is after the end of the run.
        """
        try:
            if not 0.0 <= frame.time <= self.prepared.scene.output.end_time:
                raise FormatError(
                    f"the frame at t = {frame.time:g} s is after the end of the run; start with `overwrite`"
                )
            if len(self.prepared.stages) > 1:
                self._restore_stage(frame)
            self.solver.restore(frame)
            self.prepared.events.restore(frame)
        except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RecursionError) as error:
            raise FormatError(
                f"the frame at t = {frame.time:g} s has no valid state for a restart ({one_line(error)[:80]}); "
                "start with `overwrite`"
            ) from error
        self._resumed = True

    def _restore_stage(self, frame):
        stored = _stage_state(frame)
        self.number, self.past, self.checks = _checked_stage(stored, len(self.prepared.stages))
        self._end = self._stage_end()
        self._end.calm_since = stored["calm_since"]
        self._peaks_before = frame.maxima if self.number else {}
        self._bed_before = frame.bed_change if self.number else {}
        if self.number:
            self._wake_events()
            self.solver = self._solver_of(frame)
            self.solver.start_from(stored["started"])

    def _solver_of(self, frame):
        """Return the solver of the current stage for a `frame` of it; its state is restored afterwards."""
        stage, terrain = self.stage, self.prepared.terrain
        if not stage.has_columns_outside:
            return stage.solver(terrain, self._on_grid(frame, stage.grid))
        points, columns = parts_of(frame)
        before = self.prepared.stages[self.number - 1]
        return stage.coupled(
            stage.solver(terrain, self._on_grid(points, stage.grid)),
            before.columns_outside(self._on_grid(columns, before.grid), terrain),
            terrain,
        )

    def _on_grid(self, frame, grid):
        """Return `frame` as the start of a solver; positions off its `grid` by rounding are moved onto it."""
        held = grid.holds(frame)
        position = frame.particles.position.copy()
        position[~held, :2] = np.subtract(grid.some_place(), frame.origin[:2])
        return replace(
            frame,
            particles=replace(frame.particles, position=position),
            crs=self.prepared.terrain.grid.crs,
            dem="",
            dem_sha256="",
        )

    def _stage_end(self):
        following = self.prepared.stages[self.number + 1 :]
        return self.stage.end(self.prepared.terrain, following[0] if following else None)

    def _wake_events(self):
        """Enable events, which happen between steps of columns, on the grid of their stage."""
        events, stage = self.prepared.events, self.stage
        if stage.has_columns_outside:
            stage = self.prepared.stages[self.number - 1]
        events.awake = stage.scene.solver == "columns"
        if events.awake:
            events.move_to(stage.grid)

    def _switch(self, why):
        """Switch the flow to the solver of the next stage."""
        before, solver, terrain = self.stage, self.solver, self.prepared.terrain
        after = self.prepared.stages[self.number + 1]
        frame, beside = solver.parts()
        where = f"t = {frame.time:g} s: stage {self.number + 2}, of {after.scene.solver}, begins"
        try:
            switched = after.switched_from(before, replace(frame, maxima={}), terrain, beside)
        except InputError as error:
            raise type(error)(f"{where}, but {error}") from error
        self._check_volume()
        self.past.append(
            {
                "solver": before.scene.solver,
                "time": frame.time,
                "steps": solver.step,
                "reason": why,
                "balances": solver.balances(),
                "switch": switched.account.as_numbers(),
            }
            | self.checks
        )
        self._peaks_before = self.maxima()
        self._bed_before = self._with_bed(frame).bed_change
        log.info(f"{where}: {why}")
        for line in switched.account.lines("remaining columns" if after.has_columns_outside else "removed"):
            log.info(f"  {line}")
        self._log_troubles([line for line in flight_lines(self.past) if line not in self.troubles])
        self.checks = self._resolution(after, frame)
        if self.checks:
            log.info(f"  {resolution_words(self.checks['resolution'])}")
        self.number += 1
        self._resumed, self._end = False, self._stage_end()
        self._wake_events()
        start = replace(switched.frame, time=frame.time, step=0)
        self.solver = after.solver(terrain, start, switched.vertical_stress, switched.gradient)
        if after.has_columns_outside:
            self.solver = after.coupled(self.solver, self._outside(before, frame, switched.rest), terrain)

    def _outside(self, before, frame, rest):
        """Return the ColumnSolver of the remaining columns `rest` of `frame` (None: there are none yet)."""
        if rest is None:
            rest = replace(frame, particles=frame.particles.take(slice(0, 0)), state={}, maxima={})
        start = replace(rest, time=frame.time, step=0)
        return before.columns_outside(start, self.prepared.terrain, rest.state.get("velocity_gradient"))

    def balances(self) -> list[dict]:
        """Return the balances of each stage at its end, or now."""
        return [*(stage["balances"] for stage in self.past), self.solver.balances()]

    def mass_account(self) -> dict:
        """Return the mass account [kg]: mass on the terrain, mass that left it, and mass left out at switches."""
        balances_of_stages = self.balances()
        switches = [stage["switch"] for stage in self.past]
        released = balances_of_stages[0].get("mass_released", balances_of_stages[0]["mass_start"])
        released += sum(
            balances.get("mass_released", balances["mass_start"]) - balances["mass_start"]
            for balances in balances_of_stages[1:]
        )
        account = {
            "released": released,
            "entrained": sum(balances.get("mass_entrained", 0.0) for balances in balances_of_stages),
            "on_terrain": balances_of_stages[-1]["mass_now"],
            "left_terrain": sum(b["mass_out"] for b in balances_of_stages)
            + sum(switch["off"]["mass"] for switch in switches),
            "outside_windows": sum(
                switch["outside"]["mass"]
                for switch, stage in zip(switches, self.prepared.stages[1:], strict=False)
                if not stage.has_columns_outside
            ),
        }
        come = account["released"] + account["entrained"]
        found = account["on_terrain"] + account["left_terrain"] + account["outside_windows"]
        places = sorted(
            (p for b in balances_of_stages for p in b.get("left_places", ())), key=lambda place: -place["mass"]
        )
        return account | {
            "error_relative": (found - come) / (come or 1.0),
            "left_places": places,
            "energy": self._energy_account(balances_of_stages),
        }

    def _energy_account(self, balances_of_stages):
        """Return the energy lost in stages and at switches [J].

        A conversion between columns and points changes vertical velocity and height, and therefore the energy; this is
        also true for each column that enters a window.
        """
        parts = [part for b in balances_of_stages for part in (b, b.get("outside_columns")) if part is not None]
        kinds = ("kinetic_horizontal", "kinetic_vertical", "potential")
        changed = sum(part.get("exchanged_energy_lost", 0.0) for part in parts)
        for switch in (stage["switch"] for stage in self.past):
            sums = {name: sum(switch[name][kind] for kind in kinds) for name in ("before", "after", "outside", "off")}
            changed += 2.0 * sums["before"] - sum(sums.values())
        return {"lost_in_stages": sum(part["energy_lost"] for part in parts), "lost_at_switches": changed}
