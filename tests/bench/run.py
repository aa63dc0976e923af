"""The benchmark table: `python tests/bench/run.py [NAME...] [--markdown]`, or `make bench`.

Every `bench_NAME.py` in this folder has a function `rows()`, which yields (case, value, unit, reference, ratio): the
measured quantity, its value and unit, the reference measured in the same run (or published), and value over reference.
If this machine cannot run a case, `value` is None and `reference` is the reason. `--markdown` prints a table for the
documentation; a file may have its own shorter table in `summary()`: headings, rows.
"""

import argparse
import importlib
import os
import platform
import sys
import time
import traceback
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
HEADINGS = ("case", "value", "unit", "reference", "ratio")
WIDTHS = (58, 11, 18, 52, 7)


def benchmarks():
    """Name -> module name of every benchmark file."""
    return {path.stem.removeprefix("bench_"): path.stem for path in sorted(HERE.glob("bench_*.py"))}


def number(value, digits=4):
    """A measured number with a few digits, or a dash."""
    return "-" if value is None else f"{value:,.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def line(case, value, unit, reference, ratio):
    """One line of the table; long texts are not cut."""
    cells = (str(case), number(value), str(unit), str(reference or "-"), number(ratio, 3))
    right = (False, True, False, False, True)
    padded = [c.rjust(w) if r else c.ljust(w) for c, w, r in zip(cells, WIDTHS, right, strict=True)]
    return "  ".join(padded).rstrip()


def machine():
    """The machine of the measurement."""
    processor = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        models = [row.split(":", 1)[1].strip() for row in info.read_text().splitlines() if row.startswith("model name")]
        processor = models[0] if models else processor
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "rasterio", "h5py"))
    return (
        f"{processor}, {cores} cores, load {os.getloadavg()[0]:.1f}; {platform.system()}; "
        f"Python {platform.python_version()}, {libraries}"
    )


def markdown(headings, rows):
    """Lines of a table in Markdown."""
    return [f"| {' | '.join(cells)} |" for cells in (headings, ["---"] * len(headings), *rows)]


def summary(module):
    """Results of a benchmark as lines in Markdown: its own short table, or all its rows."""
    if hasattr(module, "summary"):
        return markdown(*module.summary())
    found = module.rows()
    return markdown(HEADINGS, [(str(c), number(v), str(u), str(r or "-"), number(q, 3)) for c, v, u, r, q in found])


def run(names, as_markdown=False):
    """Print the table of the benchmarks `names`; returns how many of them failed."""
    header = [h.rjust(w) if h in ("value", "ratio") else h.ljust(w) for h, w in zip(HEADINGS, WIDTHS, strict=True)]
    print(machine(), flush=True)
    if not as_markdown:
        print("  ".join(header).rstrip(), "-" * (sum(WIDTHS) + 2 * len(WIDTHS) - 2), sep="\n", flush=True)
    sys.path.insert(0, str(HERE))
    failed = 0
    for name, module in names.items():
        began = time.perf_counter()
        try:
            module = importlib.import_module(module)
            for text in summary(module) if as_markdown else (line(*row) for row in module.rows()):
                print(text, flush=True)
        except Exception:
            failed += 1
            print(f"{name}: failed", flush=True)
            traceback.print_exc()
        print(f"({name}: {time.perf_counter() - began:.0f} s)", file=sys.stderr, flush=True)
    return failed


def main():
    """Run the benchmarks named on the command line, or all."""
    there = benchmarks()
    parser = argparse.ArgumentParser(description="Print the benchmark table.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"benchmarks: {', '.join(there)} (default: all)")
    parser.add_argument("--markdown", action="store_true", help="print Markdown tables for the documentation")
    options = parser.parse_args()
    asked = options.names
    unknown = [name for name in asked if name not in there]
    if unknown:
        parser.error(f"no benchmark named {unknown[0]!r}; there are: {', '.join(there)}")
    raise SystemExit(1 if run({name: there[name] for name in asked or there}, options.markdown) else 0)


if __name__ == "__main__":
    main()
