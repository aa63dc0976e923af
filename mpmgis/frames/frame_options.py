"""Options about frames: their DTM, its CRS, and the density of the release."""

from typing import Annotated, TypedDict

from ..system.option import Option, PathLike


def _target(text: str) -> str:
    authority, _, code = text.partition(":")
    known = text == "auto" or (authority.upper() == "EPSG" and code.isdigit())
    return "" if known else "auto or EPSG:n, for example EPSG:32632"


class MetricTerrainOptions(TypedDict, total=False):
    """What is done about a DTM that is not in metres."""

    to_crs: Annotated[
        str,
        Option(
            "reproject the DTM, and rasters in another CRS than it, to this CRS in metres, and heights in feet to "
            "metres; auto: the CRS of the frames, else that of the DTM where it is in metres, else the UTM zone of its "
            "centre",
            "EPSG:n|auto",
            usual="a DTM that is not in metres is an error",
            check=_target,
            kind="text",
            label="Reproject the terrain to: auto, or EPSG:n",
        ),
    ]


class FrameTerrainOptions(MetricTerrainOptions, total=False):
    """Band and CRS of the DTM of frames."""

    dem_band: Annotated[
        int,
        Option(
            "band of the DTM with the elevation, where it has several",
            "N",
            above=0,
            label="Band of the terrain model with the elevation",
        ),
    ]
    crs: Annotated[
        str,
        Option(
            "CRS of a DTM without one, and of another code's files; local: metres without a position on the map",
            "EPSG:n|local",
            kind="CRS",
            label="CRS, where the files carry none",
        ),
    ]


class TerrainOptions(FrameTerrainOptions, total=False):
    """The DTM of frames."""

    dem: Annotated[
        PathLike,
        Option(
            "DTM; elevation in metres",
            "FILE",
            usual="the one that the frames name",
            kind="raster layer",
            label="Terrain model, if not the one that the frames name",
        ),
    ]


class DensityOptions(TypedDict, total=False):
    """Density of the release."""

    density: Annotated[
        float,
        Option(
            "density of the release, where the frames have none",
            "R",
            unit="kg m-3",
            above=0,
            label="Density, where the frames have none",
        ),
    ]
