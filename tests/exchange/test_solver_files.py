"""What other 3D solvers start from, read by parsers that know only each solver's own form."""

import ast
import json
import struct
import types
from typing import get_args

import h5py
import numpy as np
import pyproj
import pytest
import rasterio
from affine import Affine

from mpmgis.commands.seed import SolverOptions
from mpmgis.conversion.solver_start import solver_start, start_box, with_material
from mpmgis.exchange.declarations import Declarations, axis_matrix, write_sidecar
from mpmgis.exchange.frame_list import list_frames
from mpmgis.exchange.solver_grid import solver_grid
from mpmgis.exchange.writers import cbgeo_start, start_files
from mpmgis.exchange.writers.start_files import write_terrain
from mpmgis.exchange.writers.writer_list import SOLVER_FILES
from mpmgis.frames.particles import Frame, Particles
from mpmgis.scene.material_file import read_material
from mpmgis.system.errors import InputError
from mpmgis.system.option import options_of
from mpmgis.terrain.elevation import Terrain
from mpmgis.terrain.grid import Grid

EAST, NORTH, DENSITY, CELL, COUNT = 612_345.0, 5_170_200.0, 1800.0, 2.0, 60
CRS = pyproj.CRS("EPSG:32632")


def slope(south_up=False):
    """A plane that falls by 0.4 to the east and 0.2 to the north, as (Terrain, function of E and N)."""
    transform = Affine(5, 0, EAST, 0, 5, NORTH) if south_up else Affine(5, 0, EAST, 0, -5, NORTH + 200)
    grid = Grid(CRS, transform, (40, 50))

    def height(x, y):
        return 1500 - 0.4 * (x - EAST) - 0.2 * (y - NORTH)

    return Terrain(grid, height(*grid.xy(*np.indices(grid.shape)))), height


def frame_on(height, origin=(EAST + 3, NORTH - 7, 900.0)):
    """Points of different volumes up to 3 m over the ground, each with its own velocity and stress."""
    random = np.random.default_rng(5)
    x, y = EAST + random.uniform(100, 130, COUNT), NORTH + random.uniform(80, 110, COUNT)
    up = random.uniform(0.1, 3, COUNT)
    volume = random.uniform(0.05, 0.4, COUNT)
    place = np.column_stack([x, y, height(x, y) + up]) - np.array(origin)
    particles = Particles(place, random.normal(size=(COUNT, 3)), DENSITY * volume, 1.1 * volume)
    state = {"vertical_stress": -DENSITY * 9.81 * (3 - up)}
    return Frame(particles, time=2.5, dimension=3, crs=CRS, origin=origin, state=state, header={"density": DENSITY})


MATERIAL = """
[material]
law = "DruckerPrager"
bulk_modulus = 2e7
shear_modulus = 1.2e7
friction_angle = 35
cohesion = 700
[friction]
law = "Coulomb"
mu = 0.4
[output]
end_time = 3
frame_interval = 1
"""
FLUID = '[material]\nlaw = "Fluid"\nbulk_modulus = 1e6\nviscosity = 3\n[friction]\nlaw = "Coulomb"\nmu = 0.1\n'
ELASTIC = '[material]\nlaw = "Elastic"\nbulk_modulus = 2e7\nshear_modulus = 1.2e7\n'
YOUNG, POISSON = 3e7, 0.25  # 9 K G / (3 K + G), (3 K - 2 G) / (6 K + 2 G)


@pytest.fixture
def made(tmp_path):
    """A function (solver, material) -> (its start, map coordinates of the points, the folder that it wrote)."""

    def make(name, material=MATERIAL):
        files = SOLVER_FILES[name]
        terrain, height = slope()
        frame = frame_on(height)
        box = start_box([frame], terrain, CELL if files.needs_grid else None)
        start = solver_start(frame, box, DENSITY, CRS)
        if files.laws:
            (tmp_path / "material.toml").write_text(material)
            given = read_material(tmp_path / "material.toml")
            start = with_material(start, given.table, given.bed_friction, given.end_time or 10.0)
        folder = tmp_path / name
        folder.mkdir()
        files.write(start, folder, 0)
        if files.finish:
            files.finish(folder, [start.time])
        write_terrain(folder, box, axis_matrix(files.axes), files.terrain_on_grid)
        terms = {"crs": CRS, "origin": box.origin, "axes": files.axes, "density": DENSITY}
        write_sidecar(folder / "georef.json", Declarations(**terms, **({"times": (2.5,)} if files.finish else {})))
        return start, frame.particles.position + np.array(frame.origin), folder

    return make


