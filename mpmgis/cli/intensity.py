"""`mpmgis intensity`: classes of a named guideline on a map."""

from pathlib import Path

from . import results_options

EXAMPLE = """
mpmgis intensity results --guideline swiss-debris-flow
mpmgis intensity results_gis --guideline austrian-avalanche -o zones
mpmgis intensity results --guideline mine --guidelines my_guidelines.toml -o classes.tif
"""
DESCRIPTION = """
Puts every cell that the flow reached into a class of a named guideline, by the largest depth, speed, impact pressure or
final depth that it saw. A cell's maxima need not have been there at the same time, so classes of two of them together
are on the safe side. Depth is normal to the slope. Pressure is the density of the release times the squared mean speed.
What a hazard zone is depends besides on the scenario's return period and on the authority: read the guideline.
"""
SQUARE_METRES_PER_HECTARE = 1e4


def add_arguments(parser):
    """Declare the verb's options."""
    from ..reports.intensity import read_guidelines

    shipped = "\n".join(f"  {name:<30}{entry.title}" for name, entry in read_guidelines().items())
    parser.description = f"{DESCRIPTION.strip()}\n\nguidelines:\n{shipped}"
    results_options.add_arguments(parser, rasters=True)
    parser.add_argument("--guideline", required=True, metavar="NAME", help="one of the above, or of --guidelines")
    parser.add_argument("--guidelines", type=Path, metavar="FILE", help="your own guidelines, as TOML (README)")
    results_options.add_output(parser, "intensity", "raster (.tif), style (.qml), polygons (.gpkg) and table (.csv)")


def run(arguments):
    """Classify; areas and paths go to stdout."""
    from ..workflows.intensity import IntensityRequest, intensity

    request = results_options.answer_request(IntensityRequest, arguments)
    found = results_options.tell(lambda progress: intensity(request, progress))
    print("\n".join([*screen(found), *map(str, found.files)]))
    return 0


def screen(found):
    """Lines of text about an IntensityFound."""
    guideline = found.guideline
    lines = [f"{found.name}: {guideline.title or guideline.name}", f"by {guideline.source}"]
    if guideline.note:
        lines.append(f"({guideline.note})")
    width = max(len(entry.name) for entry in guideline.classes) + 2
    for entry, area in zip(guideline.classes, found.areas, strict=True):
        lines.append(f"{entry.name:<{width}}{area / SQUARE_METRES_PER_HECTARE:>10.2f} ha   {entry.words()}")
    return lines + [f"{entry.name}: {entry.origin()}" for entry in guideline.classes if entry.read_in]
