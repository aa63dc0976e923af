"""A scene: what is asked. One set of tables is the TOML form, the Python form, its checks and its documentation.

A table that is present is an effect in the scene; unknown tables and keys are errors.
"""

import codecs
import difflib
import hashlib
import json
import math
import re
import sys
import tomllib
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from pathlib import Path

from ..effects import curvature, entrainment, friction, metric
from ..effects.own_law import NO_OWN_LAWS, OwnLaws
from ..errors import SceneError, one_line
from . import materials
from .solver_tables import ONLY, check_points, check_solver
from .stages import CLIFF, WALLS, check_stages

USE = ("auto", "on", "off")
THICKEST, FASTEST = 1e4, 1e3  # [m], [m s-1] of a release; more is a slip of the pen
KIND_WORDS = {
    float: "a number", int: "a whole number", str: "text", bool: "true or false", list: "a list of numbers",
    dict: "a table like {time = 30}",
}  # fmt: skip


def _key(doc, default=MISSING, kind=float, low=None, high=None, choices=None, above=False, example=None, file=False,
         solver=None):  # fmt: skip
    """One key of a table: its words in the template and the checks on its value.

    `low` is the smallest value (`above`: not reached), `high` the largest; `kind` a type or tuple of types; the text
    of a `file` is a path (where numbers or other text are allowed too: if it has a suffix or is there). `solver` is
    the only one that has the key.
    """
    metadata = {
        "doc": doc, "kind": kind, "low": low, "high": high, "choices": choices, "above": above, "example": example,
        "file": file, "solver": solver,
    }  # fmt: skip
    return field(default=default, metadata=metadata) if default is not MISSING else field(metadata=metadata)


@dataclass(frozen=True)
class TerrainTable:
    """Where."""

    dem: str = _key("digital terrain model: any raster that GDAL reads, metres", kind=str, example="dtm.tif",
                    file=True)  # fmt: skip
    crs: str | None = _key("for a DTM that carries no CRS: EPSG:n, or local", None, kind=str, example="EPSG:32632")
    band: int | None = _key("band with the elevation, where the DTM has several", None, kind=int, low=1, example=1)
    window: tuple | None = _key("only this part of it: [west, south, east, north] [m]", None, kind=list,
                                example=(600000, 5200000, 601000, 5201000))  # fmt: skip
    fill_nodata: str | None = _key("holes amid the DTM: interpolated from the ground around them; without it what "
                                   "flows into one has left the terrain", None, kind=str, choices=("interpolate",),
                                   example="interpolate")  # fmt: skip


DENSITY = 1000.0  # [kg m-3], assumed where a scene gives none


@dataclass(frozen=True)
class ReleaseTable:
    """What starts to move."""

    source: str | None = _key("release areas: any vector file, or a raster", None, kind=str, example="release.shp",
                              file=True)  # fmt: skip
    particles: str | None = _key("instead of source: columns that `mpmgis seed` wrote, or points in 3D", None, kind=str,
                                 example="a.h5", file=True)  # fmt: skip
    window: str | None = _key("of particles: only what lies in these polygons; the rest is left out, and said", None,
                              kind=str, example="box.gpkg", file=True, solver="points")  # fmt: skip
    thickness: float | str | None = _key(
        "number [m], column name, or raster; without it the column thickness, d0 or relth",
        None,
        kind=(float, str),
        low=0.0,
        high=THICKEST,
        above=True,
        example=1.5,
        file=True,
    )
    thickness_mode: str = _key("thickness measured normal to the slope, or vertical", "normal", str,
                               choices=("normal", "vertical"))  # fmt: skip
    surface: str | None = _key("instead of thickness: raster of the surface before release", None, kind=str,
                               example="surface.tif", file=True)  # fmt: skip
    density: float | None = _key("bulk density [kg m-3]; without it 1000, which the run reports", None, low=1.0,
                                 high=30000.0, example=1000.0)  # fmt: skip
    velocity: tuple = _key("initial velocity (east, north) [m s-1]", (0.0, 0.0), kind=list)
    speed: float | None = _key("instead of velocity: initial speed down the steepest descent [m s-1]", None, low=0.0,
                               high=FASTEST, above=True, example=10.0)  # fmt: skip
    points: str = _key("point set; staggered: no two columns of a cell share x or y: a stretched flow stays even",
                       "staggered", str, choices=("staggered", "lattice", "jittered", "halton", "random"))  # fmt: skip
    seed: int = _key("seed of the random point sets", 0, kind=int, low=0)