def blocks(path):
    """Kratos' blocks: list of (first line, lines without blocks in them)."""
    found, open_blocks = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["Begin"]:
            open_blocks.append((" ".join(words[1:]), []))
        elif words[:1] == ["End"]:
            assert open_blocks[-1][0].startswith(words[1])
            found.append(open_blocks.pop())
        elif words:
            open_blocks[-1][1].append(words)
    assert not open_blocks
    return found


def numbers(block):
    return np.array(block, dtype=float)


def test_the_command_line_has_all_solvers_and_no_other():
    assert set(get_args(options_of(SolverOptions)["solver"].type)) == set(SOLVER_FILES)
    assert all(files.name == name for name, files in SOLVER_FILES.items())


@pytest.mark.parametrize("name", SOLVER_FILES)
def test_each_reads_back_what_it_wrote(made, name):
    start, _, folder = made(name)
    files = SOLVER_FILES[name]
    place, volume = files.read_back(folder, 0)
    assert np.abs(place - start.position).max() <= files.tolerance * max(start.box.size)
    assert volume == pytest.approx(start.current_volume if files.now else start.volume, rel=1e-6)
    assert (start.position >= 0).all() and (start.position <= start.box.size).all()


def test_kratos_has_a_cube_around_each_point_in_a_grid_of_its_own_numbers(made):
    start, _, folder = made("kratos")
    body, grid = dict(blocks(folder / "start_Body.mdpa")), blocks(folder / "start_Grid.mdpa")
    nodes, cubes = numbers(body["Nodes"]), numbers(body["Elements MPMUpdatedLagrangian3D8N"]).astype(int)
    place = dict(zip(nodes[:, 0].astype(int), nodes[:, 1:], strict=True))
    corners = np.array([[place[node] for node in cube[2:]] for cube in cubes])
    assert corners.mean(axis=1) == pytest.approx(start.position, abs=1e-12)
    assert signed_volume(corners) == pytest.approx(start.volume, rel=1e-10)
    of_grid = dict(grid)
    assert not set(place) & {int(row[0]) for row in of_grid["Nodes"]}
    assert not set(cubes[:, 0]) & {int(row[0]) for row in of_grid["Elements Element3D8N"]}
    parts = [name for name, _ in grid if name.startswith("SubModelPart ")]
    assert parts == [f"SubModelPart {name}" for name in ("Parts_Grid", "bed", "side_x", "side_y")]
    settings = json.loads((folder / "ProjectParameters.json").read_text())
    assert settings["solver_settings"]["processes_sub_model_part_list"] == ["bed", "side_x", "side_y"]
    assert settings["problem_data"]["end_time"] == 3
    (material,) = json.loads((folder / "ParticleMaterials.json").read_text())["properties"]
    values = material["Material"]["Variables"]
    assert values["MATERIAL_POINTS_PER_ELEMENT"] == 1 and values["DENSITY"] == DENSITY
    assert (values["YOUNG_MODULUS"], values["POISSON_RATIO"]) == pytest.approx((YOUNG, POISSON))
    assert values["INTERNAL_FRICTION_ANGLE"] == pytest.approx(np.radians(35))
    assert np.loadtxt(folder / "velocities.txt") == pytest.approx(start.velocity, abs=0)


def signed_volume(corners):
    """Of boxes by their first corner and the three next to it; negative where left-handed."""
    a = corners[:, 0]
    return np.linalg.det(np.stack([corners[:, k] - a for k in (1, 3, 4)], axis=1))


