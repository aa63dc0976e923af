"""The tables of a scene: keys, descriptions for the template, and checks on each value.

A table that is present is an effect in the scene; unknown tables and keys are errors.
"""

from dataclasses import MISSING, Field, dataclass, field, fields
from typing import Any, ClassVar, NamedTuple, cast

from ..laws import curvature, entrainment, friction, ground_metric
from ..terrain.mask_values import THICKEST
from . import material_table

USE = ("auto", "on", "off")
FASTEST = 1e3  # [m s-1] of a release; more is a typing error
HIGHEST_WALL = 1000.0  # [m] of a barrier above the ground, three times the highest dam; memory in 3D grows with it
DENSITY = 1000.0  # [kg m-3], default
CPU, CUDA, AUTO = DEVICES = ("cpu", "cuda", "auto")  # where steps are computed
WALLS, CLIFF = "barrier", "cliff"  # values of `reach` that are not a file of polygons
SOLVERS = {"columns": "the depth-averaged solver", "points": "the 3D solver"}  # name in a scene: in messages


class Entries(NamedTuple):
    """What a list or a table within a key contains."""

    kind: type | tuple[type, ...]
    words: str = ""  # what is expected, for messages
    length: int | None = None  # of a list; None: any from 1
    largest: float | None = None  # absolute value of a number
    names: tuple[str, ...] = ()  # of the entries of a table; (): any


class Rule(NamedTuple):
    """What applies to a table as a whole."""

    listed: bool = False  # there can be several: [[name]]
    required: bool = False
    solver: str | None = None  # the only one that has it
    fix: str = ""  # what to do with the other solver
    is_effect: bool = True  # a scene can have it or not; others define place, material and numerics
    in_use: bool = False  # the template shows it in use


class Table:
    """A table of a scene; a dataclass."""

    rule: ClassVar[Rule] = Rule()


CHECKS = {  # of a key, with their defaults
    "low": None,  # smallest value
    "above": False,  # the smallest value is not reached
    "high": None,  # largest value
    "choices": None,
    "entries": None,  # Entries of a list or a table
    "file": False,  # text is a path; where numbers or other text are allowed too: if it has a suffix or is there
    "solver": None,  # the only one that has the key
    "needs": "",  # a key of the same table without which this one has no use
    "of_code": False,  # for particles of another code
    "without_effect": False,  # no result depends on it
    "example": None,  # in the template, where there is no default
    "in_use": False,  # shown without a leading # in the template
}


def _key(doc: str, default: Any = MISSING, kind: type | tuple[type, ...] = float, **checks: Any) -> Any:
    """Return the field of one key of a table: its words in the template, its types, and CHECKS."""
    if unknown := checks.keys() - CHECKS:
        raise TypeError(f"{doc}: no such checks of a key: {unknown}")
    metadata = {"doc": doc, "kind": kind, **CHECKS, **checks}
    return field(default=default, metadata=metadata) if default is not MISSING else field(metadata=metadata)


_OF_CODE: dict[str, Any] = {
    "of_code": True,
    "needs": "particles",
    "solver": "points",
}  # a key for particles of another code


@dataclass(frozen=True)
class TerrainTable(Table):
    """Terrain model."""

    rule: ClassVar = Rule(required=True, is_effect=False, in_use=True)

    dem: str = _key("digital terrain model: any raster that GDAL reads, metres", kind=str, example="dtm.tif", file=True)
    crs: str | None = _key("for a DTM that carries no CRS: EPSG:n, or local", None, kind=str, example="EPSG:32632")
    to_crs: str | None = _key(
        "DTM in degrees or feet: reprojected to auto (the UTM zone of its centre), or EPSG:n",
        None,
        kind=str,
        example="auto",
    )
    band: int | None = _key("band with the elevation, where the DTM has several", None, kind=int, low=1, example=1)
    window: tuple | None = _key(
        "only this part of it: [west, south, east, north] [m]",
        None,
        kind=list,
        example=(600000, 5200000, 601000, 5201000),
        entries=Entries(float, "four numbers [west, south, east, north]", 4),
    )
    fill_nodata: str | None = _key(
        "holes inside the DTM: interpolated from the ground around them; default: flow into one leaves the terrain",
        None,
        kind=str,
        choices=("interpolate",),
        example="interpolate",
    )
    real_values: tuple | None = _key(
        "elevations [m] of constant regions behind walls that are ground; a flow must not reach any other",
        None,
        kind=list,
        example=(0.0,),
        entries=Entries(float, "elevations, for example [0]"),
    )


