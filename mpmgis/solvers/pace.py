"""How fast this machine is now: a solver marched for two seconds, to predict what a run will take."""

from time import perf_counter

from .marched import marched

PACE_SECONDS = 2.0
COMPILING_STEPS, FIRST_STEPS = 2, 4


def measured_pace(solver, seconds=PACE_SECONDS, clock=perf_counter):
    """Wall time [s] of one step of one particle of `solver`, marched for `seconds`; None where nothing moves in it.

    Compiling is apart. The solver is worth nothing afterwards.
    """
    side = marched(solver)
    solver.advance(float("inf"), max_steps=COMPILING_STEPS)
    done, steps, began = 0, FIRST_STEPS, clock()
    while clock() - began < seconds:
        before, particles = solver.step, side.particles
        solver.advance(float("inf"), max_steps=steps)
        if solver.step == before:
            break
        done += (solver.step - before) * particles
        steps = min(2 * steps, 1000)
    return (clock() - began) / done if done else None