def test_the_grid_follows_the_ground_and_holds_every_point(made):
    start, _, _ = made("kratos")
    grid, (_, height) = solver_grid(start), slope()
    low, high = grid.nodes[grid.cells[:, 0]], grid.nodes[grid.cells[:, 6]]
    assert signed_volume(grid.nodes[grid.cells]) == pytest.approx(np.full(len(grid.cells), CELL**3))
    mine = grid.cell_of
    assert (low[mine] <= start.position).all() and (start.position <= high[mine]).all()
    east, north, up = start.box.origin
    bed = height(grid.nodes[:, 0] + east, grid.nodes[:, 1] + north) - up
    assert set(grid.bed) == set(np.flatnonzero(grid.nodes[:, 2] <= bed + 1e-9))
    assert len(grid.cells) < 0.6 * np.prod(start.cells)
    over = high[:, 2] - (height(low[:, 0] + east, low[:, 1] + north) - up)
    assert over.max() < start.headroom + 4 * CELL and over.min() > -3 * CELL


def test_cbgeo_starts_from_text_and_from_its_full_state(made):
    start, place, folder = made("cbgeo")
    first, *lines = (folder / "mesh.txt").read_text().splitlines()
    nodes, cells = map(int, first.split())
    assert len(lines) == nodes + cells
    coordinates = numbers([line.split() for line in lines[:nodes]])
    corner = numbers([line.split() for line in lines[nodes:]]).astype(int)
    assert signed_volume(coordinates[corner]) == pytest.approx(np.full(cells, CELL**3))
    text = (folder / "particles.txt").read_text().splitlines()
    assert int(text[0]) == COUNT == len(text) - 1
    volumes = np.loadtxt(folder / "particles-volumes.txt")
    assert (volumes[:, 0] == np.arange(COUNT)).all()
    assert volumes[:, 1].sum() * DENSITY == pytest.approx(start.mass.sum(), rel=1e-12)
    settings = json.loads((folder / "mpm.json").read_text())
    assert settings["analysis"]["resume"] == {"resume": True, "uuid": "start", "step": 0}
    digits = int(np.floor(np.log10(settings["analysis"]["nsteps"]))) + 1
    path = folder / "results/start" / f"particles{'0' * digits}.h5"
    table = h5py.File(path)["table"][:]
    assert table.dtype.itemsize == 416 and len(table.dtype.names) == 53
    assert {name: table.dtype.fields[name][1] for name in ("id", "epsilon_v", "cell_id", "status", "svars_0")} == {
        "id": 0,
        "epsilon_v": 224,
        "cell_id": 232,
        "status": 240,
        "svars_0": 256,
    }
    assert (table["status"] == 1).all() and table["mass"] == pytest.approx(start.mass, rel=1e-15)
    inside = coordinates[corner[table["cell_id"]]]
    assert (inside[:, 0] <= start.position).all() and (inside[:, 6] >= start.position).all()
    assert table["stress_zz"] == pytest.approx(start.vertical_stress)
    assert table["stress_xx"] == pytest.approx(start.vertical_stress * POISSON / (1 - POISSON))
    assert table["svars_0"] == pytest.approx(np.radians(35)) and table["svars_2"] == pytest.approx(700)
    (entry,) = list_frames([path], Declarations(sidecar=folder / "georef.json"))
    back = entry.read().particles
    assert entry.reader == "cbgeo" and entry.time == 0
    assert back.position + np.array(entry.header.origin) == pytest.approx(place, abs=1e-8)
    assert back.velocity == pytest.approx(start.velocity) and back.mass.sum() == pytest.approx(start.mass.sum())


def test_a_cbgeo_step_counts_its_digits():
    assert [cbgeo_start.state_name(steps) for steps in (9, 10, 4001)] == [
        "particles0.h5",
        "particles00.h5",
        "particles0000.h5",
    ]


class Recorder:
    """GeoTaichi's MPM, of which only the given values are checked."""

    received: dict

    def __init__(self):
        Recorder.received = {}

    def __getattr__(self, name):
        return lambda *given, **named: Recorder.received.__setitem__(name, (given, named))