@dataclass(frozen=True)
class ReleaseTable(Table):
    """Release: the initial mass and where it lies."""

    rule: ClassVar = Rule(is_effect=False, in_use=True)

    source: str | None = _key(
        "release areas: any vector file, or a raster", None, kind=str, example="release.shp", file=True, in_use=True
    )
    particles: str | None = _key(
        "instead of source: columns that `mpmgis seed` wrote; in 3D also points, of mpmgis or another code",
        None,
        kind=str,
        example="a.h5",
        file=True,
    )
    at_time: float | None = _key(
        "particles of another code with several times: this one [s]", None, example=12.5, **_OF_CODE
    )
    reader: str | None = _key(
        "code of the particles, as `--reader`; default detected", None, kind=str, example="matter", **_OF_CODE
    )
    origin: tuple | None = _key(
        "of another code: E, N, H [m] of the origin of its coordinates",
        None,
        kind=list,
        example=(600000, 5170000, 0),
        entries=Entries(float, "three numbers [E, N, H]", 3),
        **_OF_CODE,
    )
    axes: tuple | None = _key(
        "of another code: directions of its x, y, z; default east, north, up where the particles lie on the terrain",
        None,
        kind=list,
        example=("e", "u", "-n"),
        entries=Entries(str, 'three words, as ["e", "u", "-n"]', 3),
        **_OF_CODE,
    )
    columns: dict | None = _key(  # noqa: RUF009
        "of another code: its names of position, velocity, x, vx, mass, volume, density, ...",
        None,
        kind=dict,
        example={"mass": "m"},
        entries=Entries(str, 'names, as {mass = "m"}'),
        **_OF_CODE,
    )
    particle_volume: float | None = _key(
        "of another code: volume of each particle [m3]", None, low=0.0, above=True, example=0.01, **_OF_CODE
    )
    times: tuple | None = _key(
        "of another code, with at_time: times [s] of its frames",
        None,
        kind=list,
        example=(0, 10),
        entries=Entries(float, "numbers"),
        **_OF_CODE,
    )
    dt: float | None = _key(
        "or: time from one frame number to the next [s]", None, low=0.0, above=True, example=0.5, **_OF_CODE
    )
    fps: float | None = _key("or: frame numbers per second [s-1]", None, low=0.0, above=True, example=20.0, **_OF_CODE)
    sidecar: str | None = _key(
        "of another code: file with these keys; default <name>.georef.json or georef.json beside the particles",
        None,
        kind=str,
        example="a.georef.json",
        file=True,
        **_OF_CODE,
    )
    window: str | None = _key(
        "with particles: only those in these polygons; the mass of the others is reported",
        None,
        kind=str,
        example="box.gpkg",
        file=True,
        solver="points",
        needs="particles",
    )
    thickness: float | str | None = _key(
        "number [m], column name, or raster; without it the column thickness, d0 or relth",
        None,
        kind=(float, str),
        low=0.0,
        high=THICKEST,
        above=True,
        example=1.5,
        file=True,
        in_use=True,
    )
    thickness_mode: str = _key(
        "thickness measured normal to the slope, or vertical", "normal", str, choices=("normal", "vertical")
    )
    surface: str | None = _key(
        "instead of thickness: raster of the surface before release", None, kind=str, example="surface.tif", file=True
    )
    density: float | None = _key(
        "bulk density [kg m-3]; without it 1000, which the run reports", None, low=1.0, high=30000.0, example=1000.0
    )
    velocity: tuple = _key(
        "initial velocity (east, north) [m s-1]",
        (0.0, 0.0),
        kind=list,
        entries=Entries(float, f"two numbers [east, north] of at most {FASTEST:g} m/s", 2, FASTEST),
    )
    speed: float | None = _key(
        "instead of velocity: initial speed down the steepest descent [m s-1]",
        None,
        low=0.0,
        high=FASTEST,
        above=True,
        example=10.0,
    )
    points: str = _key(
        "point set; staggered: no two columns of a cell share x or y: a stretched flow stays even",
        "staggered",
        str,
        choices=("staggered", "lattice", "jittered", "halton", "random"),
    )
    seed: int = _key("seed of the random point sets", 0, kind=int, low=0)


