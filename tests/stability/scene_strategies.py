"""Random terrains, releases, materials and numerics, drawn by hypothesis: a printed scene shows all its numbers."""

from dataclasses import dataclass

import numpy as np
from column_scenes import joined
from hard_scenes import NO_DRAG, box_of_columns, columns_on, points_of_columns, stiff_for
from hypothesis import strategies as st

from mpmgis.laws.material import drucker_prager, fluid

KINDS = ("plane", "bowl", "cliff", "noise", "steps", "pit", "rough slope")


@dataclass(frozen=True)
class Ground:
    """A terrain of `length` x `width` [m]; `relief` [m] is the height of its cliff, steps, pit, bowl or noise."""

    kind: str
    degrees: float
    towards: float  # azimuth of the fall line [rad]
    relief: float
    where: float  # of the cliff or the pit, as a share of the length
    seed: int
    length: float
    width: float

    def __call__(self, x, y):
        """Elevation [m]."""
        slope = np.tan(np.radians(self.degrees))
        plane = -slope * (np.cos(self.towards) * x + np.sin(self.towards) * y)
        return plane + self._relief(np.asarray(x) / self.length, np.asarray(y) / self.width)

    def _relief(self, x, y):
        if self.kind == "plane":
            return 0.0 * x
        if self.kind == "bowl":
            return self.relief * ((2.0 * x - 1.0) ** 2 + (2.0 * y - 1.0) ** 2)
        if self.kind == "cliff":
            return np.where(x < self.where, self.relief, 0.0)
        if self.kind == "steps":
            return -self.relief * np.floor(8.0 * x)
        if self.kind == "pit":
            return np.where((np.abs(x - self.where) < 0.1) & (np.abs(y - 0.5) < 0.2), -self.relief, 0.0)
        knots = np.random.default_rng(self.seed).normal(size=(22, 42))
        across = knots[np.clip((20 * y).astype(int), 0, 21), np.clip((40 * x).astype(int), 0, 41)]
        return (0.2 if self.kind == "rough slope" else 1.0) * self.relief * across


@dataclass(frozen=True)
class Box:
    """A rectangle of a release, as shares of the terrain's length and width; `thickness` [m], `speed` [m s-1]."""

    west: float
    south: float
    long: float
    wide: float
    thickness: float
    per_side: int
    speed: float
    heading: float

    def columns(self, ground, dx):
        """Columns of the box, moved inwards where it leaves the terrain."""
        long, wide = max(self.long * ground.length, 0.05 * dx), max(self.wide * ground.width, 0.05 * dx)
        west = min(self.west * ground.length, ground.length - long)
        south = min(self.south * ground.width, ground.width - wide)
        velocity = self.speed * np.cos(self.heading), self.speed * np.sin(self.heading)
        return box_of_columns(self.thickness, west, west + long, south, south + wide, dx / self.per_side, velocity)


@dataclass(frozen=True)
class ColumnScene:
    """A scene of the depth-averaged solver on cells of 5 m."""

    ground: Ground
    boxes: tuple
    mu: float
    xi: float
    cfl: float
    edges: str

    def solver(self):
        """The solver at its start."""
        columns = joined(*(box.columns(self.ground, 5.0) for box in self.boxes))
        return columns_on(self.ground, columns, mu=self.mu, xi=self.xi, cfl=self.cfl, edges=self.edges)


@dataclass(frozen=True)
class PointScene:
    """A scene of the 3D solver on cells of 1 m; `stiffness` is over the stiffness for the drop of the scene."""

    ground: Ground
    box: Box
    mu: float
    cfl: float
    edges: str
    stiffness: float
    friction_angle: float | None  # [deg]; None: a fluid
    cohesion: float  # [Pa]
    viscosity: float  # [Pa s]
    precision: str = "float64"

    def solver(self):
        """The solver at its start."""
        x, y = np.meshgrid(np.linspace(0, 40, 41), np.linspace(0, 20, 21))
        drop = float(np.ptp(self.ground(x, y))) + self.box.thickness + self.box.speed**2 / 20.0
        stiff = self.stiffness * stiff_for(drop)
        material = (
            fluid(stiff, self.viscosity, 0.0)
            if self.friction_angle is None
            else drucker_prager(stiff, 0.6 * stiff, self.friction_angle, self.cohesion)
        )
        columns = self.box.columns(self.ground, 1.0)
        numerics = {"cfl": self.cfl, "edges": self.edges, "precision": self.precision}
        return points_of_columns(self.ground, columns, material, mu=self.mu, **numerics)


def grounds(length, width, reliefs):
    """Terrains of any kind, level to 68 degrees steep."""
    shares, angles = st.floats(0.2, 0.8), st.floats(0.0, 6.28)
    return st.builds(
        Ground,
        st.sampled_from(KINDS),
        st.sampled_from((0.0, 5.0, 20.0, 35.0, 50.0, 68.0)),
        angles,
        st.sampled_from(reliefs),
        shares,
        st.integers(0, 1000),
        st.just(length),
        st.just(width),
    )


def boxes(thicknesses, speeds, per_side):
    """Releases anywhere, from narrow strips to a third of the terrain, also at its edges."""
    shares, lengths = st.floats(0.0, 1.0), st.sampled_from((0.0, 0.02, 0.1, 0.3))
    return st.builds(
        Box,
        shares,
        shares,
        lengths,
        lengths,
        st.sampled_from(thicknesses),
        st.sampled_from(per_side),
        st.sampled_from(speeds),
        st.floats(0.0, 6.28),
    )


def column_scenes():
    """Scenes of columns: up to three releases of 0.1 mm to 20 m on 200 m x 100 m."""
    box = boxes((1e-4, 1e-2, 0.5, 3.0, 20.0), (0.0, 5.0, 30.0), (1, 2, 4))
    return st.builds(
        ColumnScene,
        grounds(200.0, 100.0, (0.5, 2.0, 10.0, 40.0)),
        st.lists(box, min_size=1, max_size=3).map(tuple),
        st.sampled_from((0.0, 0.1, 0.4, 2.0)),
        st.sampled_from((50.0, 1000.0, NO_DRAG)),
        st.sampled_from((0.1, 0.3, 0.6, 0.9)),
        st.sampled_from(("open", "wall")),
    )


def point_scenes():
    """Scenes of points: one release of 5 cm to 5 m on 40 m x 20 m, sand, soil or a fluid, too soft to very stiff."""
    box = boxes((0.05, 0.5, 2.0, 5.0), (0.0, 3.0, 20.0), (2,))
    return st.builds(
        PointScene,
        grounds(40.0, 20.0, (0.1, 0.5, 2.0)),
        box,
        st.sampled_from((0.0, 0.1, 0.4, 2.0)),
        st.sampled_from((0.2, 0.4, 0.9)),
        st.sampled_from(("open", "wall")),
        st.sampled_from((0.03, 0.3, 1.0, 10.0)),
        st.sampled_from((None, 0.0, 5.0, 30.0, 60.0)),
        st.sampled_from((0.0, 1e3, 1e5)),
        st.sampled_from((0.0, 1e-3, 100.0, 1e4)),
        st.sampled_from(("float64", "float32")),
    )
