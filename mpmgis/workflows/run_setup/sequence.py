"""The stages of a run, one after the other: frames of one solver after those of the other, what each switch kept."""

import json
import math
from dataclasses import replace

import numpy as np

from ...analysis.run_summary import resolution_words, stood_still, volume_words
from ...errors import FormatError, InputError, one_line
from ...messages import log
from ...peaks import together
from ...scene.points import stiffness_in_hindsight
from ...solvers.coupled import parts_of
from ...solvers.integrate import March

STATE = "stages"  # of a frame: what the stages so far have left behind, as JSON


def _told_by(frame):
    """What a `frame` with state holds of the stages so far."""
    if STATE not in frame.state:
        raise FormatError(f"the frame at t = {frame.time:g} s tells no stage; start with --overwrite")
    try:
        told = json.loads(bytes(frame.state[STATE]))
        return told if isinstance(told, dict) else {}
    except (ValueError, TypeError, RecursionError) as error:
        raise FormatError(
            f"the frame at t = {frame.time:g} s tells no stage ({one_line(error)[:60]}); start with --overwrite"
        ) from error


def _stage_of(told, stages):
    """(number, past, checks) of what a frame holds of the stages so far, of a run with that many `stages`.

    Raises
    ------
    ValueError
        It cannot be that.
    """
    number, past, checks = told["number"], told["past"], told.get("checks", {})
    if type(number) is not int or not 0 <= number < stages or not isinstance(past, list) or len(past) != number:
        raise ValueError(f"stage {number} of {stages}")
    for stage in past:
        if not (isinstance(stage["balances"], dict) and isinstance(stage["switch"], dict)):
            raise ValueError("a stage that is over has no balances")
        if type(stage["steps"]) is not int or not math.isfinite(stage["time"]):
            raise ValueError("a stage that is over has no steps or time")
    if not isinstance(checks, dict) or not math.isfinite(told["calm_since"]):
        raise ValueError("no checks of the stage")
    return number, past, checks


def stage_number(frame):
    """Number, from 0, of the stage that a `frame` with the state of a restart was written in."""
    number = _told_by(frame).get("number")
    return number if isinstance(number, int) else 0


