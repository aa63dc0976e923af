"""Mass, energy, speeds and places of the columns of a run, and its balances."""

from typing import Any

import numpy as np

from ...compiled.particle_slices import in_slices
from ...frames.flow_end import END_TIME, NEARLY_AT_REST, NOTHING_LEFT
from ...frames.outflow_places import left_places
from ...frames.particle_store import EDGE_NAMES, EnergyLook, Flow, ParticleStore, least_kinetic, named_sums
from ...frames.peaks import maxima_of
from ...laws.entrainment import NO_EROSION
from ...laws.forest import SHARE
from ...laws.ground_metric import cosine_squared, metric_gradient
from . import column_forest, column_report, column_time_step
from . import column_loop as kernel
from .bed_changes import bed_change_of
from .column_arrays import INSERTED_KINETIC, INSERTED_POTENTIAL

# outflow over an edge [kg, kg m s-1, J]; potential energy is relative to elevation 0
LEDGER = ("mass", "momentum_east", "momentum_north", "kinetic_energy", "potential_energy", "particles")
# sums of a barrier [N s, N s, N s, kg, N]; the force is the largest of a single step
BARRIER_SUMS = ("normal_impulse", "impulse_east", "impulse_north", "overtopped_mass", "peak_normal_force")
END_REASONS = {  # reason of the kernel to stop -> that of the end of a run
    column_time_step.REACHED_TIME: END_TIME,
    column_time_step.STOPPED_MOVING: "at rest: less than 1 % of the peak moving mass is faster than 0.05 m/s",
    column_time_step.STOPPED_ENERGY: NEARLY_AT_REST,
    column_time_step.STOPPED_FOOTPRINT: (
        "nearly at rest: the footprint grew by less than 0.1 % in 10 s, and under 5 % of the mass is faster than 1 m/s"
    ),
    column_time_step.ALL_LEFT: NOTHING_LEFT,
}
LOSSES = {  # energy losses of a flow, and their clock entries
    "ground": column_time_step.FRICTION_TOTAL,
    "eroded_mass": column_time_step.MERGING_TOTAL,
    "barriers": column_time_step.BARRIER_TOTAL,
    "speed_limit": column_time_step.LIMITED_TOTAL,
}
CLIPS = {  # limits on the state of columns, and the clock entries that count the column-steps in which they acted
    "area_factor": column_time_step.STRETCH_TOTAL,
    "thinnest_column": column_time_step.THIN_AREA_TOTAL,
    "thickness_clamp": column_time_step.CLAMPED_TOTAL,
    "speed_bound": column_time_step.SPEED_TOTAL,
    "held_at_walls": column_time_step.WALL_TOTAL,
    "viscosity_capped": column_time_step.STIFF_TOTAL,
    "thinner_than_friction": column_time_step.THIN_TOTAL,
    "erosion_of_a_step": column_time_step.GREEDY_TOTAL,
    "weightless": column_time_step.AIRBORNE_TOTAL,
}


