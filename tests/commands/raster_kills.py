"""Kill runs that write rasters at random moments, resume them, and compare with one that was never killed.

Run as `python raster_kills.py SITE NAME (often | "at the ends") COUNT`, for SITE/NAME.toml; see kills.py.
"""

import json
import shutil
import sys
from pathlib import Path
from random import Random

from kills import forked, run_here

from mpmgis.maps.export import run_rasters


def contents(folder):
    """Bytes of each raster, names of the frames, digest of the result."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*.tif"))}
    found["digest"] = json.loads((folder / "run.json").read_text())["result_digest"]
    return found


def main(site, name, every, count):
    """Kill `count` runs, two times each."""
    if every == "often":
        run_rasters.KEPT_SECONDS, run_rasters.KEPT_SHARE = 0.0, 1e9
    random, folder = Random(f"{name} {every}"), site / f"killed {name} {every}"
    folder.mkdir()
    words = ["run", f"{name}.toml", "-o", f"{folder.name}/flow"]
    whole = [*words[:-1], f"{folder.name}/whole/flow"]
    run_here(whole, site)
    wanted = contents(folder / "whole" / "flow")
    shutil.rmtree(folder / "whole")
    forked(whole, site, ("count", folder / "count"))
    events = int((folder / "count").read_text())
    for _ in range(count):
        shutil.rmtree(folder / "flow", ignore_errors=True)
        kills = [random.randrange(events) for _ in range(2)]
        forked(words, site, ("event", kills[0]))
        if (folder / "flow" / "run.json").exists():
            forked([*words, "--resume"], site, ("event", kills[1]))
        code, _ = forked([*words, "--resume"], site)
        assert code == 0, kills
        got = contents(folder / "flow")
        different = [key for key in {**wanted, **got} if wanted.get(key) != got.get(key)]
        assert not different, (kills, different)
        assert not list((folder / "flow").glob("maps/**/.*")), kills
    print(f"{count} kills, all as without")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3], int(sys.argv[4]))
