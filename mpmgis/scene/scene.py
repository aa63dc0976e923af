"""A scene: all its tables, the files that they name, and its digest."""

import hashlib
import json
import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from ..laws import friction
from ..laws.own_law import NO_OWN_LAWS, OwnLaws
from ..system.source_names import file_of, joined
from . import material_table
from .tables import (
    LISTED,
    TABLES,
    WITHOUT_EFFECT,
    CohesionTable,
    CurvatureTable,
    EarthPressureTable,
    EntrainmentTable,
    FrictionTable,
    HydrographTable,
    MaterialTable,
    NumericsTable,
    OutputTable,
    ReleaseTable,
    SofteningTable,
    StageTable,
    StillWaterTable,
    TerrainTable,
    ViscosityTable,
    ZoneTable,
)


@dataclass(frozen=True)
class Scene:
    """A scene. Paths are as written, relative to `folder`."""

    terrain: TerrainTable
    output: OutputTable
    release: ReleaseTable | None = None
    hydrograph: HydrographTable | None = None
    secondary_release: tuple = ()  # of SecondaryReleaseTable
    numerics: NumericsTable = NumericsTable()  # noqa: RUF009  (a frozen dataclass)
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
    forest: tuple = ()  # of ForestTable
    barrier: tuple = ()  # of BarrierTable
    stage: tuple = ()  # of StageTable
    solver: str = "columns"
    folder: str = "."
    own_laws: OwnLaws = NO_OWN_LAWS

    @property
    def laws(self) -> dict[str, tuple]:
        """Name -> (law, parameters) of all laws of friction that this scene may name: those that its solvers have."""
        return friction_laws(self.solvers, self.own_laws)

    @property
    def solvers(self) -> set[str]:
        """The solvers that the scene uses."""
        return {stage.solver for stage in self.stage} or {self.solver}

    def alone(self) -> tuple["Scene", ...]:
        """Return a scene of one solver for each stage, as if that were all; without stages the scene itself."""
        return tuple(self._alone(stage) for stage in self.stage) or (self,)

    def _alone(self, stage):
        rules = {name: kind.rule for name, kind in TABLES.items() if kind.rule.solver not in (None, stage.solver)}
        others = {name: () if rule.listed else None for name, rule in rules.items()}
        numerics = replace(self.numerics, cell_size=stage.cell_size or self.numerics.cell_size)
        return replace(self, **others, numerics=numerics, solver=stage.solver, stage=())

    @property
    def columns_per_cell(self) -> int:
        """Columns per cell of the solver for the seeding of a release; for points, those next to each other."""
        return self.numerics.points_per_side**2 if self.solver == "points" else self.numerics.particles_per_cell

    def densities(self) -> list[tuple[str, float]]:
        """Return (table, density [kg m-3]) of every table with inflow and a density."""
        sources = [("[release]", self.release), ("[hydrograph]", self.hydrograph)]
        sources += [("[[secondary_release]]", table) for table in self.secondary_release]
        used = ((name, table) for name, table in sources if table is not None and getattr(table, "use", "") != "off")
        return [(name, table.density) for name, table in used if table.density is not None]

    def dry_friction(self) -> float:
        """Return the coefficient of the friction law at rest [1]; 0 where the scene has none."""
        return self.friction_value(friction.DRY) or 0.0

    def friction_value(self, role: str) -> float | None:
        """Return the value of the friction law's parameter with a role.

        Parameters
        ----------
        role : str
            One of `friction.ROLES`.

        Returns
        -------
        float or None
            None where there is none.
        """
        if self.friction is None or self.friction.use == "off":
            return None
        return friction.value_of_role(role, self.friction.parameters)

    def bed_friction_angle(self) -> float:
        """Return the friction angle at the bed for the earth pressure [degrees].

        It is that of the scene, else atan of the dry friction.
        """
        given = None if self.earth_pressure is None else self.earth_pressure.bed_friction_angle
        return math.degrees(math.atan(self.dry_friction())) if given is None else given

    def path(self, name: str) -> Path | str:
        """Return the path that a name in this scene means; a name of GDAL or QGIS stays one (`source_names`).

        Parameters
        ----------
        name : str
            As written, absolute or relative to `folder`.
        """
        return joined(self.folder, name)

    def tables(self) -> Iterator[tuple[str, Any]]:
        """Yield (name, table) of every table that is there, several of one name for those in LISTED."""
        for name in TABLES:
            table = getattr(self, name)
            yield from ((name, entry) for entry in (table if name in LISTED else [table]) if entry is not None)

    def files(self) -> list[str]:
        """Return the names of all files in the scene, as written."""
        return [value for _, table in self.tables() for value in self._named(table).values()]

    def with_files(self, renamed: Callable[[str], str]) -> "Scene":
        """Return the same scene with other names of its files.

        Parameters
        ----------
        renamed : callable
            `renamed(name)` returns the new name of a file.
        """
        made = {name: () if name in LISTED else None for name in TABLES}
        for name, table in self.tables():
            moved = self._renamed(table, renamed)
            made[name] = (*made[name], moved) if name in LISTED else moved
        return replace(self, **made)

    def _renamed(self, table: Any, renamed: Callable[[str], str]) -> Any:
        """Return `table` with the names of its files passed through `renamed(name)`."""
        moved = {key: renamed(name) for key, name in self._named(table).items()}
        if "reach" in moved:
            moved["until"] = {**table.until, "reach": moved.pop("reach")}
        own = {key: moved.pop(key) for key in getattr(table, "parameters", {}) if key in moved}
        return replace(table, **moved, **({"parameters": {**table.parameters, **own}} if own else {}))

    def _named(self, table: Any) -> dict[str, str]:
        """Return key -> name of the files in `table`."""
        values = {f.name: (getattr(table, f.name), f.metadata["kind"]) for f in fields(table) if f.metadata.get("file")}
        if isinstance(table, ZoneTable):
            values |= {key: (value, (float, str)) for key, value in table.parameters.items()}
        if isinstance(table, StageTable):
            values["reach"] = (table.reached_file, str)
        return {
            key: value
            for key, (value, kind) in values.items()
            if isinstance(value, str) and (kind is str or Path(value).suffix or file_of(self.path(value)).exists())
        }

    def as_tables(self) -> dict[str, Any]:
        """Return the scene as a plain dictionary for TOML and JSON, without absent tables and unset keys."""
        tables = {} if self.stage else {"solver": self.solver}
        for name, table in self.tables():
            if name in LISTED:
                tables.setdefault(name, []).append(_plain(table, self.solvers))
            else:
                tables[name] = _plain(table, self.solvers)
        return tables

    def digest(self, *inputs: str) -> str:
        """Compute the hex digest of the scene and of its further inputs.

        It does not depend on keys of [numerics] WITHOUT_EFFECT: a run that began on one device can continue on another.

        Parameters
        ----------
        *inputs : str
            Digests of the input files.
        """
        own, tables = [self.own_laws.sha256] if self.own_laws.laws else [], self.as_tables()
        tables["numerics"] = {key: value for key, value in tables["numerics"].items() if key not in WITHOUT_EFFECT}
        text = json.dumps([tables, list(inputs), *own], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def friction_laws(solvers: Collection[str], own_laws: OwnLaws) -> dict[str, tuple]:
    """Return the laws of friction that all of `solvers` have.

    Parameters
    ----------
    solvers : collection of str
    own_laws : OwnLaws
        User-defined laws, for columns.

    Returns
    -------
    dict of str to (law, dict of str to Parameter)
    """
    columns = {**friction.LAWS, **own_laws.laws}
    if "points" not in solvers:
        return columns
    return {name: law for name, law in material_table.CONTACTS.items() if "columns" not in solvers or name in columns}


def _plain(table: Any, solvers: Collection[str]) -> dict[str, Any]:
    """Return one table as a dictionary for TOML, without unset keys and keys of solvers not in use."""
    others = {f.name for f in fields(table) if f.metadata.get("solver") not in (None, *solvers)}
    own = ("parameters", "written", "chosen", *others)
    values = {k: v for k, v in asdict(table).items() if v is not None and k not in own}
    values.update(getattr(table, "parameters", {}))
    for name, value in getattr(table, "written", {}).items():
        del values[friction.replaced_by(name)]
        values[name] = value
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