class ColumnBalances(ParticleStore):
    """Quantities of the columns of a run, from their rows and its clock; the base of `column_solver.ColumnSolver`."""

    RUNNING, REACHED_TIME = column_time_step.RUNNING, column_time_step.REACHED_TIME
    ALL_LEFT, TRIGGER_REACHED = column_time_step.ALL_LEFT, column_time_step.TRIGGER_REACHED
    END_REASONS = END_REASONS
    AT_REST = (column_time_step.STOPPED_MOVING, column_time_step.STOPPED_ENERGY, column_time_step.STOPPED_FOOTPRINT)

    def at_frame(self, code: int) -> int:
        """Return the reason to stop at the time of a frame: `code`, as columns check for rest in every step.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        return code

    def flow(self) -> Flow:
        """Return the flow now."""
        rows, _, _ = self._seen()
        u, v = rows[:, kernel.U].copy(), rows[:, kernel.V].copy()
        speed = np.sqrt(u * u + v * v + (u * rows[:, kernel.GX] + v * rows[:, kernel.GY]) ** 2)
        mass, x, y = rows[:, kernel.MASS].copy(), rows[:, kernel.X] + self.grid.x0, rows[:, kernel.Y] + self.grid.y0
        return Flow(x, y, u, v, speed, mass / (self.numerics.density * rows[:, kernel.AREA]), mass)

    def thickest(self) -> dict[str, Any]:
        """Return the largest `thickness` [m] at the nodes, as `maxima` does, also where those are not enabled.

        With them: speed [m s-1], pressure [Pa], arrival_time [s] (-1: never), and the `arrival_thickness` [m] that all
        but the thickness are of.
        """
        grid, inner = self.grid, self.arrays.peaks[1:-1, 1:-1]
        return maxima_of(inner, grid.x0, grid.y0, grid.cell_size, self.numerics.arrival_thickness)

    def bed_change(self) -> dict[str, np.ndarray]:
        """Return how the flow changed its bed so far (`bed_changes`); empty without erosion and forest."""
        erodes, forest = self.effects.entrainment.kind != NO_EROSION, None
        if not (erodes or self.effects.forest):
            return {}
        grid, inner = self.grid, (slice(1, -1), slice(1, -1))
        if self.effects.forest:
            state = self.fields.forest_state[inner]
            trees = self.fields.forest[inner][..., SHARE]
            broken = np.where(state[..., column_forest.TREES] == column_forest.BROKEN, trees, 0.0)
            forest = state[..., column_forest.STOPPED] / grid.cell_size**2, broken
        eroded = np.zeros((grid.bed.shape[0] - 2, grid.bed.shape[1] - 2))
        if erodes:
            eroded = self.places.erodible[inner] - self.fields.erodible[inner]
        return bed_change_of(eroded, forest, grid.x0, grid.y0, grid.cell_size)

    def energy(self) -> tuple[float, float]:
        """Compute the kinetic and the potential energy [J] of the columns now.

        Potential energy counts from the lowest bed of the grid.

        The middle of a column lies h / 2 above the bed in the form `swe`, c^2 h / 2 in the form `slope`, where mass
        stands normal to the bed: that is the energy whose gradient the pressure force is.
        """
        return self._once("energy", self._energy_now)

    def _energy_now(self):
        rows, _, _ = self._seen()
        energies = in_slices(lambda some: self._energy_of(rows[some], self._beds_under(rows[some])), len(rows))
        kinetic, potential = np.reshape(energies, (-1, 2)).sum(axis=0)
        return float(kinetic), float(potential)

    def _beds_under(self, rows):
        """Return the elevation of the bed under the columns of `rows`, float64[n] [m]."""
        x, y = rows[:, kernel.X].copy(), rows[:, kernel.Y].copy()
        return kernel.beds_at(self.fields.bed, x, y, self.grid.cell_size)[0]

    def _energy_of(self, rows, bed):
        mass, gravity = rows[:, kernel.MASS], self.numerics.gravity
        u, v = rows[:, kernel.U], rows[:, kernel.V]
        mx, my = metric_gradient(self.effects.metric, rows[:, kernel.GX], rows[:, kernel.GY])
        w = u * mx + v * my
        thickness = mass / (self.numerics.density * rows[:, kernel.AREA]) * cosine_squared(mx, my)
        potential = mass * gravity * (bed - self.grid.bed.min() + 0.5 * thickness)
        return float(0.5 * (mass * (u * u + v * v + w * w)).sum()), float(potential.sum())

    def balances(self) -> dict[str, Any]:
        """Return mass, energy and outflow so far as plain numbers [kg, J, kg m s-1], with relative errors."""
        rows, _, _ = self._seen()
        mass_now = float(rows[:, kernel.MASS].sum())
        mass_out = float(self.arrays.ledger[:, 0].sum())
        clock = self._clock
        released = float(clock[column_time_step.TOTAL_MASS] - clock[column_time_step.ENTRAINED_TOTAL])
        over_edges = named_sums(EDGE_NAMES, self.arrays.ledger, LEDGER)
        forest = self._forest_balance(mass_now)
        return {
            "mass_start": self.mass_start,
            "mass_now": mass_now,
            "mass_out": mass_out,
            "mass_released": released,
            "mass_entrained": float(clock[column_time_step.ENTRAINED_TOTAL]),
            "mass_error_relative": (
                mass_now + mass_out + forest.get("mass_detrained", 0.0) - clock[column_time_step.TOTAL_MASS]
            )
            / (clock[column_time_step.TOTAL_MASS] or 1.0),
            "outflow": {edge: sums for edge, sums in over_edges.items() if sums["particles"] > 0},
            "left_places": left_places(self.grid, self.arrays.left_cells),
            **self._energy_balance(),
            "speed_max_now": float(clock[column_time_step.SPEED]),
            "speed_bound_ratio": float(np.sqrt(clock[column_time_step.BOUND_WORST])),
            "thickness_max_now": float(clock[column_time_step.DEPTH_NOW]),
            "thickness_max": float(clock[column_time_step.DEPTH_WORST]),
            "thickness_max_at": self._place_of(column_time_step.DEEPEST_X),
            "thickness_max_time": float(clock[column_time_step.DEEPEST_TIME]),
            "speed_max": float(clock[column_time_step.FASTEST]),
            "speed_max_at": self._place_of(column_time_step.FASTEST_X),
            "speed_max_time": float(clock[column_time_step.FASTEST_TIME]),
            "moving_share": float(clock[column_time_step.MOVING_SHARE]),
            "speed_limited_share_max": float(clock[column_time_step.LIMITED_WORST]),
            "airborne_share_max": float(clock[column_time_step.AIRBORNE_WORST]),
            "particle_steps": int(clock[column_time_step.COLUMN_STEPS]),
            "clips": {name: float(clock[entry]) for name, entry in CLIPS.items()},
            "thickness_clamps": int(clock[column_time_step.CLAMPED_TOTAL]),
            "viscosity_capped_share_max": float(clock[column_time_step.STIFF_WORST]),
            "barriers": named_sums(self.places.barrier_names, self.arrays.barrier_sums, BARRIER_SUMS),
            "footprint_area": float(self._counts[column_time_step.WET]) * self.grid.cell_size**2,
            **forest,
        }

    def _forest_balance(self, mass_now):
        """Return mass that stopped in forest, that stands still and that flows [kg], broken area; empty without forest.

        `mass_at_rest` is that of columns slower than MOVING_SPEED.
        """
        if not self.effects.forest:
            return {}
        flow, sums = self.flow(), self.fields.forest_sums
        at_rest = float(flow.mass[flow.speed <= column_report.MOVING_SPEED].sum())
        cell = self.grid.cell_size**2
        return {
            "mass_detrained": float(sums[column_forest.DETRAINED]),
            "mass_at_rest": at_rest,
            "mass_flowing": mass_now - at_rest,
            "forest_area": float(self.fields.forest[..., SHARE].sum()) * cell,
            "forest_broken_area": float(sums[column_forest.BROKEN_CELLS]) * cell,
        }

    def _losses(self):
        """Return the energy taken from the flow so far [J], by what took it."""
        forest = {}
        if self.effects.forest:
            forest = {"forest": float(self.fields.forest_sums[column_forest.RESISTED])}
        return {name: float(self._clock[entry]) for name, entry in LOSSES.items()} | forest

    def _energy_gone(self):
        """Return kinetic and potential energy [J] of the mass that left the terrain or stopped in forest."""
        ledger, sums = self.arrays.ledger, self.fields.forest_sums
        datum = self.numerics.gravity * float(self.grid.bed.min())
        kinetic, potential = float(ledger[:, 3].sum()), float(ledger[:, 4].sum() - ledger[:, 0].sum() * datum)
        if self.effects.forest:
            kinetic += float(sums[column_forest.KINETIC])
            potential += float(sums[column_forest.POTENTIAL] - sums[column_forest.DETRAINED] * datum)
        return kinetic, potential

    def energy_look(self) -> EnergyLook:
        """Return the present kinetic energy and the work of weight and pressure.

        Heights need no guard, see `_energy_balance`.
        """
        clock, kinetic = self._clock, self.energy()[0]
        work, taken = clock[column_time_step.WORK_TOTAL], sum(self._losses().values())
        put_in = self.energy_start[0] + self.arrays.inserted[INSERTED_KINETIC]
        made = kinetic + self._energy_gone()[0] - work - put_in
        gravity, cell_size = self.numerics.gravity, self.numerics.cell_size
        least = least_kinetic(
            clock[column_time_step.KINETIC_PEAK], clock[column_time_step.TOTAL_MASS], gravity, cell_size
        )
        work = float(work), float(taken), float(put_in)
        return EnergyLook(float(made), kinetic, float(least), work, self.time)

    def _energy_balance(self):
        """Return the energy that came in, that is there and that left [J], and what took the rest.

        What the velocities lose to the transfers between columns and grid, to shocks and to internal friction is the
        kinetic energy that the work of weight and pressure leaves unexplained (`mixing`). Changes of c^2 h / 2, the
        height of a column's middle, go to `bends`, with a negative sign where slopes ease: a thin layer has no force
        for them. The error is what is left then: the potential energy that came in and is gone, less that work, over
        all energy that came in.
        """
        clock, gravity = self._clock, self.numerics.gravity
        (kinetic, potential), (kinetic_start, potential_start) = self.energy(), self.energy_start
        datum = gravity * float(self.grid.bed.min())
        kinetic_out, potential_out = self._energy_gone()
        inserted = self.arrays.inserted
        kinetic_later, potential_later = float(inserted[INSERTED_KINETIC]), float(inserted[INSERTED_POTENTIAL])
        taken = float(
            clock[column_time_step.ENTRAINED_POTENTIAL_TOTAL] - clock[column_time_step.ENTRAINED_TOTAL] * datum
        )
        lost_to = self._losses()
        work = float(clock[column_time_step.WORK_TOTAL])
        lost_to["mixing"] = work + kinetic_start + kinetic_later - kinetic - kinetic_out - sum(lost_to.values())
        lost_to["bends"] = -float(clock[column_time_step.BENT_TOTAL])
        put_in = kinetic_start + potential_start + kinetic_later + potential_later + taken
        lost = put_in - kinetic - potential - kinetic_out - potential_out
        return {
            "energy_start": kinetic_start + potential_start,
            "energy_released_later": kinetic_later + potential_later,
            "energy_entrained": taken,
            "energy_out": kinetic_out + potential_out,
            "kinetic_energy": kinetic,
            "kinetic_energy_peak": max(kinetic, float(clock[column_time_step.KINETIC_PEAK])),
            "potential_energy": potential,
            "energy_lost": lost,
            **{f"energy_lost_to_{name}": joules for name, joules in lost_to.items()},
            "energy_error_relative": (lost - sum(lost_to.values())) / (put_in or 1.0),
        }

    def fastest(self) -> tuple[float, float, float]:
        """Return map E, N [m] and speed [m s-1] of the fastest column."""
        flow = self.flow()
        k = int(np.argmax(flow.speed))
        return float(flow.x[k]), float(flow.y[k]), float(flow.speed[k])

    def trouble(self, code: int) -> str:
        """Return a message with E and N about an error; '' for none.

        Parameters
        ----------
        code : int
            Reason of the kernel to stop.
        """
        clock, place = self._clock, self._place_of(column_time_step.BOUND_NOW_X)
        if code == column_time_step.NOT_FINITE_STATE:
            bad = int(self._counts[column_time_step.BAD])
            what = f"{bad} columns have a position or area that is not finite; take a smaller cfl or larger cells"
        elif code == column_time_step.TOO_FAST:
            ratio, share = np.sqrt(clock[column_time_step.BOUND_NOW]), clock[column_time_step.WILD_NOW]
            what = (
                f"{100 * share:.0f} % of the mass is over twice, at worst {ratio:.1f} times, as fast as its drop in "
                "height allows; a cliff there is beyond a depth-averaged model, elsewhere take a smaller cfl"
            )
        else:
            return ""
        return f"E {place[0]:.1f} N {place[1]:.1f}: {what}"