@pytest.mark.parametrize(
    ("material", "model"), [(MATERIAL, "DruckerPrager"), (FLUID, "Newtonian"), (ELASTIC, "LinearElastic")]
)
def test_geotaichis_script_brings_in_its_text(made, monkeypatch, material, model):
    start, _, folder = made("geotaichi", material)
    found = np.loadtxt(folder / "particles.txt")
    assert found.shape == (COUNT, 7) and found[:, :3] == pytest.approx(start.position, abs=0)
    assert (2 * found[:, 4:]).prod(axis=1) == pytest.approx(found[:, 3])
    source = (folder / "start.py").read_text()
    ast.parse(source)
    module = types.ModuleType("geotaichi")
    module.MPM, module.init = Recorder, lambda: None
    module.ti = types.SimpleNamespace(Vector=list)
    monkeypatch.setitem(__import__("sys").modules, "geotaichi", module)
    exec(compile(source, "start.py", "exec"), {})
    received = Recorder.received
    assert received["add_material"][1]["model"] == model
    assert received["add_material"][1]["material"]["Density"] == DENSITY
    template = received["add_body_from_file"][1]["body"]["Template"]
    assert (folder / template["ParticleFile"]).exists()
    momentum = start.mass @ start.velocity
    assert np.array(template["InitialVelocity"]) * start.mass.sum() == pytest.approx(momentum)
    assert received["memory_allocate"][1]["memory"]["max_particle_number"] >= COUNT
    assert (np.array(received["set_configuration"][1]["domain"]) >= start.position.max(axis=0)).all()


def test_mpm_geomechanics_slides_on_the_stl_in_text(made):
    start, _, folder = made("mpm-geomechanics")
    case = json.loads((folder / "case.json").read_text())
    body, material = case["body"]["flow"], case["material"]["flow"]
    particles = json.loads((folder / body["file"]).read_text())
    assert [row["id"] for row in particles] == list(range(1, COUNT + 1))
    assert np.array([row["position"] for row in particles]) == pytest.approx(start.position, abs=0)
    assert sum(row["volume"] for row in particles) * material["density"] == pytest.approx(start.mass.sum())
    assert body["material_id"] == material["id"] == particles[0]["material_id"]
    assert (material["type"], material["friction"], material["young"]) == ("mohr-coulomb", 35, pytest.approx(YOUNG))
    assert material["tensile"] == pytest.approx(700 / np.tan(np.radians(35)))  # where the cone ends, below 10 c
    assert case["terrain_contact"]["friction"] == 0.4
    size = np.array(case["mesh"]["cells_number"]) * case["mesh"]["cells_dimension"]
    assert (start.position < size).all()
    text = (folder / case["terrain_contact"]["stl_mesh"]).read_text()
    assert text.startswith("solid")
    corners = numbers([line.split()[1:] for line in text.splitlines() if "vertex" in line]).reshape(-1, 3, 3)
    _on_the_plane(corners, start.box.origin)
    assert corners[..., :2].min() == 0 and len(corners) == 2 * np.prod(start.cells[:2])  # none beyond the grid


def _on_the_plane(corners, origin):
    """Triangles on the slope, seen from above counterclockwise."""
    _, height = slope()
    place = corners + np.array(origin)
    assert place[..., 2] == pytest.approx(height(place[..., 0], place[..., 1]), abs=1e-4)
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def read_stl(path):
    raw = path.read_bytes()
    (count,) = struct.unpack("<I", raw[80:84])
    assert len(raw) == 84 + 50 * count and not raw.startswith(b"solid")
    return np.array([struct.unpack("<12f", raw[84 + 50 * k :][:48]) for k in range(count)]).reshape(count, 4, 3)


