"""Particles as each code writes them, by its format's own words and none of mpmgis' readers.

`cloud(k)` is what is written: the same block at frame k, which moves; each writer takes a folder and writes frames 0, 1
and 2, at times 0, 0.5 and 1 s, and answers what is to be given to `mpmgis`.
"""

import base64
import json
import struct
import zlib

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet

COUNT, MASS, DENSITY, VOLUME = 60, 3.0, 1500.0, 0.002
TIMES = (0.0, 0.5, 1.0)
SPEED = np.array([2.0, -1.0, -0.5])  # [m s-1], in the file's own axes


def cloud(k):
    """(float64[60, 3] [m], float64[60, 3] [m s-1]) of frame k: every particle on its own way; float32 holds it."""
    n = np.arange(COUNT)
    place = np.column_stack([20.0 + n % 10, 30.0 + n // 10 % 6, 100.0 + 0.25 * (n % 4)]) + SPEED * TIMES[k]
    velocity = np.tile(SPEED, (COUNT, 1))
    velocity[:, 0] += 0.125 * (n % 8)
    return place, velocity


# ------------------------------------------------------------------------------------------------------- CB-Geo MPM


def _cbgeo_type():
    """The record of 53 fields, of which cell_id lies before status."""
    names = ["id", "mass", "volume", "pressure"]
    names += [f"{group}_{axis}" for group in ("coord", "displacement", "nsize", "velocity") for axis in "xyz"]
    names += [f"stress_{axis}{axis}" for axis in "xyz"] + ["tau_xy", "tau_yz", "tau_xz"]
    names += [f"strain_{axis}{axis}" for axis in "xyz"] + ["gamma_xy", "gamma_yz", "gamma_xz", "epsilon_v"]
    kinds = ["<i8"] + ["<f8"] * (len(names) - 1)
    offsets = [8 * k for k in range(len(names))]
    offsets += [240, 232, 244, 248] + [256 + 8 * k for k in range(20)]
    names += ["status", "cell_id", "material_id", "nstate_vars"] + [f"svars_{k}" for k in range(20)]
    kinds += ["u1", "<i8", "<u4", "<u4"] + ["<f8"] * 20
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": 416})


def cbgeo_table(path, k, rows=slice(None)):
    """One file of frame k; volumes are those of now, twice as large as at first."""
    place, velocity = cloud(k)
    table = np.zeros(COUNT, _cbgeo_type())
    table["id"], table["mass"], table["volume"], table["status"] = np.arange(COUNT) + 7, MASS, 2 * VOLUME, 1
    for axis, letter in enumerate("xyz"):
        table[f"coord_{letter}"], table[f"velocity_{letter}"] = place[:, axis], velocity[:, axis]
    with h5py.File(path, "w") as file:
        file.create_dataset("table", data=table[rows], chunks=(10000,), maxshape=(None,))


def cbgeo_settings(folder):
    """mpm.json: a step is 0.001 s, and two materials of one density."""
    materials = [{"id": k, "type": "MohrCoulomb3D", "density": DENSITY} for k in range(2)]
    settings = {"materials": materials, "analysis": {"dt": 1e-3, "uuid": "slide", "nsteps": 1001}}
    (folder / "mpm.json").write_text(json.dumps(settings))


def write_cbgeo(folder):
    """`results/slide/particles<step>.h5` three folders below mpm.json."""
    cbgeo_settings(folder)
    inner = folder / "results" / "slide"
    inner.mkdir(parents=True)
    for k in range(3):
        cbgeo_table(inner / f"particles{500 * k:04d}.h5", k)
    return [inner]


def write_cbgeo_pieces(folder):
    """Two ranks, and rank 1 has nothing at first."""
    cbgeo_settings(folder)
    for k in range(3):
        cut = COUNT if k == 0 else 25
        cbgeo_table(folder / f"particles-0_2-{500 * k:04d}.h5", k, slice(0, cut))
        cbgeo_table(folder / f"particles-1_2-{500 * k:04d}.h5", k, slice(cut, COUNT))
    return [folder]


# ----------------------------------------------------------------------------------------------------------- Kratos


def kratos_settings(folder, kind="step"):
    """ProjectParameters.json and the materials that it names."""
    project = {
        "solver_settings": {
            "time_stepping": {"time_step": 0.05},
            "material_import_settings": {"materials_filename": "Materials.json"},
        },
        "output_processes": {
            "vtk": [{"python_module": "mpm_vtk_output_process", "Parameters": {"output_control_type": kind}}]
        },
    }
    materials = {"properties": [{"properties_id": 1, "Material": {"Variables": {"DENSITY": DENSITY}}}]}
    (folder / "ProjectParameters.json").write_text(json.dumps(project))
    (folder / "Materials.json").write_text(json.dumps(materials))


def kratos_vtk(path, k, binary=True, rows=slice(None)):
    """One rank's file of frame k."""
    place, velocity = (values[rows] for values in cloud(k))
    n = len(place)
    parts = [b"# vtk DataFile Version 4.0\nvtk output\n" + (b"BINARY" if binary else b"ASCII") + b"\n"]

    def add(head, values, kind):
        values = np.ascontiguousarray(values)
        if binary:
            parts.append(f"{head}\n".encode() + values.astype(kind).tobytes() + b"\n")
        else:
            shape = values.reshape(len(values), -1) if len(values) else values
            parts.append(
                f"{head}\n".encode() + "".join(" ".join(map(str, row)) + "\n" for row in shape.tolist()).encode()
            )

    parts.append(b"DATASET UNSTRUCTURED_GRID\n")
    add(f"POINTS {n} float", place.astype("f4"), ">f4")
    add(f"CELLS {n} {2 * n}", np.column_stack([np.ones(n, int), np.arange(n)]), ">i4")
    add(f"CELL_TYPES {n}", np.ones(n, int), ">i4")
    parts.append(f"CELL_DATA {n}\nFIELD FieldData 4\n".encode())
    add(f"KRATOS_ELEMENT_ID 1 {n}  int", np.arange(COUNT)[rows] + 7, ">i4")
    add(f"MP_VELOCITY 3 {n}  float", velocity.astype("f4"), ">f4")
    add(f"MP_MASS 1 {n}  float", np.full(n, MASS), ">f4")
    add(f"MP_VOLUME 1 {n}  float", np.full(n, 2 * VOLUME), ">f4")
    path.write_bytes(b"".join(parts))


def write_kratos_times(folder):
    """Labels that are times, binary."""
    kratos_settings(folder)
    for k, time in enumerate(TIMES):
        kratos_vtk(folder / f"MPM_Material_0_{time:.7f}.vtk", k)
    return [folder]


def write_kratos_steps(folder):
    """Labels that are steps, text, of two ranks, in a folder below the settings; the grid lies beside them."""
    kratos_settings(folder)
    inner = folder / "vtk_output"
    inner.mkdir()
    for k in range(3):
        kratos_vtk(inner / f"MPM_Material_0_{10 * k}.vtk", k, False, slice(0, 20))
        kratos_vtk(inner / f"MPM_Material_1_{10 * k}.vtk", k, False, slice(20, COUNT))
    grid = "# vtk DataFile Version 4.0\nvtk output\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1 float\n0 0 0\n"
    (inner / "Background_Grid_0_0.vtk").write_text(grid + "CELLS 1 2\n1 0\nCELL_TYPES 1\n1\n")
    return [inner]


def write_kratos_gid(folder):
    """Mesh and results; rows of the results in another order than those of the mesh."""
    kratos_settings(folder)
    first, ids = cloud(0)[0], np.arange(COUNT) + 7
    with open(folder / "slide.post.msh", "w") as mesh:
        mesh.write('MESH "outmesh" dimension 3 ElemType Point Nnode 1\nCoordinates\n')
        mesh.writelines(f"{i} {x} {y} {z}\n" for i, (x, y, z) in zip(ids, first.tolist(), strict=True))
        mesh.write("End Coordinates\nElements\n")
        mesh.writelines(f"{i} {i}\n" for i in ids)
        mesh.write("End Elements\n")
    with open(folder / "slide.post.res", "w") as results:
        results.write("GiD Post Results File 1.0\n")
        for k, time in enumerate(TIMES):
            place, velocity = cloud(k)
            for name, values in (("MP_DISPLACEMENT", place - first), ("MP_VELOCITY", velocity)):
                results.write(f'Result "{name}" "Kratos" {time} Vector OnNodes\nValues\n')
                results.writelines(f"{ids[i]} {' '.join(map(str, values[i].tolist()))}\n" for i in range(COUNT)[::-1])
                results.write("End Values\n")
            results.write(f'Result "MP_MASS" "Kratos" {time} Scalar OnNodes\nValues\n')
            results.writelines(f"{i} {MASS}\n" for i in ids)
            results.write("End Values\n")
    return [folder / "slide.post.res"]


# -------------------------------------------------------------------------------------------------------- GeoTaichi


def write_geotaichi(folder):
    """Archives of 66 particles, of which six are no more active; one member is pickled."""
    for k, time in enumerate(TIMES):
        place, velocity = cloud(k)
        more = np.full((6, 3), np.nan)
        np.savez(
            folder / f"MPMParticle{k:06d}.npz",
            t_current=time,
            body_num=np.array([1], "i4"),
            active=np.r_[np.ones(COUNT, "u1"), np.zeros(6, "u1")],
            particleID=np.arange(COUNT + 6, dtype="i4") + 7,
            mass=np.full(COUNT + 6, MASS),
            volume=np.full(COUNT + 6, 2 * VOLUME),
            position=np.vstack([place, more]),
            velocity=np.vstack([velocity, more]),
            stress=np.zeros((COUNT + 6, 6)),
            velocity_gradient=np.zeros((COUNT + 6, 3, 3)),
            state_vars=np.array({"epdstrain": 1}, object),
        )
    return [folder]


# ---------------------------------------------------------------------------------------------------------- Anura3D


def anura_vtk(path, place, arrays, binary):
    """A file of scalars or vectors, as the Fortran writes it: no line end behind binary numbers, ids as int."""
    n = len(place)
    word = "DOUBLE" if binary else "float"

    def block(values):
        if binary:
            return np.ascontiguousarray(values, ">i4" if values.dtype.kind == "i" else ">f8").tobytes()
        rows = np.atleast_2d(values.T).T
        if values.dtype.kind == "i":
            return "".join(f" {value:11d}\n" for value in values.tolist()).encode()
        return "".join("".join(f"  {value:.15E}     " for value in row) + "\n" for row in rows).encode()

    parts = [
        f"# vtk DataFile Version 3.0\nslide\n{'BINARY' if binary else 'ASCII'}\nDATASET UNSTRUCTURED_GRID\n".encode()
    ]
    parts += [f"POINTS {n:8d} {word}\n".encode(), block(place), f"CELLS {n:8d}{2 * n:8d}\n".encode()]
    if binary:
        parts.append(np.column_stack([np.ones(n), np.arange(n)]).astype(">i4").tobytes())
        parts.append(f"CELL_TYPES {n:8d}\n".encode() + np.ones(n, ">i4").tobytes())
    else:
        parts.append("".join(f"1{k:8d}\n" for k in range(n)).encode() + f"CELL_TYPES {n:8d}\n".encode() + b" 1\n" * n)
    parts.append(f"POINT_DATA {n:8d}\n".encode())
    for name, values in arrays.items():
        of = "int" if values.dtype.kind == "i" else word
        kind = f"VECTORS {name} {of}\n" if values.ndim == 2 else f"SCALARS {name} {of} 1\nLOOKUP_TABLE default\n"
        parts.append(kind.encode() + block(values))
    path.write_bytes(b"".join(parts))


def write_anura3d(folder, binary=False):
    """Pairs of files at the ends of load steps 1 and 2, and before the first; masses in tonnes.

    The last two points are a virtual one and one that was taken out.
    """
    for k, label in enumerate(("000", "001", "002")):
        place, velocity = cloud(k)
        place, velocity = np.vstack([place, np.zeros((2, 3))]), np.vstack([velocity, np.zeros((2, 3))])
        kind = np.r_[np.ones(COUNT, int), 2, -1]
        scalars = {"virtual_material_point": kind, "mass_solid": np.full(COUNT + 2, MASS / 1000) * (kind == 1)}
        scalars |= {"integration_weight": np.full(COUNT + 2, 2 * VOLUME), "material_point_id": np.arange(COUNT + 2) + 7}
        vectors = {"velocity_solid": velocity, "displacement_solid": 0 * velocity}
        for kind, arrays in (("Scalar", scalars), ("Vector", vectors)):
            anura_vtk(folder / f"slide_MP{kind}_{label}.vtk", place, arrays, binary)
        anura_vtk(folder / f"slide_MPTensor_{label}.vtk", place, {"strain": np.zeros((COUNT + 2, 3))}, binary)
        if k:
            times = f"$$TIME_PER_LOADSTEP\n  0.500000000000000     \n$$TOTAL_TIME\n   {TIMES[k - 1]:.13f}     \n"
            (folder / f"slide.CPS_{label}").write_text(
                f"### Anura3D_2021 ###\n$$NUMBER_OF_LOADSTEPS\n  2\n{times}$$END\n"
            )
    return [folder]


def write_anura3d_binary(folder):
    """The same in the binary form."""
    return write_anura3d(folder, True)


# ------------------------------------------------------------------------------------------------- MPM-Geomechanics


def write_mpm_geomechanics(folder):
    """Text of five digits, times in a .pvd; no mass, no volume; two particles are no more active."""
    entries = []
    for k, time in enumerate(TIMES):
        place, velocity = (np.vstack([values, values[:2]]) for values in cloud(k))
        arrays = {"Particle Id": np.arange(COUNT + 2) + 7, "Particle Active": np.r_[np.ones(COUNT, int), 0, 0]}
        text = '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">\n'
        text += f'<UnstructuredGrid>\n<Piece NumberOfPoints="{COUNT + 2}" NumberOfCells="{COUNT + 2}">\n<Points>\n'
        text += '<DataArray type="Float64" NumberOfComponents="3" Format="ascii">\n' + _lines(place, ".4e")
        text += "</DataArray>\n</Points>\n<PointData>\n"
        for name, values in arrays.items():
            text += f'<DataArray type="UInt64" Name="{name}" Format="ascii">\n' + _lines(values[:, None], "d")
            text += "</DataArray>\n"
        text += '<DataArray type="Float64" Name="Velocity" NumberOfComponents="3" Format="ascii">\n'
        text += _lines(velocity, ".4e") + "</DataArray>\n</PointData>\n<Cells>\n"
        text += '<DataArray type="UInt8" Name="types" Format="ascii">\n' + "1\n" * (COUNT + 2) + "</DataArray>\n"
        (folder / f"particles_{k + 1}.vtu").write_text(text + "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")
        entries.append(f'<DataSet timestep="{time:g}" group="" part="0" file="particles_{k + 1}.vtu"/>')
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n<Collection>\n'
    (folder / "particleTimeSerie.pvd").write_text(head + "\n".join(entries) + "\n</Collection>\n</VTKFile>\n")
    return [folder]


def _lines(rows, form):
    return "".join(" ".join(format(value, form) for value in row) + "\n" for row in rows.tolist())


# ---------------------------------------------------------------------------------------- LAMMPS, LIGGGHTS, Karamelo


def dump_step(step, k, columns="id type mass x y z vx vy vz", end=" \n", rows=slice(None)):
    """One time step of a dump."""
    place, velocity = (values[rows] for values in cloud(k))
    text = f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{len(place)}\nITEM: BOX BOUNDS ff ff ff\n"
    text += "0 100\n0 100\n0 200\n" + f"ITEM: ATOMS {columns}\n"
    for i, (p, v) in zip(np.arange(COUNT)[rows], zip(place, velocity, strict=True), strict=True):
        said = {"id": i + 7, "type": 1, "tag": i + 7, "mass": MASS, "radius": (0.75 * VOLUME / np.pi) ** (1 / 3)}
        said |= dict(zip("xyz", p.tolist(), strict=True)) | dict(zip(("vx", "vy", "vz"), v.tolist(), strict=True))
        text += " ".join(f"{said[name]:.12g}" for name in columns.split()) + end
    return text


def write_lammps(folder):
    """All times in one file, steps of 0.01 s."""
    (folder / "slide.lammpstrj").write_text("".join(dump_step(50 * k, k) for k in range(3)))
    return [folder / "slide.lammpstrj"]


def write_liggghts(folder):
    """A file a time, with radius and without mass, no blank at the ends of lines."""
    for k in range(3):
        text = dump_step(50 * k, k, "id type x y z vx vy vz radius", "\n")
        (folder / f"dump{50 * k}.liggghts").write_text(text)
    return [folder]


def write_karamelo(folder):
    """Step 0 in every file, the true one in the name; two ranks."""
    columns = "id type tag x y z vx vy vz mass"
    for k in range(3):
        for rank, rows in enumerate((slice(0, 30), slice(30, COUNT))):
            (folder / f"dump_p.proc-{rank}.{50 * k}.LAMMPS").write_text(dump_step(0, k, columns, rows=rows))
    return [folder]


# ------------------------------------------------------------------------------------------------------- VTK's XML


def vtk_arrays(k):
    """Dict of name and (VTK's type, values) of frame k."""
    place, velocity = cloud(k)
    ids = np.arange(COUNT) + 7
    return {
        "Points": ("Float32", place.astype("<f4")),
        "velocity": ("Float64", velocity.astype("<f8")),
        "mass": ("Float64", np.full(COUNT, MASS)),
        "id": ("Int64", ids.astype("<i8")),
    }


def vtk_xml(path, k, form, header="UInt32", packed=False, time=False):
    """A .vtp or .vtu in one of VTK's forms: ascii, binary, raw or base64 (both appended)."""
    kind = "PolyData" if path.suffix == ".vtp" else "UnstructuredGrid"
    length = "<I" if header == "UInt32" else "<Q"
    blocks = []
    words = '\n<InformationKey name="L2_NORM_RANGE" length="2">\n<Value index="0">\n0.08\n</Value>\n</InformationKey>\n'

    def packed_blocks(raw):
        size = 256
        parts = [raw[at : at + size] for at in range(0, len(raw), size)]
        packs = [zlib.compress(part) for part in parts]
        sizes = [len(parts), size, len(parts[-1]) % size, *map(len, packs)]
        return b"".join(struct.pack(length, value) for value in sizes), b"".join(packs)

    def coded(raw, text):
        if packed:
            head, body = packed_blocks(raw)
            return base64.b64encode(head) + base64.b64encode(body) if text else head + body
        whole = struct.pack(length, len(raw)) + raw
        return base64.b64encode(whole) if text else whole

    def array(name, kind, values):
        parts = "" if values.ndim == 1 else f' NumberOfComponents="{values.shape[1]}"'
        head = f'<DataArray type="{kind}" Name="{name}"{parts} '
        if form == "ascii":
            return head + 'format="ascii">' + " ".join(map(repr, values.ravel().tolist())) + words + "</DataArray>\n"
        if form == "binary":
            return head + 'format="binary">\n  ' + coded(values.tobytes(), True).decode() + words + "</DataArray>\n"
        offset = sum(map(len, blocks))
        blocks.append(coded(values.tobytes(), form == "base64"))
        return head + f'format="appended" offset="{offset}"/>\n'

    arrays = vtk_arrays(k)
    compressor = ' compressor="vtkZLibDataCompressor"' if packed else ""
    text = (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="{header}"'
    )
    text += f"{compressor}>\n<{kind}>\n"
    if time:
        text += '<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">'
        text += f"{TIMES[k]}</DataArray></FieldData>\n"
    cells = f'NumberOfVerts="{COUNT}"' if kind == "PolyData" else 'NumberOfCells="0"'
    text += (
        f'<Piece NumberOfPoints="{COUNT}" {cells}>\n<Points>\n' + array("Points", *arrays.pop("Points")) + "</Points>\n"
    )
    text += '<PointData Scalars="mass">\n' + "".join(array(name, *said) for name, said in arrays.items())
    body = text.encode() + f"</PointData>\n</Piece>\n</{kind}>\n".encode()
    if blocks:
        encoding = b"raw" if form == "raw" else b"base64"
        body += b'<AppendedData encoding="' + encoding + b'">\n_' + b"".join(blocks) + b"\n</AppendedData>\n"
    path.write_bytes(body + b"</VTKFile>\n")


def write_legacy(folder):
    """Binary legacy VTK of version 5.1: cells in two arrays, METADATA between the others, time in a field."""
    for k, time in enumerate(TIMES):
        place, velocity = cloud(k)
        head = "# vtk DataFile Version 5.1\n\nBINARY\nDATASET POLYDATA\nFIELD FieldData 1\nTimeValue 1 1 double\n"
        parts = [head.encode(), struct.pack(">d", time), b"\nMETADATA\nINFORMATION 0\n\n"]
        parts += [f"POINTS {COUNT} double\n".encode(), place.astype(">f8").tobytes(), b"\nMETADATA\nINFORMATION 0\n\n"]
        parts += [f"VERTICES {COUNT + 1} {COUNT}\nOFFSETS vtktypeint64\n".encode()]
        parts += [np.arange(COUNT + 1).astype(">i8").tobytes(), b"\nCONNECTIVITY vtktypeint64\n"]
        parts += [np.arange(COUNT).astype(">i8").tobytes(), f"\nPOINT_DATA {COUNT}\nVECTORS velocity float\n".encode()]
        parts += [velocity.astype(">f4").tobytes(), b"\nSCALARS mass double\nLOOKUP_TABLE default\n"]
        parts += [np.full(COUNT, MASS, ">f8").tobytes(), f"\nFIELD FieldData 1\nid 1 {COUNT} vtktypeint64\n".encode()]
        parts += [(np.arange(COUNT) + 7).astype(">i8").tobytes(), b"\nMETADATA\nINFORMATION 0\n\n"]
        (folder / f"slide_{k}.vtk").write_bytes(b"".join(parts))
    return [folder]


def vtk_writer(suffix, form, **options):
    """A writer of three files with their times in the field TimeValue."""

    def write(folder):
        for k in range(3):
            vtk_xml(folder / f"slide_{k}{suffix}", k, form, time=True, **options)
        return [folder]

    return write


def write_pieces(folder):
    """A .pvd that lists a .pvtu each time, which lists one piece."""
    entries = []
    for k, time in enumerate(TIMES):
        vtk_xml(folder / f"slide_{k}_0.vtu", k, "ascii")
        (folder / f"slide_{k}.pvtu").write_text(
            '<?xml version="1.0"?><VTKFile type="PUnstructuredGrid"><PUnstructuredGrid GhostLevel="0">'
            f'<Piece Source="slide_{k}_0.vtu"/></PUnstructuredGrid></VTKFile>'
        )
        entries.append(f'<DataSet timestep="{time}" file="slide_{k}.pvtu"/>')
    text = f'<VTKFile type="Collection"><Collection>{"".join(entries)}</Collection></VTKFile>'
    (folder / "slide.pvd").write_text('<?xml version="1.0"?>' + text)
    return [folder / "slide.pvd"]


# -------------------------------------------------------------------------------------------------- plain formats


def table(k):
    """Dict of name and values of frame k."""
    place, velocity = cloud(k)
    columns = {"id": np.arange(COUNT) + 7, "time": np.full(COUNT, TIMES[k]), "mass": np.full(COUNT, MASS)}
    columns |= dict(zip("xyz", place.T, strict=True))
    return columns | dict(zip(("vx", "vy", "vz"), velocity.T, strict=True))


def whole_table(order=lambda times: np.arange(len(times))):
    """All three times one below the other, in an order."""
    parts = [table(k) for k in range(3)]
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    rows = order(whole["time"])
    return {name: values[rows] for name, values in whole.items()}


def by_particle(times):
    """Rows of a table in which the three times of a particle follow each other."""
    return np.arange(len(times)).reshape(3, -1).T.ravel()


def csv_writer(delimiter=",", comment="", order=lambda times: np.arange(len(times)), decimal=".", name="slide.csv"):
    """A writer of one table of all times."""

    def write(folder):
        columns = whole_table(order)
        rows = np.column_stack([values.astype(float) for values in columns.values()])
        lines = [delimiter.join(repr(value).replace(".", decimal) for value in row) for row in rows.tolist()]
        (folder / name).write_text("\n".join([comment + delimiter.join(columns), *lines]) + "\n")
        return [folder / name]

    return write


def write_parquet(folder):
    """All times in one table of several row groups."""
    pyarrow.parquet.write_table(pyarrow.table(whole_table()), folder / "slide.parquet", row_group_size=40)
    return [folder / "slide.parquet"]


def write_npz(folder):
    """Arrays that are called as they usually are."""
    for k, time in enumerate(TIMES):
        place, velocity = cloud(k)
        arrays = {"x": place, "v": np.asfortranarray(velocity), "mass": np.full(COUNT, MASS), "time": time}
        np.savez_compressed(folder / f"step{k}.npz", id=np.arange(COUNT) + 7, **arrays)
    return [folder]


def write_hdf5(folder):
    """A file a time: a group of particles, places and velocities as vectors, the time at the root."""
    for k, time in enumerate(TIMES):
        place, velocity = cloud(k)
        with h5py.File(folder / f"step{k}.h5", "w") as file:
            file.attrs["time"] = time
            group = file.create_group("particles")
            group["Coordinates"], group["velocity"] = place.astype(">f4"), velocity
            group["mass"], group["id"] = np.full(COUNT, MASS), np.arange(COUNT) + 7
    return [folder]


def write_hdf5_steps(folder):
    """A group a time, tables of records."""
    with h5py.File(folder / "slide.hdf5", "w") as file:
        for k, time in enumerate(TIMES):
            kinds = [("id", "u4"), ("pos", "f8", (3,)), ("vel", "f4", (3,)), ("mass", "f8")]
            records = np.zeros(COUNT, kinds)
            records["id"], records["mass"] = np.arange(COUNT) + 7, MASS
            records["pos"], records["vel"] = cloud(k)
            file.create_group(f"step_{k}")["table"] = records
            file[f"step_{k}"].attrs["time"] = time
    return [folder / "slide.hdf5"]


def write_ply(folder):
    """Text, with faces behind the vertices."""
    for k in range(3):
        columns = table(k)
        columns.pop("time")
        head = f"ply\nformat ascii 1.0\ncomment none\nelement vertex {COUNT}\n"
        head += "".join(f"property double {name}\n" for name in columns)
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        rows = np.column_stack(list(columns.values())).tolist()
        text = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
        (folder / f"slide_{50 * k}.ply").write_text(head + text + "3 0 1 2\n")
    return [folder]


STEPS = ("--dt", "0.01")
DENSE = ("--density", f"{DENSITY:g}")
CODES = {  # name -> (reader, writer, what has to be said besides)
    "cbgeo": ("cbgeo", write_cbgeo, ()),
    "cbgeo, pieces": ("cbgeo", write_cbgeo_pieces, ()),
    "kratos, times": ("kratos", write_kratos_times, ()),
    "kratos, steps": ("kratos", write_kratos_steps, ()),
    "kratos-gid": ("kratos-gid", write_kratos_gid, ()),
    "geotaichi": ("geotaichi", write_geotaichi, DENSE),
    "anura3d": ("anura3d", write_anura3d, DENSE),
    "anura3d, binary": ("anura3d", write_anura3d_binary, DENSE),
    "mpm-geomechanics": ("mpm-geomechanics", write_mpm_geomechanics, (*DENSE, "--particle-volume", f"{VOLUME:g}")),
    "lammps": ("lammps", write_lammps, (*DENSE, *STEPS)),
    "liggghts": ("lammps", write_liggghts, (*DENSE, *STEPS)),
    "karamelo": ("lammps", write_karamelo, (*DENSE, *STEPS)),
    "vtp ascii": ("vtk", vtk_writer(".vtp", "ascii"), DENSE),
    "vtu base64": ("vtk", vtk_writer(".vtu", "binary"), DENSE),
    "vtu base64 zlib": ("vtk", vtk_writer(".vtu", "binary", packed=True, header="UInt64"), DENSE),
    "vtp raw": ("vtk", vtk_writer(".vtp", "raw", header="UInt64"), DENSE),
    "vtu raw zlib": ("vtk", vtk_writer(".vtu", "raw", packed=True), DENSE),
    "vtp appended base64": ("vtk", vtk_writer(".vtp", "base64"), DENSE),
    "vtp appended base64 zlib": ("vtk", vtk_writer(".vtp", "base64", packed=True, header="UInt64"), DENSE),
    "vtk 5.1": ("vtk", write_legacy, DENSE),
    "pvd of pvtu": ("vtk", write_pieces, DENSE),
    "ply": ("ply", write_ply, (*DENSE, *STEPS)),
    "npz": ("npz", write_npz, DENSE),
    "hdf5": ("hdf5", write_hdf5, DENSE),
    "hdf5, steps": ("hdf5", write_hdf5_steps, DENSE),
    "csv": ("csv", csv_writer(), DENSE),
    "csv, particle by particle": ("csv", csv_writer(order=by_particle), DENSE),
    "csv, semicolons": ("csv", csv_writer(";", decimal=","), DENSE),
    "table of blanks": ("csv", csv_writer("  ", "# ", name="slide.txt"), DENSE),
    "parquet": ("parquet", write_parquet, DENSE),
}