class Sequence:
    """An iterator of the frames of a run, from its first stage to its last.

    At a switch there is one frame: the first of the stage that begins. A scene without [[stage]] is one stage.

    Parameters
    ----------
    prepared : Prepared
    observe : callable
        Told (solver, end time) a few times a second.

    Attributes
    ----------
    number : int
        Of the stage now, from 0.
    solver : ColumnSolver or PointSolver
    past : list of dict
        What the stages that are over told at their end, and what the switch after each kept, in plain numbers.
    reason : str
        Why the run ended.
    particle_steps : int
    troubles : list of str
        What went wrong and was got over with shorter steps; that nothing ever moved; that points lost volume.
    checks : dict of dict
        Of the stage now, if it is of points: `resolution`, how many cells stand over the depth at its start, and
        `volume`, whether the points fill their volume at its end, in plain numbers.
    taken_in : list of dict
        Features on the map whose effect was off until the flow came to them, in plain numbers.
    """

    def __init__(self, prepared, observe=lambda solver, end: None):
        self.prepared, self.observe = prepared, observe
        self.number, self.past, self.reason, self.particle_steps, self.troubles = 0, [], "", 0, []
        self._peaks_before = {}  # of the stages that are over, as frames have them
        self.checks = self._resolution(prepared.stages[0], prepared.seen)
        self.solver = prepared.stages[0].watch(prepared.solver())
        self._resumed, self._march = False, None
        self._end = self._stage_end()

    @property
    def stage(self):
        """The Stage now."""
        return self.prepared.stages[self.number]

    @property
    def steps(self):
        """Number of steps taken, in all stages."""
        return sum(stage["steps"] for stage in self.past) + self.solver.step

    @property
    def stepped(self):
        """(wall time [s], particle-steps, steps) of the steps of the stage now, of those since a restart."""
        march = self._march
        return (march.step_seconds, march.particle_steps, march.steps) if march else (0.0, 0, 0)

    def __iter__(self):
        prepared = self.prepared
        output = prepared.scene.output
        if self.checks and not self._resumed:
            log.info(resolution_words(self.checks["resolution"]))
        while True:
            march = self._march = March(
                self.solver, output.end_time, output.frame_interval, lambda s: self.observe(s, output.end_time),
                self._resumed, prepared.events, self._end, lambda taken: log.info(taken.line()),
            )  # fmt: skip
            for frame in march:
                self._tell_of(march.troubles)
                yield self._told(frame)
            self.particle_steps += march.particle_steps
            self._tell_of_stiffness()
            if not march.switch:
                self.reason = march.reason
                still = stood_still(self.balances())
                if still:
                    self._tell_of([still])
                self._check_volume()
                return
            self._switch(march.switch)

    @staticmethod
    def _resolution(stage, columns):
        """`checks` of a `stage` that begins with a Frame of columns, if they become its points."""
        found = stage.resolution(columns) if stage.scene.solver == "points" else None
        return {} if found is None else {"resolution": found.as_numbers()}

    def _check_volume(self):
        """Add to `checks` whether the points of a stage that ends fill their volume, and say it."""
        stage, solver = self.stage, self.solver
        if stage.scene.solver != "points":
            return
        points = solver.parts()[0] if stage.marches_outside else solver.frame()
        volume = stage.volume(points, self.prepared.terrain).as_numbers()
        if volume["kept"]:
            log.info(volume_words(volume))
        else:
            self._tell_of([volume_words(volume)])
        self.checks["volume"] = volume

    def _tell_of_stiffness(self):
        """Say what speed the stiffness of points was judged by, where the flow's was another."""
        if self.stage.scene.solver == "points":
            told = self.solver.balances()
            words = stiffness_in_hindsight(
                self.stage.facts, self.stage.numerics.density, told["speed_max"], told["mach_max"]
            )
            if words:
                log.info(words)

    def _tell_of(self, troubles):
        """Say what the march got over since the frame before."""
        for words in troubles:
            log.info(words)
        self.troubles += troubles
        troubles.clear()

    def _told(self, frame):
        """`frame` with what a restart needs of the stages, and with the steps of all of them."""
        if len(self.prepared.stages) == 1:
            return frame
        told = {
            "number": self.number, "past": self.past, "started": self.solver.started(),
            "calm_since": self._end.calm_since, "checks": self.checks,
        }  # fmt: skip
        state = frame.state | {STATE: np.frombuffer(json.dumps(told).encode(), np.uint8)}
        maxima = together(frame.maxima, self._peaks_before)
        return replace(frame, step=self.steps, maxima=maxima, state=state)

    def maxima(self):
        """Running peaks of all stages so far, as a frame has them."""
        return together(self.solver.maxima(), self._peaks_before)

    def restore(self, frame):
        """Go on from a `frame` of this run that carries its state.

        Raises
        ------
        FormatError
        """
        try:
            if not 0.0 <= frame.time <= self.prepared.scene.output.end_time:
                raise FormatError(
                    f"a frame of t = {frame.time:g} s is beyond the end of the run; start with --overwrite"
                )
            if len(self.prepared.stages) > 1:
                self._restore_stage(frame)
            self.solver.restore(frame)
            self.prepared.events.restore(frame)
        except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RecursionError) as error:
            raise FormatError(
                f"the frame at t = {frame.time:g} s has no valid state for a restart ({one_line(error)[:80]}); "
                "start with --overwrite"
            ) from error
        self._resumed = True

    def _restore_stage(self, frame):
        told = _told_by(frame)
        self.number, self.past, self.checks = _stage_of(told, len(self.prepared.stages))
        self._end = self._stage_end()
        self._end.calm_since = told["calm_since"]
        self._peaks_before = frame.maxima if self.number else {}
        if self.number:
            self._wake_events()
            self.solver = self._solver_of(frame)
            self.solver.start_from(told["started"])

    def _solver_of(self, frame):
        """The solver of the stage now, made of a `frame` in the midst of it, whose state comes next."""
        stage, terrain = self.stage, self.prepared.terrain
        if not stage.marches_outside:
            return stage.watch(stage.solver(terrain, self._on_grid(frame, stage.grid)))
        points, columns = parts_of(frame)
        before = self.prepared.stages[self.number - 1]
        return stage.coupled(
            stage.watch(stage.solver(terrain, self._on_grid(points, stage.grid))),
            before.watch(before.columns_outside(self._on_grid(columns, before.grid), terrain)),
            terrain,
        )

    def _on_grid(self, frame, grid):
        """`frame` as a solver takes it for a start; rounded places may lie a hair off its `grid`."""
        held = grid.holds(frame)
        position = frame.particles.position.copy()
        position[~held, :2] = np.subtract(grid.some_place(), frame.origin[:2])
        return replace(
            frame, particles=replace(frame.particles, position=position), crs=self.prepared.terrain.grid.crs, dem="",
            dem_sha256="",
        )  # fmt: skip

    def _stage_end(self):
        following = self.prepared.stages[self.number + 1 :]
        return self.stage.end(self.prepared.terrain, following[0] if following else None)

    def _wake_events(self):
        """Events happen between steps of columns, on the grid of their stage."""
        events, stage = self.prepared.events, self.stage
        if stage.marches_outside:
            stage = self.prepared.stages[self.number - 1]
        events.awake = stage.scene.solver == "columns"
        if events.awake:
            events.move_to(stage.grid)

    def _switch(self, why):
        """Hand the flow to the next stage's solver."""
        before, solver, terrain = self.stage, self.solver, self.prepared.terrain
        after = self.prepared.stages[self.number + 1]
        frame, beside = solver.parts() if before.marches_outside else (solver.frame(), None)
        where = f"t = {frame.time:g} s: stage {self.number + 2}, of {after.scene.solver}, begins"
        try:
            switched = after.switched_from(before, replace(frame, maxima={}), terrain, beside)
        except InputError as error:
            raise type(error)(f"{where}, but {error}") from error
        self._check_volume()
        self.past.append({
            "solver": before.scene.solver, "time": frame.time, "steps": solver.step, "reason": why,
            "balances": solver.balances(), "switch": switched.account.as_numbers(),
            "taken_in": self._taken_in_now(),
        } | self.checks)  # fmt: skip
        self._peaks_before = self.maxima()
        log.info(f"{where}: {why}")
        for line in switched.account.lines("going on as columns" if after.marches_outside else "booked and gone"):
            log.info(f"  {line}")
        self.checks = self._resolution(after, frame)
        if self.checks:
            log.info(f"  {resolution_words(self.checks['resolution'])}")
        self.number += 1
        self._resumed, self._end = False, self._stage_end()
        self._wake_events()
        start = replace(switched.frame, time=frame.time, step=0)
        self.solver = after.watch(after.solver(terrain, start, switched.vertical_stress, switched.gradient))
        if after.marches_outside:
            self.solver = after.coupled(self.solver, self._outside(before, frame, switched.rest), terrain)

    def _outside(self, before, frame, rest):
        """The ColumnSolver that goes on with the columns `rest` of `frame` (None: there are none yet)."""
        if rest is None:
            rest = replace(frame, particles=frame.particles.take(slice(0, 0)), state={}, maxima={})
        start = replace(rest, time=frame.time, step=0)
        columns = before.columns_outside(start, self.prepared.terrain, rest.state.get("velocity_gradient"))
        return before.watch(columns)

    def _taken_in_now(self):
        """What the solver of the stage now has taken in, in plain numbers."""
        parts = [(self.number + 1, self.solver)]
        if self.stage.marches_outside:  # the columns are of the stage before
            parts = [(self.number + 1, self.solver.points_solver), (self.number, self.solver.columns_solver)]
        return [{"stage": number, **taken._asdict()} for number, solver in parts for taken in solver.taken_in]

    @property
    def taken_in(self):
        return [taken for stage in self.past for taken in stage.get("taken_in", ())] + self._taken_in_now()

    def stage_now(self, number):
        """The Stage `number`, from 0, with the effects that the flow has turned on in it."""
        stage = self.prepared.stages[number]
        own = {feature.effect for feature in stage.features()}
        taken = {one["effect"] for one in self.taken_in if one["stage"] == number + 1}
        return stage.with_effects(tuple(sorted(own & taken)))

    def balances(self):
        """Of each stage at its end, or now."""
        return [*(stage["balances"] for stage in self.past), self.solver.balances()]

    def mass_account(self):
        """Where all mass is [kg]: what was ever in the run is on the terrain, left it, or was left out at a switch."""
        told = self.balances()
        switches = [stage["switch"] for stage in self.past]
        released = told[0].get("mass_released", told[0]["mass_start"])
        released += sum(balances.get("mass_released", balances["mass_start"]) - balances["mass_start"]
                        for balances in told[1:])  # fmt: skip
        account = {
            "released": released,
            "entrained": sum(balances.get("mass_entrained", 0.0) for balances in told),
            "on_terrain": told[-1]["mass_now"],
            "left_terrain": sum(b["mass_out"] for b in told) + sum(switch["off"]["mass"] for switch in switches),
            "outside_windows": sum(
                switch["outside"]["mass"]
                for switch, stage in zip(switches, self.prepared.stages[1:], strict=False)
                if not stage.marches_outside
            ),
        }
        come = account["released"] + account["entrained"]
        found = account["on_terrain"] + account["left_terrain"] + account["outside_windows"]
        places = sorted((p for b in told for p in b.get("left_places", ())), key=lambda place: -place["mass"])
        return account | {
            "error_relative": (found - come) / (come or 1.0), "left_places": places,
            "energy": self._energy_account(told),
        }  # fmt: skip

    def _energy_account(self, told):
        """What became of energy in stages and between them [J]; `told` are the balances of the stages.

        A switch changes energy: columns that become points get another vertical velocity and height, and the other way
        round. So does each column that comes into a window around which columns march on.
        """
        parts = [part for b in told for part in (b, b.get("outside_columns")) if part is not None]
        kinds = ("kinetic_horizontal", "kinetic_vertical", "potential")
        changed = sum(part.get("exchanged_energy_lost", 0.0) for part in parts)
        for switch in (stage["switch"] for stage in self.past):
            sums = {name: sum(switch[name][kind] for kind in kinds) for name in ("before", "after", "outside", "off")}
            changed += 2.0 * sums["before"] - sum(sums.values())
        return {"lost_in_stages": sum(part["energy_lost"] for part in parts), "lost_at_switches": changed}