@dataclass(frozen=True)
class HydrographTable(Table):
    """Inflow over time."""

    rule: ClassVar = Rule(solver="columns", fix="start with [release]")

    source: str = _key(
        "the inlet: polygons of any vector file, or a raster mask", kind=str, example="inlet.shp", file=True
    )
    file: str = _key(
        "CSV: time [s], discharge [m3 s-1] or thickness [m] (a slab each time), maybe speed or velocity_east, _north",
        kind=str,
        example="hydrograph.csv",
        file=True,
    )
    thickness_mode: str = _key(
        "thickness of slabs measured normal to the slope, or vertical", "normal", str, choices=("normal", "vertical")
    )
    density: float | None = _key(
        "bulk density [kg m-3]; without it that of [release], or 1000", None, low=1.0, high=30000.0, example=1000.0
    )
    use: str = _key("auto and on: it flows in; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class SecondaryReleaseTable(Table):
    """Mass at rest that the flow releases when it reaches it; one table per area."""

    rule: ClassVar = Rule(listed=True, solver="columns", fix="start with [release]")

    source: str = _key("its areas: any vector file, or a raster", kind=str, example="secondary.shp", file=True)
    thickness: float | str | None = _key(
        "number [m], column name, or raster; without it the column thickness, d0 or relth",
        None,
        kind=(float, str),
        low=0.0,
        high=THICKEST,
        above=True,
        example=1.0,
        file=True,
    )
    thickness_mode: str = _key(
        "thickness measured normal to the slope, or vertical", "normal", str, choices=("normal", "vertical")
    )
    density: float | None = _key(
        "bulk density [kg m-3]; must be that of [release]", None, low=1.0, high=30000.0, example=1000.0
    )
    trigger_thickness: float | None = _key(
        "released by flow thicker than this [m]; default any flow", None, low=0.0, above=True, example=0.5
    )
    use: str = _key("auto and on: released when reached; off: not used", "auto", str, choices=USE)


@dataclass(frozen=True)
class FrictionTable(Table):
    """Resistance of the bed; without this table there is none."""

    rule: ClassVar = Rule(in_use=True)

    law: str = _key('law of basal resistance, or a user-defined law: "my_law.py:MyLaw"', kind=str, example="Voellmy")
    use: str = _key("auto: without turbulent drag where it changes little", "auto", str, choices=USE)
    parameters: dict = field(
        default_factory=dict, metadata={"parameters_of": friction.LAWS, "contradiction": friction.contradiction}
    )
    written: dict = field(default_factory=dict)  # alternatives to parameters in the scene: k for xi, size for mu
    chosen: str = ""  # why a size by volume is which one, once the release is known

    def parameter_words(self) -> str:
        """Return the parameters with their units, as text."""
        words = ((name, friction.parameter_words(self.law, name, float(v))) for name, v in self.parameters.items())
        return ", ".join(f"{name} = {text}" for name, text in words)


@dataclass(frozen=True)
class MaterialTable(Table):
    """Material of a 3D flow."""

    rule: ClassVar = Rule(solver="points", fix="its material is defined by [friction] and related tables")

    law: str = _key("law of the material", kind=str, choices=tuple(material_table.MATERIALS), example="DruckerPrager")
    match: str | None = _key(
        "of DruckerPrager, CohesiveMuI: match of the cone to Mohr-Coulomb; default triaxial (too strong for slides)",
        None,
        kind=str,
        choices=("triaxial", "plane_strain"),
        example="triaxial",
    )
    tension_limit: float | None = _key(
        "of DruckerPrager, CohesiveMuI: largest tension [Pa]; default 10 times the cohesion",
        None,
        low=0.0,
        high=1e9,
        example=1000.0,
    )
    volume_correction: bool | None = _key(
        "not of Fluid and Elastic: separated material bears load only after compression; default true",
        None,
        kind=bool,
        example=True,
    )
    pressure: str | None = _key(
        "of Fluid: K (1 / J - 1), or Tait's; without it linear",
        None,
        kind=str,
        choices=("linear", "tait"),
        example="linear",
    )
    parameters: dict = field(
        default_factory=dict,
        metadata={"parameters_of": material_table.MATERIALS, "contradiction": material_table.contradiction},
    )


@dataclass(frozen=True)
class SofteningTable(Table):
    """Permanent loss of strength of DruckerPrager and CohesiveMuI with shear."""

    rule: ClassVar = Rule(solver="points", fix="take it out, or set solver = 'points'")

    residual_friction_angle: float = _key("residual friction angle [degrees]", low=0.0, high=80.0, example=20.0)
    residual_cohesion: float = _key("residual cohesion [Pa]", 0.0, low=0.0, high=1e9)
    coefficient: float = _key(
        "xi_s: strength decreases as exp(-xi_s e_d); depends on the cell size [1]", 10.0, low=0.0, high=1e6
    )
    form: str = _key(
        "decrease of the angle, of its tangent, or linear over 1 / coefficient",
        "exponential",
        str,
        choices=("exponential", "tangent", "linear"),
    )
    peak_strain: float = _key("linear form: plastic strain at its beginning [1]", 0.0, low=0.0, high=1e6)
    use: str = _key("auto: on where it reduces friction or cohesion", "auto", str, choices=USE)


@dataclass(frozen=True)
class ZoneTable(Table):
    """Spatially varying friction: parameters of the law of [friction]; where zones overlap the later one applies."""

    rule: ClassVar = Rule(listed=True)

    source: str | None = _key(
        "polygons, or a raster mask; default: where the rasters below have values",
        None,
        kind=str,
        example="zones.gpkg",
        file=True,
    )
    use: str = _key("auto and on: it acts; off: this zone is not used", "auto", str, choices=USE)
    parameters: dict = field(default_factory=dict, metadata={"by_place": "mu = 0.3"})


@dataclass(frozen=True)
class CohesionTable(Table):
    """A yield stress at the bed, in addition to [friction]."""

    rule: ClassVar = Rule(solver="columns", fix="give [material] cohesion")

    yield_stress: float = _key("[Pa]", low=0.0, high=1e7, example=100.0)
    use: str = _key("auto: on above 0.2 % of the load of the release", "auto", str, choices=USE)


@dataclass(frozen=True)
class EarthPressureTable(Table):
    """Earth pressure: less than hydrostatic where the flow stretches, more where it is compressed."""

    rule: ClassVar = Rule(solver="columns", fix="use [material] friction_angle")

    friction_angle: float = _key("internal friction angle phi [degrees]", low=0.0, high=89.0, above=True, example=35.0)
    bed_friction_angle: float | None = _key(
        "at the bed, at most phi [degrees]; without it atan(mu)", None, low=0.0, high=89.0, example=25.0
    )
    use: str = _key("auto: on where it changes more than 3 % of the drive", "auto", str, choices=USE)


@dataclass(frozen=True)
class ViscosityTable(Table):
    """Viscous stress in the plane of the map; that on the bed belongs to [friction] (law Bingham)."""

    rule: ClassVar = Rule(solver="columns", fix="give [material] law = 'Fluid' with viscosity")

    viscosity: float = _key("plastic viscosity [Pa s]", low=0.0, high=1e9, example=50.0)
    yield_stress: float = _key("[Pa]", 0.0, low=0.0, high=1e7)
    use: str = _key("auto: on where it changes more than 5 % of the drive", "auto", str, choices=USE)


@dataclass(frozen=True)
class EntrainmentTable(Table):
    """Entrainment of bed material by the flow."""

    rule: ClassVar = Rule(solver="columns", fix="take it out, or set solver = 'columns'")

    law: str = _key("law of erosion", kind=str, choices=tuple(entrainment.LAWS), example="ErosionEnergy")
    source: str = _key(
        "erodible ground: polygons with thickness, or a raster of its thickness [m]",
        kind=str,
        example="erodible.gpkg",
        file=True,
    )
    thickness: float | str | None = _key(
        "of the erodible ground: number [m] or column name; with a raster: it is a mask, and a number",
        None,
        kind=(float, str),
        low=0.0,
        high=THICKEST,
        above=True,
        example=0.5,
    )
    thickness_mode: str = _key(
        "thickness measured normal to the slope, or vertical", "normal", str, choices=("normal", "vertical")
    )
    density: float | None = _key(
        "of the bed [kg m-3]; default that of the flow", None, low=1.0, high=30000.0, example=200.0
    )
    lower_bed: bool = _key("the bed is lowered by the eroded thickness", False, kind=bool)
    use: str = _key("auto and on: the bed erodes; off: it does not", "auto", str, choices=USE)
    parameters: dict = field(default_factory=dict, metadata={"parameters_of": entrainment.LAWS})


@dataclass(frozen=True)
class ForestTable(Table):
    """Forest that slows the flow, stops part of its mass and breaks; it acts only where it is named."""

    rule: ClassVar = Rule(listed=True, solver="columns", fix="take it out, or set solver = 'columns'")

    strength: float | str = _key(
        "pressure rho U^2 that breaks it [Pa]: number, column or raster",
        kind=(float, str),
        low=0.0,
        high=1e9,
        above=True,
        example=10000.0,
        file=True,
    )
    source: str | None = _key(
        "polygons, or a raster mask; default: where the rasters below have values",
        None,
        kind=str,
        example="forest.gpkg",
        file=True,
    )
    detrainment: float | str = _key(
        "K [Pa], mass stops at K / U: number, column or raster", 0.0, kind=(float, str), low=0.0, high=1e6, file=True
    )
    drag: float | str = _key(
        "added drag c of rho h c U^2 [m-1]: number, column or raster",
        0.0,
        kind=(float, str),
        low=0.0,
        high=100.0,
        file=True,
    )
    friction: float | str = _key(
        "added to the friction coefficient [1]: number, column or raster",
        0.0,
        kind=(float, str),
        low=0.0,
        high=10.0,
        file=True,
    )
    detrainment_speed: float | str = _key(
        "speed [m s-1]: mass stops only of flow that is slower, or thinner than the next key; drag and friction act "
        "only on other flow; both 0: all act together",
        0.0,
        kind=(float, str),
        low=0.0,
        high=1000.0,
        file=True,
    )
    detrainment_thickness: float | str = _key(
        "see detrainment_speed; thickness normal to the ground [m]",
        0.0,
        kind=(float, str),
        low=0.0,
        high=1000.0,
        file=True,
    )
    breaking_thickness: float | str = _key(
        "thickness normal to the ground above which it breaks [m]; 0: none",
        0.0,
        kind=(float, str),
        low=0.0,
        high=1000.0,
        file=True,
    )
    use: str = _key("auto and on: it acts; off: not used", "auto", str, choices=USE)


@dataclass(frozen=True)
class BarrierTable(Table):
    """A wall that the flow passes only above its crest: estimates only, loads require a 3D run."""

    rule: ClassVar = Rule(listed=True)

    source: str = _key("polygons, or lines with width", kind=str, example="dam.gpkg", file=True)
    height: float | str | None = _key(
        "of the crest above the terrain: number [m] or column name",
        None,
        kind=(float, str),
        low=0.0,
        high=HIGHEST_WALL,
        above=True,
        example=8.0,
    )
    crest: float | str | None = _key(
        "instead of height: elevation of the crest: number [m] or column name", None, kind=(float, str), example=1500.0
    )
    width: float | None = _key("of a wall that is drawn as a line [m]", None, low=0.0, above=True, example=2.0)
    mu: float = _key("friction of the flow along the wall [1]", 0.0, low=0.0, high=10.0)
    name: str | None = _key("in results; without it the column name, or the file's name", None, kind=str, example="dam")
    use: str = _key("auto and on: it stands there; off: not used", "auto", str, choices=USE)


@dataclass(frozen=True)
class CurvatureTable(Table):
    """Curvature of the bed (form slope): tangent transport and centrifugal load."""

    rule: ClassVar = Rule(solver="columns", fix="3D flow follows the ground by itself; take it out")

    use: str = _key(
        "auto: on where it changes more than 5 % of the load; turn, load: one part, for tests",
        "auto",
        str,
        choices=(*USE, *curvature.PARTS),
    )


@dataclass(frozen=True)
class StillWaterTable(Table):
    """Lakes at rest as reference (form swe): the water bodies below the still level that are filled at the start."""

    rule: ClassVar = Rule(solver="columns", fix="water is at rest by itself; take it out")

    level: float | str = _key(
        "elevation of the still surface: number [m], or column name of source", kind=(float, str), example=1500.0
    )
    source: str | None = _key(
        "polygons that touch the lakes; without it every one with water at the start",
        None,
        kind=str,
        example="lakes.gpkg",
        file=True,
    )
    use: str = _key("auto and on: used; off: not used", "auto", str, choices=USE)


@dataclass(frozen=True)
class NumericsTable(Table):
    """Numerical parameters."""

    rule: ClassVar = Rule(is_effect=False, in_use=True)

    cell_size: float | None = _key(
        "solver cell [m]; default that of the DTM", None, low=0.0, above=True, example=5.0, in_use=True
    )
    particles_per_cell: int = _key("columns a cell: 4, 9, 16, 25...", 9, kind=int, low=1, high=400, solver="columns")
    points_per_cell: int = _key("3D: points a cell at the start", 8, kind=int, choices=(8, 27, 64), solver="points")
    precision: str = _key(
        "3D: float32: half the memory, two thirds of the time; columns are always float64",
        "float64",
        str,
        choices=("float64", "float32"),
    )
    device: str = _key(
        "cpu; cuda: a GPU of NVIDIA; auto: cuda where there is one and particles are many",
        "cpu",
        str,
        choices=DEVICES,
        without_effect=True,
    )
    companion: bool | None = _key(
        "afterwards a run on cells twice as large, for the numerical error; default true for columns alone",
        None,
        kind=bool,
        example=True,
        without_effect=True,
    )
    form: str = _key(
        "slope: mass flows on steep ground; swe: water, gentle beds",
        "slope",
        str,
        choices=tuple(ground_metric.FORMS),
        solver="columns",
    )
    edges: str = _key("edges of the terrain: open (outflow is reported) or wall", "open", str, choices=("open", "wall"))
    cfl: float | None = _key(
        "Courant number; without it 0.6 (0.3 with barriers, erosion, inflow; 3D 0.4, at most 0.9)",
        None,
        low=0.0,
        high=0.9,
        above=True,
        example=0.6,
    )
    clamp: float = _key(
        "keep columns within this factor of the grid's thickness; 0: off", 0.0, low=0.0, solver="columns"
    )
    stiffness: str = _key(
        "3D: scaled: bulk modulus at most rho (10 U)^2, U the energy line's speed: longer steps",
        "given",
        str,
        choices=("given", "scaled"),
        solver="points",
    )

    clearance: float = _key(
        "3D: at cliffs and kinks nodes up to this many cells above the ground touch it",
        0.5,
        low=0.0,
        high=1.0,
        solver="points",
    )

    @property
    def points_per_side(self) -> int:
        """Initial points along the side of a cell."""
        return round(self.points_per_cell ** (1.0 / 3.0))


@dataclass(frozen=True)
class OutputTable(Table):
    """Output and end of the run."""

    rule: ClassVar = Rule(required=True, is_effect=False, in_use=True)

    end_time: float = _key("longest simulated time [s]", low=0.0, above=True, example=120.0)
    frame_interval: float = _key("time between frames [s]", low=0.0, above=True, example=2.0)
    maxima: bool = _key("keep running peaks of every step in the frames", False, kind=bool)
    arrival_thickness: float | None = _key(
        "with maxima: arrival, peak speed and pressure are of flow this thick (vertical) [m]; without it 0.05",
        None,
        low=0.0,
        high=1000.0,
        above=True,
        example=0.05,
        needs="maxima",
    )
    rasters: bool = _key(
        "write the bands of each frame as rasters in maps/, and particles for a restart only", False, kind=bool
    )
    raster_cell_size: float | None = _key(
        "with rasters: their cells [m]; default the finer of those of DTM and run",
        None,
        low=0.0,
        above=True,
        example=2.0,
        needs="rasters",
    )
    raster_min_depth: float | None = _key(
        "with rasters: no speed where the flow is thinner [m]; without it 0.05",
        None,
        low=0.0,
        example=0.1,
        needs="rasters",
    )
    raster_products: str | None = _key(
        "with rasters: more bands, as `export-raster --products`", None, kind=str, example="p,mass", needs="rasters"
    )
    stop_at_rest: bool | None = _key(
        "end early when the flow has come to rest; default: not in swe, nor for a Fluid", None, kind=bool, example=True
    )


@dataclass(frozen=True)
class StageTable(Table):
    """A part of the run in time, by one solver; the next stage continues from its end."""

    rule: ClassVar = Rule(listed=True, is_effect=False)

    solver: str = _key("of this stage", kind=str, choices=tuple(SOLVERS), example="columns")
    until: dict | None = _key(  # noqa: RUF009
        'when it ends: {time = 30} [s], {reach = "barrier"}, "cliff" or a file, of points {calm = 1} [s]; or several',
        None,
        kind=dict,
        example={"time": 30.0},
        entries=Entries((float, str), names=("time", "reach", "calm")),
    )
    window: str | None = _key(
        "of points: only the flow in these polygons is converted to points",
        None,
        kind=str,
        example="box.gpkg",
        file=True,
    )
    outside: str | None = _key(
        "flow outside window: removed (ledger), or continued as columns; default ledger",
        None,
        kind=str,
        choices=("ledger", "columns"),
        example="columns",
    )
    cell_size: float | None = _key("in place of [numerics] cell_size [m]", None, low=0.0, above=True, example=1.0)

    @property
    def reach(self) -> str | None:
        """Feature that the flow has to reach; None without this condition."""
        return (self.until or {}).get("reach")

    @property
    def reached_file(self) -> str | None:
        """Name of the file of polygons that the flow has to reach; None if it is not a file."""
        return None if self.reach in (WALLS, CLIFF) else self.reach


TABLES: dict[str, type[Table]] = {
    "terrain": TerrainTable,
    "release": ReleaseTable,
    "hydrograph": HydrographTable,
    "secondary_release": SecondaryReleaseTable,
    "friction": FrictionTable,
    "material": MaterialTable,
    "softening": SofteningTable,
    "zones": ZoneTable,
    "cohesion": CohesionTable,
    "earth_pressure": EarthPressureTable,
    "viscosity": ViscosityTable,
    "curvature": CurvatureTable,
    "still_water": StillWaterTable,
    "entrainment": EntrainmentTable,
    "forest": ForestTable,
    "barrier": BarrierTable,
    "numerics": NumericsTable,
    "output": OutputTable,
    "stage": StageTable,
}
LISTED = tuple(name for name, kind in TABLES.items() if kind.rule.listed)


def keys_of(kind: type[Table]) -> dict[str, Field[Any]]:
    """Return the keys of a table by name; the metadata of each are its checks and words.

    Parameters
    ----------
    kind : type
        Class of the table.
    """
    return {f.name: f for f in fields(cast("Any", kind)) if "kind" in f.metadata}


def laws_of(kind: type[Table]) -> dict[str, tuple[Any, Any]] | None:
    """Return the laws that a table chooses from: name -> (law, parameters); None where it has one law.

    Parameters
    ----------
    kind : type
        Class of the table.
    """
    return next((f.metadata["parameters_of"] for f in fields(cast("Any", kind)) if "parameters_of" in f.metadata), None)


OF_PARTICLES = tuple(name for name, f in keys_of(ReleaseTable).items() if f.metadata["of_code"])
WITHOUT_EFFECT = tuple(name for name, f in keys_of(NumericsTable).items() if f.metadata["without_effect"])
