"""Runs AvaFrame's com1DFA on a prepared folder; started by `study.py --avaframe` with the Python that has AvaFrame.

`python com1dfa_run.py FOLDER END REPEATS`: FOLDER/Inputs has the terrain, the release and `settings.ini`. Writes
FOLDER/found.npz: version of AvaFrame, wall times of its loop over steps [s], steps, particles, and the thickness normal
to the slope at END seconds with E and N [m] of its columns and rows. It does not import mpmgis.
"""

import logging
import os
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")

import numpy as np
from avaframe.com1DFA import com1DFA
from avaframe.in3Utils import cfgUtils


def once(folder):
    """Row of com1DFA's table for one run; the results of the previous run are removed first."""
    for old in ("Outputs", "Work"):
        shutil.rmtree(folder / old, ignore_errors=True)
    general = cfgUtils.getGeneralConfig()
    general["MAIN"]["avalancheDir"] = str(folder)
    general["MAIN"]["nCPU"] = "1"
    for flag in ("savePlot", "createReport", "ReportDir"):
        general["FLAGS"][flag] = "False"
    *_, table = com1DFA.com1DFAMain(general, cfgInfo=folder / "Inputs" / "settings.ini")
    (row,) = (row for _, row in table.iterrows())
    return row


def thickness_at(folder, row, end):
    """(float64[rows, columns] [m], E of the columns, N of the rows) at `end` seconds."""
    fields, header, times = com1DFA.readFields(
        str(folder), ["FT"], simName=row["simName"], flagAvaDir=True, comModule="com1DFA"
    )
    at = int(np.argmin(np.abs(np.asarray(times) - end)))
    if abs(times[at] - end) > 1e-3:
        raise SystemExit(f"com1DFA wrote no thickness at {end} s, only at {times}")
    thickness = np.asarray(fields[at]["FT"], float)
    rows, columns = thickness.shape
    east = header["xllcenter"] + header["cellsize"] * np.arange(columns)
    north = header["yllcenter"] + header["cellsize"] * np.arange(rows)
    return thickness, east, north


def main():
    """Run and measure."""
    folder, end, repeats = Path(sys.argv[1]).resolve(), float(sys.argv[2]), int(sys.argv[3])
    logging.disable(logging.WARNING)
    os.chdir(folder)
    rows = [once(folder) for _ in range(repeats)]
    thickness, east, north = thickness_at(folder, rows[-1], end)
    np.savez(
        folder / "found.npz",
        version=version("avaframe"),
        seconds=[float(row["timeLoop"]) for row in rows],
        steps=int(rows[-1]["nIter"]) - 1,
        particles=int(rows[-1]["nPart"]),
        thickness=thickness,
        east=east,
        north=north,
    )


if __name__ == "__main__":
    main()