@pytest.mark.parametrize("south_up", [False, True])
def test_the_ground_lies_beside(tmp_path, south_up):
    terrain, height = slope(south_up)
    box = start_box([frame_on(height)], terrain, CELL)
    names = write_terrain(tmp_path, box, np.eye(3))
    triangles = read_stl(tmp_path / "terrain.stl")
    _on_the_plane(triangles[:, 1:], box.origin)
    steepness = np.array([0.4, 0.2, 1]) / np.sqrt(1.2)
    assert triangles[:, 0] == pytest.approx(np.tile(steepness, (len(triangles), 1)), abs=1e-5)
    assert ("terrain.asc" in names) is not south_up
    if not south_up:
        with rasterio.open(tmp_path / "terrain.asc") as heights:
            x, y = heights.xy(3, 4)
            east, north, up = box.origin
            assert heights.read(1)[3, 4] == pytest.approx(height(x + east, y + north) - up, abs=1e-3)


def test_houdini_gets_y_up_and_our_reader_turns_it_back(made):
    start, place, folder = made("houdini")
    head, _, raw = (folder / "points_0000.ply").read_bytes().partition(b"end_header\n")
    assert b"format binary_little_endian 1.0" in head and f"element vertex {COUNT}".encode() in head
    properties = [line.split()[1:] for line in head.decode().splitlines() if line.startswith("property")]
    row = np.dtype([(name, {"float": "<f4", "int": "<i4"}[kind]) for kind, name in properties])
    vertices = np.frombuffer(raw, row)
    assert len(vertices) == COUNT
    assert vertices["y"] == pytest.approx(start.position[:, 2], rel=1e-6)
    assert vertices["vz"] == pytest.approx(-start.velocity[:, 1], rel=1e-6)
    triangles = read_stl(folder / "terrain.stl")
    assert (triangles[:, 0, 1] > 0.8).all()
    (entry,) = list_frames([folder / "points_0000.ply"])
    back = entry.read().particles
    assert entry.time == 2.5
    assert back.position + np.array(entry.header.origin) == pytest.approx(place, abs=1e-4)
    assert back.mass.sum() == pytest.approx(start.mass.sum(), rel=1e-6)


def test_paraview_gets_times_and_all_digits(made):
    start, place, folder = made("paraview")
    (entry,) = list_frames([folder / "points.pvd"])
    back = entry.read().particles
    assert entry.reader == "vtk" and entry.time == 2.5
    assert back.position + np.array(entry.header.origin) == pytest.approx(place, abs=1e-9)
    assert back.velocity == pytest.approx(start.velocity, abs=0)
    assert back.volume.sum() == pytest.approx(start.current_volume.sum(), rel=1e-12)


def test_what_lies_beyond_is_refused():
    terrain, height = slope()
    frame = frame_on(height)
    with pytest.raises(InputError, match=r"not all within the window .*; give a --window around them"):
        start_box([frame], terrain, CELL, (EAST + 100, NORTH + 80, EAST + 110, NORTH + 90))
    with pytest.raises(InputError, match="give a larger --dem"):
        start_box([frame], terrain.cropped((EAST, NORTH, EAST + 110, NORTH + 100), 0), CELL)
    hole = terrain.elevation.copy()
    hole[18:25, 20:27] = np.nan
    box = start_box([frame], Terrain(terrain.grid, hole), CELL)
    with pytest.raises(InputError, match=r"\d+ of 60 points have no ground under them"):
        solver_grid(solver_start(frame, box, DENSITY))
    fine = start_box([frame], terrain, 0.1)
    with pytest.raises(InputError, match=r"cells of 0.1 m, expected at most 5e\+06"):
        solver_grid(solver_start(frame, fine, DENSITY))


def test_rows_keep_every_digit(tmp_path):
    values = np.array([[1 / 3, -1e-17], [5e300, 0.1]])
    with open(tmp_path / "rows.txt", "wb") as sink:
        start_files.write_rows(sink, np.arange(2), values)
        start_files.write_rows(sink, np.arange(0))
    found = start_files.read_rows((tmp_path / "rows.txt").read_bytes(), 3)
    assert (found[:, 1:] == values).all() and (found[:, 0] == [0, 1]).all()
