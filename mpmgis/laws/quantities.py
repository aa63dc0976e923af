"""Table of all quantities: name, unit, long name, dtype.

HDF5 attributes, raster band descriptions, QGIS styles and the documentation read this table. Raster bands contain
`NODATA` where there is no value.
"""

from typing import NamedTuple

NODATA = -9999.0
GRAVITY = 9.81  # [m s-2], the one constant
SQUARE_METRES_PER_HECTARE = 1e4
MEMBER_BANDS = ("h_max", "Ut_max", "p_max", "t_arrival")  # of the raster of one run of an ensemble or a region


class Quantity(NamedTuple):
    """One physical quantity.

    `name` is the key in files, `unit` follows UDUNITS ("m s-1"; "1" without one), `long_name` is a description with
    sign and convention, `dtype` is the default storage type. `total` says of thicknesses and masses in rasters what
    their sum over all cells is, because users sum rasters to volumes.
    """

    name: str
    unit: str
    long_name: str
    dtype: str = "float64"
    total: str = ""

    @property
    def band(self) -> str:
        """Description of the band in a raster, for example ``Ut [m s-1]``."""
        return f"{self.name} [{self.unit}]"


# what the sum over the cells of a raster, times the area of a cell in plan, is
NO_VOLUME = "its sum over cells is no volume: it is the largest value in each cell, and grows with the cells"
NO_VOLUME_OF_PEAKS = f"{NO_VOLUME}, and with the steps"
VOLUME = "its sum over cells, times their plan area, is the volume"
VOLUME_ON_SLOPES = (
    "its sum over cells, times their plan area, is the volume times the cosine of the slope; the volume is mass over "
    "density"
)
MASS = "its sum over cells, times their plan area, is the mass"


def _table(*rows):
    return {row[0]: Quantity(*row) for row in rows}


PARTICLE = _table(
    ("position", "m", "position relative to the frame's origin (east, north, up); a column's z is its bed"),
    ("velocity", "m s-1", "velocity (east, north, up); a column's is tangent to the bed"),
    ("mass", "kg", "mass"),
    ("volume", "m3", "current volume"),
    ("thickness", "m", "vertical thickness of the column"),
    ("area", "m2", "plan area of the column"),
    ("id", "1", "identity of the particle; the order of the particles changes from frame to frame", "uint64"),
    ("parent", "1", "identity of the column that a point came from", "uint64"),
)

BAND = _table(
    ("h", "m", "flow depth normal to the bed (largest distance of particles from the bed)", "float32", NO_VOLUME),
    ("t", "m", "flow thickness normal to the bed (highest minus lowest particle)", "float32", NO_VOLUME),
    ("Un", "m s-1", "slope-normal velocity, mass-weighted; positive leaves the bed", "float32"),
    ("Ut", "m s-1", "slope-parallel speed, length of the mass-weighted mean vector", "float32"),
    ("Ut_E", "m s-1", "slope-parallel velocity, east component", "float32"),
    ("Ut_N", "m s-1", "slope-parallel velocity, north component", "float32"),
    ("t_vol", "m", "volume-equivalent thickness normal to the bed, from mass", "float32", VOLUME_ON_SLOPES),
    ("n", "1", "number of particles in the cell", "float32"),
    ("mass", "kg m-2", "mass per plan area", "float32", MASS),
    ("p", "Pa", "impact pressure, density times squared mean speed", "float32"),
    ("detached", "1", "1 where the lowest particle is clear of the bed", "float32"),
    ("h_max", "m", "largest flow depth over all steps, normal to the bed", "float32", NO_VOLUME_OF_PEAKS),
    ("t_max", "m", "largest flow thickness over all steps, normal to the bed", "float32", NO_VOLUME_OF_PEAKS),
    ("Un_max", "m s-1", "largest slope-normal velocity over all steps (away from the slope)", "float32"),
    ("Un_min", "m s-1", "smallest slope-normal velocity over all steps (into the slope)", "float32"),
    ("Ut_max", "m s-1", "largest slope-parallel speed over all steps", "float32"),
    ("p_max", "Pa", "largest impact pressure over all steps", "float32"),
    ("eroded", "m", "vertical depth that the flow took from the bed", "float32", VOLUME),
    ("erosion_rate_max", "m s-1", "largest speed at which the bed receded between two frames, vertical", "float32"),
    ("deposit", "m", "vertical thickness of the material at the end, from mass", "float32", VOLUME),
    (
        "thickness_end",
        "m",
        "vertical thickness in the last step of a flow that still moves, from mass",
        "float32",
        VOLUME,
    ),
    ("detrained", "m", "vertical thickness of the material that stopped in forest, from mass", "float32", VOLUME),
    ("broken_forest", "1", "share of the cell whose forest is broken", "float32"),
    ("surface_new", "m", "elevation of the ground at the end: bed after erosion plus all deposits", "float32"),
    ("bed_new", "m", "elevation of the bed after erosion", "float32"),
    ("t_arrival", "s", "first time with depth at least min_depth", "float32"),
)