@dataclass(frozen=True)
class HydrographTable:
    """What flows in over time."""

    source: str = _key("the inlet: polygons of any vector file, or a raster mask", kind=str, example="inlet.shp",
                       file=True)  # fmt: skip
    file: str = _key(
        "CSV: time [s], discharge [m3 s-1] or thickness [m] (a slab each time), maybe speed or velocity_east, _north",
        kind=str,
        example="hydrograph.csv",
        file=True,
    )
    thickness_mode: str = _key("thickness of slabs measured normal to the slope, or vertical", "normal", str,
                               choices=("normal", "vertical"))  # fmt: skip
    density: float | None = _key("bulk density [kg m-3]; without it that of [release], or 1000", None, low=1.0,
                                 high=30000.0, example=1000.0)  # fmt: skip
    use: str = _key("auto and on: it flows in; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class SecondaryReleaseTable:
    """Mass at rest that the flow releases when it gets there; as many of these tables as there are areas."""

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
    thickness_mode: str = _key("thickness measured normal to the slope, or vertical", "normal", str,
                               choices=("normal", "vertical"))  # fmt: skip
    density: float | None = _key("bulk density [kg m-3]; must be that of [release]", None, low=1.0, high=30000.0,
                                 example=1000.0)  # fmt: skip
    trigger_thickness: float | None = _key("released by flow thicker than this [m]; without it by any flow", None,
                                           low=0.0, above=True, example=0.5)  # fmt: skip
    use: str = _key("auto and on: released when reached; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class FrictionTable:
    """Resistance of the bed; without this table there is none."""

    law: str = _key('law of basal resistance, or your own: "my_law.py:MyLaw"', kind=str, example="Voellmy")
    use: str = _key("auto: without turbulent drag where it changes little", "auto", str, choices=USE)
    parameters: dict = field(
        default_factory=dict, metadata={"parameters_of": friction.LAWS, "contradiction": friction.contradiction}
    )
    written: dict = field(default_factory=dict)  # what the scene gives in place of parameters: k for xi


@dataclass(frozen=True)
class MaterialTable:
    """What a 3D flow is made of."""

    law: str = _key("law of the material", kind=str, choices=tuple(materials.MATERIALS), example="DruckerPrager")
    match: str | None = _key(
        "of DruckerPrager: where its cone meets Mohr-Coulomb; without it triaxial (too strong for slides)", None,
        kind=str, choices=("triaxial", "plane_strain"), example="triaxial",
    )  # fmt: skip
    tension_limit: float | None = _key("of DruckerPrager: largest tension [Pa]; without it 10 times the cohesion", None,
                                       low=0.0, high=1e9, example=1000.0)  # fmt: skip
    volume_correction: bool | None = _key(
        "of DruckerPrager and MuI: what was pulled apart bears load only when pushed back; without it true", None,
        kind=bool, example=True,
    )  # fmt: skip
    pressure: str | None = _key("of Fluid: K (1 / J - 1), or Tait's; without it linear", None, kind=str,
                                choices=("linear", "tait"), example="linear")  # fmt: skip
    parameters: dict = field(
        default_factory=dict,
        metadata={"parameters_of": materials.MATERIALS, "contradiction": materials.contradiction},
    )


@dataclass(frozen=True)
class SofteningTable:
    """Strength that DruckerPrager loses for good where it is sheared."""

    residual_friction_angle: float = _key("what is left of friction_angle [degrees]", low=0.0, high=80.0, example=20.0)
    residual_cohesion: float = _key("what is left of cohesion [Pa]", 0.0, low=0.0, high=1e9)
    coefficient: float = _key("xi_s: strength fades as exp(-xi_s e_d); it belongs to a cell size [1]", 10.0, low=0.0,
                              high=1e6)  # fmt: skip
    form: str = _key("how it fades: of the angle, of its tangent, or in a straight line over 1 / coefficient",
                     "exponential", str, choices=("exponential", "tangent", "linear"))  # fmt: skip
    peak_strain: float = _key("of the linear form: plastic strain until which all is left [1]", 0.0, low=0.0, high=1e6)
    use: str = _key("auto: on where it takes friction or cohesion away", "auto", str, choices=USE)


@dataclass(frozen=True)
class ZoneTable:
    """Friction by place: parameters of the law of [friction]; where zones overlap the later one holds."""

    source: str | None = _key("polygons, or a raster mask; without it wherever the rasters below have values", None,
                              kind=str, example="zones.gpkg", file=True)  # fmt: skip
    use: str = _key("auto: on where a parameter differs by more than 2 % in reach; off: this zone is left out", "auto",
                    str, choices=USE)  # fmt: skip
    parameters: dict = field(default_factory=dict, metadata={"by_place": "mu = 0.3"})


@dataclass(frozen=True)
class CohesionTable:
    """A yield stress at the bed, added to whatever friction there is."""

    yield_stress: float = _key("[Pa]", low=0.0, high=1e7, example=100.0)
    use: str = _key("auto: on above 0.5 % of the load of the release", "auto", str, choices=USE)


@dataclass(frozen=True)
class EarthPressureTable:
    """Granular push: less than hydrostatic where the flow stretches, more where it is compressed."""

    friction_angle: float = _key("internal friction angle phi [degrees]", low=0.0, high=89.0, above=True, example=35.0)
    bed_friction_angle: float | None = _key("at the bed, at most phi [degrees]; without it atan(mu)", None, low=0.0,
                                            high=89.0, example=25.0)  # fmt: skip
    use: str = _key("auto: on where it changes more than 3 % of the drive", "auto", str, choices=USE)


@dataclass(frozen=True)
class ViscosityTable:
    """Viscous stress in the plane of the map; that on the bed belongs to [friction] (law Bingham)."""

    viscosity: float = _key("plastic viscosity [Pa s]", low=0.0, high=1e9, example=50.0)
    yield_stress: float = _key("[Pa]", 0.0, low=0.0, high=1e7)
    use: str = _key("auto: on where it changes more than 5 % of the drive", "auto", str, choices=USE)


@dataclass(frozen=True)
class EntrainmentTable:
    """The flow takes up its bed."""

    law: str = _key("law of erosion", kind=str, choices=tuple(entrainment.LAWS), example="ErosionEnergy")
    source: str = _key("erodible ground: polygons with thickness, or a raster of its thickness [m]", kind=str,
                       example="erodible.gpkg", file=True)  # fmt: skip
    thickness: float | str | None = _key(
        "of the erodible ground: number [m] or column name; a raster brings its own",
        None,
        kind=(float, str),
        low=0.0,
        high=THICKEST,
        above=True,
        example=0.5,
    )
    thickness_mode: str = _key("thickness measured normal to the slope, or vertical", "normal", str,
                               choices=("normal", "vertical"))  # fmt: skip
    density: float | None = _key("of the bed [kg m-3]; without it the flow's", None, low=1.0, high=30000.0,
                                 example=200.0)  # fmt: skip
    lower_bed: bool = _key("the bed sinks by what is taken from it", False, kind=bool)
    use: str = _key("auto: on where more than 5 % of the released mass lies in reach", "auto", str, choices=USE)
    parameters: dict = field(default_factory=dict, metadata={"parameters_of": entrainment.LAWS})


@dataclass(frozen=True)
class BarrierTable:
    """A wall that the flow passes only above its crest: screening, loads need a 3D run."""

    source: str = _key("polygons, or lines with width", kind=str, example="dam.gpkg", file=True)
    height: float | str | None = _key("of the crest above the terrain: number [m] or column name", None,
                                      kind=(float, str), low=0.0, above=True, example=8.0)  # fmt: skip
    crest: float | str | None = _key("instead of height: elevation of the crest: number [m] or column name", None,
                                     kind=(float, str), example=1500.0)  # fmt: skip
    width: float | None = _key("of a wall that is drawn as a line [m]", None, low=0.0, above=True, example=2.0)
    mu: float = _key("friction of the flow along the wall [1]", 0.0, low=0.0, high=10.0)
    name: str | None = _key("in results; without it the column name, or the file's name", None, kind=str, example="dam")
    use: str = _key("auto: on if the flow can reach it; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class CurvatureTable:
    """Curvature of the bed (form slope): tangent transport and centrifugal load."""

    use: str = _key("auto: on where it changes more than 5 % of the load; turn, load: one part, for tests", "auto", str,
                    choices=(*USE, *curvature.PARTS))  # fmt: skip


@dataclass(frozen=True)
class StillWaterTable:
    """Lakes at rest as reference (form swe): the water bodies below the still level that are filled at the start."""

    level: float | str = _key("elevation of the still surface: number [m], or column name of source",
                              kind=(float, str), example=1500.0)  # fmt: skip
    source: str | None = _key("polygons that touch the lakes; without it every one with water at the start", None,
                              kind=str, example="lakes.gpkg", file=True)  # fmt: skip
    use: str = _key("auto and on: used; off: left out", "auto", str, choices=USE)


@dataclass(frozen=True)
class NumericsTable:
    """How it is computed; none of this is physics."""

    cell_size: float | None = _key("solver cell [m]; without it the DTM's own", None, low=0.0, above=True, example=5.0)
    particles_per_cell: int = _key("columns a cell: 4, 9, 16, 25...", 9, kind=int, low=1, high=400, solver="columns")
    points_per_cell: int = _key("3D: points a cell at the start", 8, kind=int, choices=(8, 27, 64), solver="points")
    precision: str = _key("3D: float32: half the memory, two thirds of the time; columns are always float64", "float64",
                          str, choices=("float64", "float32"))  # fmt: skip
    form: str = _key("slope: mass flows on steep ground; swe: water, gentle beds", "slope", str,
                     choices=tuple(metric.FORMS), solver="columns")  # fmt: skip
    edges: str = _key("edges of the terrain: open (outflow is booked) or wall", "open", str, choices=("open", "wall"))
    cfl: float | None = _key("Courant number; without it 0.6 (0.3 with barriers, erosion, inflow; 3D 0.4, at most 0.9)",
                             None, low=0.0, high=0.9, above=True, example=0.6)  # fmt: skip
    clamp: float = _key("keep columns within this factor of the grid's thickness; 0: off", 0.0, low=0.0,
                        solver="columns")  # fmt: skip
    stiffness: str = _key("3D: scaled: bulk modulus at most rho (10 U)^2, U the energy line's speed: longer steps",
                          "given", str, choices=("given", "scaled"), solver="points")  # fmt: skip

    clearance: float = _key("3D: at cliffs and kinks nodes up to this many cells above the ground touch it", 0.5,
                            low=0.0, high=1.0, solver="points")  # fmt: skip

    @property
    def points_per_side(self):
        """Points along a cell's side at the start."""
        return round(self.points_per_cell ** (1.0 / 3.0))


@dataclass(frozen=True)
class OutputTable:
    """What is kept, and when it ends."""

    end_time: float = _key("longest simulated time [s]", low=0.0, above=True, example=120.0)
    frame_interval: float = _key("time between frames [s]", low=0.0, above=True, example=2.0)
    maxima: bool = _key("keep running peaks of every step in the frames", False, kind=bool)
    arrival_thickness: float | None = _key(
        "with maxima: arrival, peak speed and pressure are of flow this thick (vertical) [m]; without it 0.05", None,
        low=0.0, high=1000.0, above=True, example=0.05,
    )  # fmt: skip
    stop_at_rest: bool | None = _key("end early when the flow has come to rest; default: not in swe, nor for a Fluid",
                                     None, kind=bool, example=True)  # fmt: skip


@dataclass(frozen=True)
class StageTable:
    """A part of the run in time, by one solver; the next one goes on from where it ends."""

    solver: str = _key("of this stage", kind=str, choices=("columns", "points"), example="columns")
    until: dict | None = _key(  # noqa: RUF009
        'when it ends: {time = 30} [s], {reach = "barrier"}, "cliff" or a file, of points {calm = 1} [s]; or several',
        None, kind=dict, example={"time": 30.0},
    )  # fmt: skip
    window: str | None = _key("of points: only what lies in these polygons becomes points", None, kind=str,
                              example="box.gpkg", file=True)  # fmt: skip
    outside: str | None = _key(
        "what lies outside window: booked and gone, or marched on as columns; without it ledger", None, kind=str,
        choices=("ledger", "columns"), example="columns",
    )  # fmt: skip
    cell_size: float | None = _key("in place of [numerics] cell_size [m]", None, low=0.0, above=True, example=1.0)

    @property
    def reach(self):
        """What the flow has to come near to; None where that ends nothing."""
        return (self.until or {}).get("reach")

    @property
    def reached_file(self):
        """Name of the file of polygons that the flow has to come near to; None where it is no file."""
        return None if self.reach in (WALLS, CLIFF) else self.reach


@dataclass(frozen=True)
class Scene:
    """A whole scene. Paths are as written, `folder` is what they are relative to."""

    terrain: TerrainTable
    output: OutputTable
    release: ReleaseTable | None = None
    hydrograph: HydrographTable | None = None
    secondary_release: tuple = ()  # of SecondaryReleaseTable
    numerics: NumericsTable = NumericsTable()
    friction: FrictionTable | None = None
    material: MaterialTable | None = None
    softening: SofteningTable | None = None
    zones: tuple = ()  # of ZoneTable
    cohesion: CohesionTable | None = None
    earth_pressure: EarthPressureTable | None = None
    viscosity: ViscosityTable | None = None
    curvature: CurvatureTable | None = None
    still_water: StillWaterTable | None = None
    entrainment: EntrainmentTable | None = None
    barrier: tuple = ()  # of BarrierTable
    stage: tuple = ()  # of StageTable
    solver: str = "columns"
    folder: str = "."
    own_laws: OwnLaws = NO_OWN_LAWS

    @property
    def laws(self):
        """Name -> (law, parameters) of all laws of friction that this scene may name: those that its solvers have."""
        return _laws(self.solvers, self.own_laws)

    @property
    def solvers(self):
        """The solvers that the scene uses."""
        return {stage.solver for stage in self.stage} or {self.solver}

    def alone(self):
        """A scene of one solver for each stage, as if that were all; of a scene without stages itself."""
        return tuple(self._alone(stage) for stage in self.stage) or (self,)

    def _alone(self, stage):
        others = {name: () if name in LISTED else None for name, (only, _) in ONLY.items() if only != stage.solver}
        numerics = replace(self.numerics, cell_size=stage.cell_size or self.numerics.cell_size)
        return replace(self, **others, numerics=numerics, solver=stage.solver, stage=())

    @property
    def columns_per_cell(self):
        """Columns a cell of the solver that a release is seeded with: of points those that stand side by side."""
        return self.numerics.points_per_side**2 if self.solver == "points" else self.numerics.particles_per_cell

    def densities(self):
        """(table, density [kg m-3]) of every table that lets something in and gives its density."""
        sources = [("[release]", self.release), ("[hydrograph]", self.hydrograph)]
        sources += [("[[secondary_release]]", table) for table in self.secondary_release]
        used = ((name, table) for name, table in sources if table is not None and getattr(table, "use", "") != "off")
        return [(name, table.density) for name, table in used if table.density is not None]

    def dry_friction(self):
        """Coefficient of the friction law at rest [1]; 0 where the scene has none."""
        return self.friction_value(friction.DRY) or 0.0

    def friction_value(self, role):
        """Value of the friction law's parameter with `role` (`effects.friction.ROLES`); None where there is none."""
        if self.friction is None or self.friction.use == "off":
            return None
        return friction.value_of_role(role, self.friction.parameters)

    def bed_friction_angle(self):
        """Friction angle at the bed for the earth pressure [degrees]: as given, else atan of the dry friction."""
        given = None if self.earth_pressure is None else self.earth_pressure.bed_friction_angle
        return math.degrees(math.atan(self.dry_friction())) if given is None else given

    def path(self, name):
        """The path that `name` in this scene means."""
        return Path(self.folder) / Path(name).expanduser()

    def tables(self):
        """(name, table) of every table that is there, several of one name for those in LISTED."""
        for name in TABLES:
            table = getattr(self, name)
            yield from ((name, entry) for entry in (table if name in LISTED else [table]) if entry is not None)

    def files(self):
        """Names of all files in the scene, as written."""
        return [value for _, table in self.tables() for value in self._named(table).values()]

    def with_files(self, renamed):
        """The same scene with every file's name passed through `renamed(name)`."""
        made = {name: () if name in LISTED else None for name in TABLES}
        for name, table in self.tables():
            moved = self._renamed(table, renamed)
            made[name] = (*made[name], moved) if name in LISTED else moved
        return replace(self, **made)

    def _renamed(self, table, renamed):
        """`table` with the names of its files passed through `renamed(name)`."""
        moved = {key: renamed(name) for key, name in self._named(table).items()}
        if "reach" in moved:
            moved["until"] = {**table.until, "reach": moved.pop("reach")}
        own = {key: moved.pop(key) for key in getattr(table, "parameters", {}) if key in moved}
        return replace(table, **moved, **({"parameters": {**table.parameters, **own}} if own else {}))

    def _named(self, table):
        """Key -> name of the files in `table`."""
        values = {f.name: (getattr(table, f.name), f.metadata["kind"]) for f in fields(table) if f.metadata.get("file")}
        if isinstance(table, ZoneTable):
            values |= {key: (value, (float, str)) for key, value in table.parameters.items()}
        if isinstance(table, StageTable):
            values["reach"] = (table.reached_file, str)
        return {
            key: value for key, (value, kind) in values.items()
            if isinstance(value, str) and (kind is str or Path(value).suffix or self.path(value).exists())
        }  # fmt: skip

    def as_tables(self):
        """The scene as the plain dictionary that TOML and JSON hold; absent tables and unset keys are left out."""
        tables = {} if self.stage else {"solver": self.solver}
        for name, table in self.tables():
            if name in LISTED:
                tables.setdefault(name, []).append(_plain(table, self.solvers))
            else:
                tables[name] = _plain(table, self.solvers)
        return tables

    def digest(self, *inputs):
        """Hex digest of the scene and of what else decides its result (digests of the input files)."""
        own = [self.own_laws.sha256] if self.own_laws.laws else []
        text = json.dumps([self.as_tables(), list(inputs), *own], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def _laws(solvers, own_laws):
    """Name -> (law, parameters) of the laws of friction that all of `solvers` have."""
    columns = {**friction.LAWS, **own_laws.laws}
    if "points" not in solvers:
        return columns
    return {name: law for name, law in materials.CONTACTS.items() if "columns" not in solvers or name in columns}


def _plain(table, solvers):
    """One table as a dictionary of what TOML holds; unset keys and those of no solver in use are left out."""
    others = {f.name for f in fields(table) if f.metadata.get("solver") not in (None, *solvers)}
    own = ("parameters", "written", *others)
    values = {k: v for k, v in asdict(table).items() if v is not None and k not in own}
    values.update(getattr(table, "parameters", {}))
    for name, value in getattr(table, "written", {}).items():
        del values[friction.IN_PLACE_OF[name][0]]
        values[name] = value
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


TABLES = {
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
    "barrier": BarrierTable,
    "numerics": NumericsTable,
    "output": OutputTable,
    "stage": StageTable,
}
MOST_DOTS = 100  # in a key
LISTED = ("secondary_release", "zones", "barrier", "stage")  # tables that a scene may have several of, written [[name]]
REQUIRED = ("terrain", "output")
SOLVERS = ("columns", "points")


def read_scene(path, own_laws=NO_OWN_LAWS):
    """Read and check `scene.toml` at `path`, with laws of the user's own; raises SceneError in one line."""
    path = Path(path)
    return scene_from_tables(read_toml(path), path.parent, path.name, own_laws)


def read_toml(path):
    """The dictionary in a TOML file as any editor saves it; raises SceneError in one line."""
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError(f"{path} is a pipe or a device, wanted a file; write the scene into one")
    try:
        text = _decoded(path.read_bytes())
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise SceneError(f"{path} is no readable text file but a folder; name the file in it") from error
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} is no readable text file ({one_line(error)[:80]})") from error
    _require_short_keys(path, text)
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: TOML's own, and whole numbers of thousands of digits
        raise SceneError(f"{path} is no valid TOML: {one_line(error)[:120]}{_cure(text, error)}") from error
    return tables


_MAY_BE_KEY = re.compile(r"[\w\s.\[\"'-]+")


def _require_short_keys(path, text):
    """Refuse dotted keys of many parts: the parser's memory and time grow with the square of their number."""
    for number, line in enumerate(text.splitlines(), 1):
        runs = _MAY_BE_KEY.finditer(line)  # a line begins with one, and one stands before each = of an inline table
        dots = max((run[0].count(".") for run in runs if run.start() == 0 or line[run.end() : run.end() + 1] == "="),
                   default=0)  # fmt: skip
        if dots > MOST_DOTS:
            raise SceneError(f"{path}, line {number}: a key of {dots + 1} parts; a scene's keys have one or two")


def _decoded(raw):
    """Text of a file as editors on any system save it: UTF-8, with or without a byte order mark, or UTF-16 with one."""
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return raw.decode("utf-16")
    return raw.decode("utf-8-sig")


def _cure(text, error):
    """What a line that TOML cannot read most likely means."""
    number = re.search(r"at line (\d+)", str(error))
    lines = text.splitlines()
    line = lines[int(number[1]) - 1] if number and int(number[1]) <= len(lines) else ""
    if re.search(r"=\s*-?\d+,\d", line):
        return "; numbers take a point, not a comma"
    if "\\" in line:
        return "; write paths with / or in 'single quotes'"
    if re.search(r"=\s*(?!(?:true|false|inf|nan)\b)[A-Za-z]", line):
        return '; words stand in "quotes"'
    return ""


def scene_from_tables(tables, folder=".", where="scene", own_laws=NO_OWN_LAWS):
    """Check a plain dictionary and make the Scene of it; raises SceneError naming table, key, value and cure."""
    tables = dict(tables)
    solver = tables.pop("solver", None)
    if solver not in (None, *SOLVERS):
        raise SceneError(f"{where}: solver = {solver!r}, this version has {_listed(SOLVERS)}")
    for name in tables:
        if name not in TABLES:
            raise SceneError(f"{where}: unknown table [{name}]{meant(name, TABLES)}; it takes {_listed(TABLES)}")
        if name in LISTED:
            if not (isinstance(tables[name], list) and all(isinstance(entry, dict) for entry in tables[name])):
                raise SceneError(f"{where}: there may be several {name}; write [[{name}]] on a line of its own")
        elif not isinstance(tables[name], dict):
            raise SceneError(f"{where}: {name} is no table; write [{name}] on a line of its own")
    for name in REQUIRED:
        if name not in tables:
            raise SceneError(f"{where}: the table [{name}] is missing; `mpmgis run --template` shows one")
    stages = _made("stage", tables.pop("stage", ()), where, own_laws, (), None)
    solver = _first_solver(solver, stages, where)
    solvers = {stage.solver for stage in stages} or {solver}
    check_solver(tables, solvers, TABLES, where)
    by_place = {key for zone in tables.get("zones", ()) if zone.get("use") != "off" for key in zone}
    instead = friction.given_instead(tables.get("friction", {}).get("law"))
    by_place |= {parameter for name, (parameter, _) in instead.items() if name in by_place}
    contacts = _laws(solvers, NO_OWN_LAWS) if "points" in solvers else None
    made = {name: _made(name, values, where, own_laws, by_place, contacts) for name, values in tables.items()}
    scene = Scene(**made, stage=stages, solver=solver, folder=str(folder), own_laws=own_laws)
    if own_laws.laws and (scene.friction is None or scene.friction.law not in own_laws.laws):
        raise SceneError(f"{where}: --law {own_laws.path} was given, but [friction] does not name it; leave --law out")
    _check_together(scene, where)
    return scene


def _first_solver(solver, stages, where):
    """The solver that a run begins with: that of the first stage, or `solver` as the scene says (None: it does not)."""
    if not stages:
        return solver or "columns"
    if solver not in (None, stages[0].solver):
        raise SceneError(
            f"{where}: solver = {solver!r}, but the first [[stage]] has {stages[0].solver!r}; take the line out, the "
            "stages say it"
        )
    return stages[0].solver


def _made(name, values, where, own_laws, by_place, contacts):
    """The table `name`, or the tuple of all tables of that name, from what TOML gave."""
    if name == "friction":
        return _table(TABLES[name], values, f"{where} [{name}]", own_laws, by_place, contacts)
    if name not in LISTED:
        return _table(TABLES[name], values, f"{where} [{name}]")
    return tuple(_table(TABLES[name], v, f"{where} [[{name}]] number {k}") for k, v in enumerate(values, 1))


def _check_together(scene, where):
    """What no single key can tell."""
    numerics, output = scene.numerics, scene.output
    _check_sources(scene, where)
    _check_window(scene.terrain.window, where)
    check_stages(scene, where)
    if "points" in scene.solvers:
        check_points(scene, where)
    elif numerics.precision != "float64":
        raise SceneError(
            f"{where} [numerics]: precision = {numerics.precision!r} belongs to solver = 'points'; columns are "
            "computed in float64, float32 would save 5 % of their time: take it out"
        )
    _check_material(scene, where)
    _check_zones(scene, where)
    _check_places(scene, where)
    if 0.0 < numerics.clamp < 1.0:
        raise SceneError(f"{where} [numerics]: clamp = {numerics.clamp:g} leaves no thickness; take 1 or more, or 0")
    if output.frame_interval > output.end_time:
        raise SceneError(
            f"{where} [output]: frame_interval = {output.frame_interval:g} is longer than end_time = "
            f"{output.end_time:g}; take a shorter one"
        )
    if output.end_time / output.frame_interval > 1e6:
        raise SceneError(f"{where} [output]: more than a million frames; take a longer frame_interval")
    if output.arrival_thickness is not None and not output.maxima:
        raise SceneError(f"{where} [output]: arrival_thickness is kept only with maxima = true; add it, or take it out")
    if numerics.form == "swe" and scene.curvature is not None and scene.curvature.use not in ("auto", "off"):
        use = scene.curvature.use
        raise SceneError(f"{where} [curvature]: use = {use!r} belongs to form = 'slope'; take the table out")
    if numerics.form != "swe" and scene.still_water is not None and scene.still_water.use != "off":
        raise SceneError(f"{where} [still_water]: a lake at rest needs [numerics] form = 'swe'")


def _check_sources(scene, where):
    """What starts to move: from an area, from particles, through an inlet, or several of these with one density."""
    release, inflow = scene.release, scene.hydrograph
    if release is None and (inflow is None or inflow.use == "off"):
        raise SceneError(
            f"{where}: the table [release] is missing, and no [hydrograph] lets anything in; "
            "`mpmgis run --template` shows both"
        )
    if release is None:
        return
    if (release.source is None) == (release.particles is None):
        got = "both" if release.source else "none"
        raise SceneError(f"{where} [release]: wanted either source or particles, got {got}")
    if release.particles is not None:
        _refuse_unused(release, ("source", "particles", "window"), f"{where} [release]")
    elif release.window is not None:
        raise SceneError(f"{where} [release]: window cuts particles, a source has its own outline; take window out")
    if len(release.velocity) != 2 or not all(_is_number(v) and abs(v) <= FASTEST for v in release.velocity):
        raise SceneError(
            f"{where} [release]: velocity = {str(list(release.velocity))[:60]}, wanted two numbers [east, north] of at "
            f"most {FASTEST:g} m/s"
        )
    if release.speed is not None and any(release.velocity):
        raise SceneError(f"{where} [release]: speed and velocity exclude each other; take one of them out")


def _check_window(window, where):
    """Four numbers in their order."""
    if window is None:
        return
    if len(window) != 4 or not all(_is_number(v) and math.isfinite(v) for v in window):
        raise SceneError(f"{where} [terrain]: window = {list(window)}, wanted four numbers [west, south, east, north]")
    if not (window[0] < window[2] and window[1] < window[3]):
        raise SceneError(
            f"{where} [terrain]: window = {list(window)}, wanted west below east and south below north, in this order"
        )


def _check_material(scene, where):
    """Values of resistance that contradict each other."""
    table = scene.earth_pressure
    if table is not None and table.use != "off" and scene.bed_friction_angle() > table.friction_angle:
        of_mu = "" if table.bed_friction_angle is not None else " (atan of the friction coefficient)"
        raise SceneError(
            f"{where} [earth_pressure]: the bed's friction angle, {scene.bed_friction_angle():.4g} degrees{of_mu}, is "
            f"above friction_angle = {table.friction_angle:g}; give bed_friction_angle, at most that"
        )
    table = scene.viscosity
    if table is not None and table.viscosity == 0.0 and table.yield_stress == 0.0:
        raise SceneError(f"{where} [viscosity]: viscosity and yield_stress are both 0; give one, or take the table out")


def _check_zones(scene, where):
    """Zones give parameters of the law that [friction] names: numbers in their range, columns or rasters."""
    if not scene.zones:
        return
    if scene.friction is None:
        raise SceneError(
            f"{where} [[zones]]: friction by place needs [friction] with its law; write it before the zones"
        )
    law = scene.friction.law
    instead = friction.given_instead(law)
    wanted = scene.laws[law][1] | {name: told for name, (_, told) in instead.items()}
    for number, zone in enumerate(scene.zones, 1):
        here = f"{where} [[zones]] number {number}"
        if not zone.parameters:
            raise SceneError(f"{here}: no parameter of {law} in it; it takes {_listed(wanted)}")
        for name, value in zone.parameters.items():
            if name not in wanted:
                raise SceneError(
                    f"{here}: {law} has no parameter {name!r}{meant(name, wanted)}; it takes {_listed(wanted)}"
                )
            zone.parameters[name] = _value(_range_of(wanted[name], (float, str)), value, f"{here}: {name}")
            if name in instead:
                _refuse_both(name, instead[name][0], zone.parameters, here)
        if zone.source is None and all(not isinstance(value, str) for value in zone.parameters.values()):
            raise SceneError(
                f"{here}: numbers alone hold everywhere; give source (polygons), or put them in [friction]"
            )


def _check_places(scene, where):
    """What barriers and lakes need together."""
    for number, barrier in enumerate(scene.barrier, 1):
        if (barrier.height is None) == (barrier.crest is None):
            got = "none" if barrier.height is None else "both"
            raise SceneError(f"{where} [[barrier]] number {number}: wanted either height or crest, got {got}")
    lake = scene.still_water
    if lake is not None and isinstance(lake.level, str) and lake.source is None:
        raise SceneError(
            f"{where} [still_water]: level = {lake.level!r} is a column, but there is no source with columns; give "
            "source, or level a number of metres"
        )


def _refuse_unused(release, used, where):
    """Particles from a file bring all else with them: a key that would not be used is an error."""
    for f in fields(release):
        if f.name not in used and getattr(release, f.name) != f.default:
            raise SceneError(f"{where}: particles bring their own {f.name}; take {f.name} out")


def _table(kind, values, where, own_laws=NO_OWN_LAWS, by_place=(), instead=None):
    """One table from its dictionary; parameters of its law named in `by_place` may be missing.

    `instead` are the laws in place of the table's own, where the solver has others.
    """
    known = {f.name: f for f in fields(kind) if "kind" in f.metadata}
    free = any("by_place" in f.metadata for f in fields(kind))
    told = next((f.metadata for f in fields(kind) if "parameters_of" in f.metadata), {})
    laws = instead or told.get("parameters_of")
    made, extra = {}, {}
    for name, value in values.items():
        if name in known:
            made[name] = _value(known[name].metadata, value, f"{where}: {name}")
        elif laws is None and not free:
            raise SceneError(f"{where}: unknown key {name!r}{meant(name, known)}; it takes {_listed(known)}")
        else:
            extra[name] = value
    for name, f in known.items():
        if f.default is MISSING and name not in made:
            raise SceneError(f"{where}: {name} is missing ({f.metadata['doc']})")
    if laws is not None:
        elsewhere = made["law"] in told["parameters_of"] or ":" in made["law"]
        if instead is not None and made["law"] not in laws and elsewhere:
            raise SceneError(f"{where}: the 3D solver has no {made['law']} on the bed; wanted {_listed(laws)}")
        made["law"] = _law_name(laws, made["law"], own_laws, where)
        if kind is FrictionTable:
            extra, made["written"] = _in_place_of(made["law"], extra, where)
        made["parameters"] = _parameters({**laws, **own_laws.laws}, made["law"], extra, where, by_place)
        if "contradiction" in told and len(made["parameters"]) == len({**laws, **own_laws.laws}[made["law"]][1]):
            _require_no_contradiction(told["contradiction"](made["law"], made["parameters"]), where)
    elif free:
        made["parameters"] = extra
    return kind(**made)


def _in_place_of(law, values, where):
    """(parameters of `law` with what is given in place of some, the latter as they were given)."""
    made, written = dict(values), {}
    for name, (parameter, told) in friction.given_instead(law).items():
        if name not in made:
            continue
        _refuse_both(name, parameter, made, where)
        written[name] = _value(_range_of(told, float), made.pop(name), f"{where}: {name}")
        made[parameter] = friction.turbulent_coefficient(written[name])
    return made, written


def _refuse_both(name, parameter, values, where):
    if parameter in values:
        raise SceneError(f"{where}: {name} = g / {parameter}, and both are given; take one of them out")


def _range_of(parameter, kind):
    """The checks of a value of a law's Parameter."""
    return {"kind": kind, "low": parameter.smallest, "high": parameter.largest, "choices": None, "above": False}


def _require_no_contradiction(words, where):
    if words:
        raise SceneError(f"{where}: {words}")


def _law_name(laws, law, own_laws, where):
    """The name of `law` as its table of laws has it; a law of the user's own only out of the file that was named."""
    if law in laws:
        return law
    file, _, name = law.rpartition(":")
    if not file.endswith(".py"):
        raise SceneError(f"{where}: law = {law!r}{meant(law, laws)}; wanted {_listed(laws)}, or 'my_law.py:MyLaw'")
    if not own_laws.laws:
        raise SceneError(f"{where}: law = {law!r} is in a file of yours; allow it to be run with --law {file}")
    own = f"{Path(file).name}:{name}"
    if own not in own_laws.laws:
        raise SceneError(f"{where}: law = {law!r}, but --law {own_laws.path} holds {_listed(own_laws.laws)}")
    return own


def _parameters(laws, law, values, where, by_place=()):
    """The parameters of `law`, all present but those known by place, none unknown, each in its range."""
    wanted = laws[law][1]
    takes = ", ".join(f"{name} [{unit}]" for name, (unit, *_) in wanted.items())
    for name in values:
        if name not in wanted:
            raise SceneError(f"{where}: {law} has no parameter {name!r}{meant(name, wanted)}; it takes {takes}")
    made = {}
    for name, (unit, doc, low, high, default) in wanted.items():
        if name not in values and name in by_place:
            continue
        if name not in values and default is None:
            raise SceneError(f"{where}: {law} needs {name} [{unit}] ({doc})")
        checks = {"kind": float, "low": low, "high": high, "choices": None, "above": False}
        made[name] = _value(checks, values.get(name, default), f"{where}: {name}")
    return made


def _value(checks, value, where):
    """`value` after its checks."""
    kinds = checks["kind"] if isinstance(checks["kind"], tuple) else (checks["kind"],)
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise SceneError(f"{where} is a number of over 300 digits, wanted one that can be computed with")
    if float in kinds and _is_number(value):
        value = float(value)
        if not math.isfinite(value):
            raise SceneError(f"{where} = {value}, wanted a finite number")
    elif not (isinstance(value, kinds) and isinstance(value, bool) == (bool in kinds)):
        raise SceneError(f"{where} = {value!r}, wanted {' or '.join(KIND_WORDS[k] for k in kinds)}")
    if checks["choices"] and value not in checks["choices"]:
        raise SceneError(f"{where} = {value!r}{meant(value, checks['choices'])}; wanted {_listed(checks['choices'])}")
    if _is_number(value):
        low, high = checks["low"], checks["high"]
        if low is not None and (value < low or (checks["above"] and value <= low)):
            raise SceneError(f"{where} = {value:g}, wanted {'above' if checks['above'] else 'at least'} {low:g}")
        if high is not None and value > high:
            raise SceneError(f"{where} = {value:g}, wanted at most {high:g}")
    return tuple(value) if isinstance(value, list) else value


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _listed(names):
    return ", ".join(map(str, names))


def meant(name, known):
    """What `name` was meant to be among the names `known`, as the end of a message; '' where nothing is near."""
    close = difflib.get_close_matches(str(name), list(map(str, known)), 1)
    return f"; did you mean {close[0]!r}?" if close else ""
