"""Damage to files, as disks, transfers, other programs and hands do it; every change follows from the random generator.

`damage(path, random)` changes a file in place and says in words what it did. Half of the changes know the file's
format and spoil single fields of it, the others know only bytes.
"""

import json
import re
import shutil
import sqlite3
import struct
import tomllib

import h5py
import numpy as np

WHOLE = [
    0,
    1,
    2,
    3,
    7,
    16,
    100,
    255,
    256,
    1000,
    32767,
    32768,
    65535,
    65536,
    10**6,
    2**31 - 1,
    2**31,
    2**32 - 1,
    -1,
    -2,
    -(2**31),
    2**40,
    2**63 - 1,
]
REAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-300,
    5e-324,
    1e-9,
    0.1,
    1e3,
    1e9,
    1e18,
    1e38,
    1e300,
    -1e300,
    float("nan"),
    float("inf"),
    float("-inf"),
]
WORDS = [
    "",
    " ",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "-1",
    "0",
    "1",
    "1e9",
    "1e-9",
    "99999999999999999999",
    "0x10",
    "true",
    "null",
    "''",
    '""',
    "[]",
    "{}",
    "[[[[]]]]",
    "../../../etc/passwd",
    "/dev/null",
    "/dev/zero",
    ".",
    "..",
    "/",
    "out",
    "dtm.tif",
    "release.shp",
    "\u0000",
    "\ufeff",
    "\u202e",
    "\U0001f4a5",
    "ä" * 300,
    "a" * 5000,
    "\n",
    "\r",
    "\t",
    "#",
    "%s%n",
    "$(touch out/x)",
    "`id`",
    "__import__('os').system('id')",
    "1979-05-27",
    "1,5",
]
TEXT = (".toml", ".csv", ".geojson", ".json", ".vtp", ".vtu", ".pvd", ".res", ".msh", ".lammpstrj")
LAWS = [
    "Voellmy",
    "Coulomb",
    "Bingham",
    "VoellmyModified",
    "Pouliquen",
    "SamosAT",
    "HerschelBulkley",
    "Fluid",
    "MuI",
    "CohesiveMuI",
    "Elastic",
    "DruckerPrager",
]


def damage(path, random):
    """Change the file at `path`; answers what was done."""
    known = _BY_SUFFIX.get(path.suffix.lower())
    if known is not None and random.random() < (0.9 if path.suffix in TEXT else 0.6):
        try:
            return known(path, random)
        except Exception as error:  # a second change of what the first one spoilt
            return f"left as it is: {type(error).__name__}"
    return damage_bytes(path, random)


# ------------------------------------------------------------------------------------------------------ any bytes


def damage_bytes(path, random):
    """One of the changes that need no knowledge of the format."""
    raw = bytearray(path.read_bytes())
    change = random.choice([_flipped, _flipped, _cut, _swapped, _blanked, _inserted, _repeated, _number_set])
    raw, words = change(raw, random)
    path.write_bytes(raw)
    return words


def _place(raw, random):
    """An offset: near the start, where headers are, as often as anywhere."""
    return random.randrange(max(1, min(len(raw), random.choice([64, 512, len(raw)]))))


def _flipped(raw, random):
    count = random.choice([1, 1, 2, 8, 64])
    for _ in range(count):
        if raw:
            raw[_place(raw, random) % len(raw)] ^= 1 << random.randrange(8)
    return raw, f"{count} bits flipped"


def _cut(raw, random):
    keep = random.choice([0, 1, _place(raw, random), random.randrange(len(raw) + 1), max(len(raw) - 1, 0)])
    return raw[:keep], f"cut to {keep} bytes"


def _swapped(raw, random):
    size = random.choice([4, 16, 256, 4096])
    a, b = _place(raw, random), _place(raw, random)
    first, second = bytes(raw[a : a + size]), bytes(raw[b : b + size])
    raw[a : a + len(first)], raw[b : b + len(second)] = second[: len(first)], first[: len(second)]
    return raw, f"{size} bytes at {a} and {b} swapped"


def _blanked(raw, random):
    start, size, value = _place(raw, random), random.choice([1, 4, 64, 1024]), random.choice([0, 255, 32])
    raw[start : start + size] = bytes([value]) * len(raw[start : start + size])
    return raw, f"{size} bytes at {start} set to {value}"


def _inserted(raw, random):
    start, more = _place(raw, random), random.randbytes(random.choice([1, 3, 16, 700]))
    raw[start:start] = more
    return raw, f"{len(more)} bytes put in at {start}"


def _repeated(raw, random):
    start, size = _place(raw, random), random.choice([8, 128, 2048])
    raw[start:start] = raw[start : start + size] * random.choice([1, 3])
    return raw, f"{size} bytes at {start} repeated"


def _number_set(raw, random):
    form = random.choice(["<H", ">H", "<i", ">i", "<I", ">I", "<q", ">q", "<d", ">d", "<f"])
    start = _place(raw, random)
    size = struct.calcsize(form)
    if start + size > len(raw):
        return _flipped(raw, random)
    value = _number(form[1], random)
    raw[start : start + size] = struct.pack(form, value)
    return raw, f"{value!r} as {form} written at {start}"


def _number(code, random):
    """A number that is known to hurt, as struct's `code` holds it."""
    if code == "d":
        return random.choice(REAL)
    if code == "f":
        return random.choice([value for value in REAL if not 3e38 < abs(value) < float("inf")])
    low, high = {"B": (0, 8), "H": (0, 16), "I": (0, 32), "Q": (0, 64), "i": (-31, 31), "q": (-63, 63)}[code]
    low, high = -(2**-low) if low else 0, 2**high
    return random.choice([value for value in WHOLE if low <= value < high])


# ----------------------------------------------------------------------------------------------------------- TIFF

_TIFF_CODES = {1: "B", 3: "H", 4: "I", 12: "d", 16: "Q"}
_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 12: 8, 16: 8}


def damage_tiff(path, random):
    """Spoil one entry of the first directory: its tag, type, count, or a value of it."""
    raw = bytearray(path.read_bytes())
    big = raw[2] == 43
    start = struct.unpack_from("<Q", raw, 8)[0] if big else struct.unpack_from("<I", raw, 4)[0]
    count = struct.unpack_from("<Q" if big else "<H", raw, start)[0]
    entry = start + (8 if big else 2) + random.randrange(count) * (20 if big else 12)
    tag, kind = struct.unpack_from("<HH", raw, entry)
    number = struct.unpack_from("<Q" if big else "<I", raw, entry + 4)[0]
    what = random.choice(["tag", "type", "count", "value", "value", "value"])
    if what == "tag":
        struct.pack_into("<H", raw, entry, random.choice([256, 257, 258, 259, 262, 277, 322, 339, 33550, 34735, 42113]))
    elif what == "type":
        struct.pack_into("<H", raw, entry + 2, random.choice([0, 1, 2, 3, 4, 5, 12, 13, 16, 999]))
    elif what == "count":
        struct.pack_into("<Q" if big else "<I", raw, entry + 4, _number("I", random))
    else:
        _spoil_tiff_value(raw, entry, kind, number, big, random)
    path.write_bytes(raw)
    return f"TIFF tag {tag}: {what}"


def _spoil_tiff_value(raw, entry, kind, number, big, random):
    """Overwrite one of the values that an entry holds, or points to."""
    size, field = _TIFF_SIZES.get(kind, 1), entry + (12 if big else 8)
    inline = number * size <= (8 if big else 4)
    place = field if inline else struct.unpack_from("<Q" if big else "<I", raw, field)[0]
    place += size * random.randrange(max(1, min(number, 5000)))
    code = _TIFF_CODES.get(kind)
    if code is None:
        raw[place] = random.randrange(256)
    else:
        struct.pack_into("<" + code, raw, place, _number(code, random))


# ------------------------------------------------------------------------------------------------------ shapefiles


def damage_shp(path, random):
    """Spoil a field of the header, of a record's header, or a number in a polygon; or a file beside it."""
    raw = bytearray(path.read_bytes())
    place, form = random.choice(
        [
            (0, ">i"),
            (24, ">i"),
            (28, "<i"),
            (32, "<i"),
            *((36 + 8 * k, "<d") for k in range(4)),
            (100, ">i"),
            (104, ">i"),
            (108, "<i"),
            *((112 + 8 * k, "<d") for k in range(4)),
            (144, "<i"),
            (148, "<i"),
            (152, "<i"),
            *((156 + 8 * k, "<d") for k in range(10)),
        ]
    )
    value = _number(form[1], random)
    struct.pack_into(form, raw, place, value)
    path.write_bytes(raw)
    return f".shp: {value!r} at {place}"


def damage_shx(path, random):
    """Spoil the index: length, kind, offsets."""
    raw = bytearray(path.read_bytes())
    place = random.choice([0, 24, 32, *range(100, len(raw) - 3, 4)])
    value = _number("i", random)
    struct.pack_into(">i", raw, place, value)
    path.write_bytes(raw)
    return f".shx: {value} at {place}"


def damage_dbf(path, random):
    """Spoil the table: number of records, sizes, field descriptors, cells."""
    raw = bytearray(path.read_bytes())
    what = random.choice(["records", "header", "record", "field", "cell"])
    if what == "records":
        struct.pack_into("<I", raw, 4, _number("I", random))
    elif what in ("header", "record"):
        struct.pack_into("<H", raw, 8 if what == "header" else 10, _number("H", random))
    elif what == "field":
        raw[32 + random.randrange(64)] = random.choice([0, 1, 13, 32, 67, 68, 70, 76, 78, 255])
    else:
        start = struct.unpack_from("<H", raw, 8)[0]
        word = random.choice(WORDS).encode("utf-8", "replace")[:24]
        place = random.randrange(start, len(raw))
        raw[place : place + len(word)] = word[: len(raw) - place]
    path.write_bytes(raw)
    return f".dbf: {what}"


def damage_shapefile(path, random):
    """One of the files that make a shapefile: damaged, or gone."""
    part = random.choice([".shp", ".shp", ".shp", ".shx", ".dbf", ".dbf", ".prj"])
    file = path.with_suffix(part)
    if random.random() < 0.1:
        file.unlink()
        return f"{part} is gone"
    if part == ".prj":
        return ".prj: " + damage_text(file, random)
    if random.random() < 0.3:
        return f"{part}: {damage_bytes(file, random)}"
    return {".shp": damage_shp, ".shx": damage_shx, ".dbf": damage_dbf}[part](file, random)


# ------------------------------------------------------------------------------------------------------ GeoPackages


def damage_gpkg(path, random):
    """Change the database as a database: geometry, columns, tables, what it says of itself."""
    base = sqlite3.connect(path, isolation_level=None)
    try:
        base.execute("PRAGMA foreign_keys = OFF")
        for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
            base.execute(f'DROP TRIGGER "{name}"')  # they call functions that only GDAL brings
        table, column = base.execute("SELECT table_name, column_name FROM gpkg_geometry_columns").fetchone()
        return random.choice([_gpkg_shape, _gpkg_shape, _gpkg_cell, _gpkg_entry, _gpkg_statement])(
            base, table, column, random
        )
    finally:
        base.close()


def _gpkg_shape(base, table, column, random):
    """Bytes of one geometry: flags, SRS, envelope, WKB type, counts, coordinates."""
    row, blob = base.execute(f'SELECT rowid, "{column}" FROM "{table}"').fetchone()
    raw = bytearray(blob)
    place, form = random.choice(
        [
            (0, "<H"),
            (2, "<H"),
            (3, "B"),
            (4, "<i"),
            *((8 + 8 * k, "<d") for k in range(4)),
            (40, "B"),
            (41, "<I"),
            (45, "<I"),
            (49, "<I"),
            *((53 + 8 * k, "<d") for k in range(6)),
            (len(raw) // 2, "cut"),
        ]
    )
    if form == "cut":
        raw = raw[:place]
    else:
        struct.pack_into(form, raw, place, _number(form[-1], random))
    base.execute(f'UPDATE "{table}" SET "{column}" = ? WHERE rowid = ?', (bytes(raw), row))
    return f"geometry: {form} at {place}"


def _gpkg_cell(base, table, column, random):
    names = [row[1] for row in base.execute(f'PRAGMA table_info("{table}")') if row[1] != column]
    name, value = random.choice([*names, column]), random.choice([*REAL, *WORDS, None, b"\x00\xff", 2**62, -1])
    base.execute(f'UPDATE "{table}" SET "{name}" = ?', (value,))
    return f"{name} = {str(value)[:20]!r}"


def _gpkg_entry(base, table, column, random):
    about = random.choice(["gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys", "gpkg_ogr_contents"])
    names = [row[1] for row in base.execute(f"PRAGMA table_info({about})")]
    name, value = random.choice(names), random.choice([*WORDS, None, 0, -1, 2**31, 4326, 31254, 99999, float("nan")])
    base.execute(f'UPDATE {about} SET "{name}" = ?', (value,))
    return f"{about}.{name} = {str(value)[:20]!r}"


def _gpkg_statement(base, table, column, random):
    statement = random.choice(
        [
            f'DROP TABLE "{table}"',
            f'DELETE FROM "{table}"',
            "DROP TABLE gpkg_contents",
            "DROP TABLE gpkg_spatial_ref_sys",
            "DELETE FROM gpkg_geometry_columns",
            "PRAGMA user_version = 99999",
            "PRAGMA application_id = 1",
            f'ALTER TABLE "{table}" RENAME TO other',
            f'ALTER TABLE "{table}" ADD COLUMN d0_ REAL',
            f'ALTER TABLE "{table}" RENAME COLUMN "{column}" TO shape',
            f'INSERT INTO "{table}" DEFAULT VALUES',
            f'CREATE VIEW more AS SELECT * FROM "{table}"',
        ]
    )
    base.execute(statement)
    return statement


# ------------------------------------------------------------------------------------------------------------ HDF5


def damage_hdf5(path, random):
    """Change a frame as HDF5: attributes, arrays, their shapes and types, links."""
    with h5py.File(path, "r+") as file:
        groups = [file, *(item for item in file.values() if isinstance(item, h5py.Group))]
        group = random.choice(groups)
        return random.choice([_hdf5_attribute, _hdf5_attribute, _hdf5_values, _hdf5_values, _hdf5_array, _hdf5_link])(
            group, random
        )


def _hdf5_attribute(group, random):
    holders = [group, *(item for item in group.values() if isinstance(item, h5py.Dataset))]
    holder = random.choice(holders)
    names = sorted(holder.attrs) or ["time"]
    name = random.choice([*names, *names, "time", "origin", "density", "dimension"])
    value = random.choice(
        [
            *REAL,
            *WHOLE[:-1],
            *(word for word in WORDS if "\0" not in word),
            np.zeros(0),
            np.zeros((2, 2)),
            np.array([np.nan] * 3),
            np.array([1e300] * 3),
            b"bytes\xff",
            np.array(["a", "b"], dtype=h5py.string_dtype()),
            h5py.Empty("f8"),
            True,
            np.complex128(1j),
            np.float16(1),
            np.void(b"abc"),
            group.ref,
        ]
    )
    del_first = name in holder.attrs and random.random() < 0.1
    if del_first:
        del holder.attrs[name]
        return f"attribute {name} is gone"
    holder.attrs[name] = value
    return f"attribute {holder.name} {name} = {str(value)[:30]!r}"


def _datasets(group):
    return sorted(name for name, item in group.items() if isinstance(item, h5py.Dataset))


def _hdf5_values(group, random):
    names = _datasets(group)
    if not names:
        return _hdf5_attribute(group, random)
    name = random.choice(names)
    values = group[name][()]
    if np.ndim(values) == 0 or not values.size:
        return _hdf5_array(group, random)
    kind = values.dtype.kind
    value = random.choice(REAL if kind == "f" else [0, 1, 2**31 - 1, 127, 255])
    where = random.choice([0, -1, slice(None), slice(None, None, 2)])
    with np.errstate(over="ignore", invalid="ignore"):
        values[where] = np.asarray(value).astype(values.dtype)
    group[name][...] = values
    return f"{name}[{where}] = {value}"


def _hdf5_array(group, random):
    """One array by another: another length, rank, type, or none at all."""
    names = _datasets(group) or ["position"]
    name = random.choice(names)
    old = group[name][()] if name in group else np.zeros((3, 3))
    if name in group:
        del group[name]
    change = random.choice(
        [
            "gone",
            "group",
            "empty",
            "scalar",
            "text",
            "object",
            "longer",
            "flat",
            "complex",
            "half",
            "big-endian",
            "compound",
            "huge",
            "chunked",
            "bool",
            "null",
        ]
    )
    if change == "gone":
        return f"{name} is gone"
    if change == "group":
        group.create_group(name)
    elif change == "object":
        group.create_dataset(name, data=[group.ref] * len(np.atleast_1d(old)), dtype=h5py.ref_dtype)
    elif change == "text":
        group.create_dataset(name, data=["x"] * len(np.atleast_1d(old)), dtype=h5py.string_dtype())
    elif change == "compound":
        group.create_dataset(name, (len(np.atleast_1d(old)),), np.dtype([("a", "f8"), ("b", "i4")]))
    elif change == "huge":  # stored nowhere: a fill value stands for all of it
        group.create_dataset(name, (10 ** random.choice([9, 12]), *np.shape(old)[1:]), "f8", chunks=True)
    elif change == "null":
        group.create_dataset(name, data=h5py.Empty("f8"))
    else:
        made = {
            "empty": old[:0] if np.ndim(old) else np.zeros(0),
            "scalar": np.float64(1.0),
            "flat": np.ravel(old),
            "longer": np.concatenate([np.atleast_1d(old)] * 2),
            "complex": np.asarray(old).astype("c16"),
            "half": np.clip(old, -6e4, 6e4).astype("f2"),
            "big-endian": np.asarray(old).astype(">f8"),
            "bool": np.asarray(old).astype(bool),
            "chunked": old,
        }[change]
        packed = {"compression": "gzip", "shuffle": True} if change == "chunked" and np.ndim(old) else {}
        group.create_dataset(name, data=made, **packed)
    return f"{name}: {change}"


def _hdf5_link(group, random):
    """A name that leads elsewhere: nowhere, in a circle, out of the file."""
    names = sorted(group) or ["particles"]
    name = random.choice(names)
    if name in group:
        del group[name]
    target = random.choice(["nowhere", "circle", "outside", "device", "root", "seed"])
    group[name] = {
        "nowhere": h5py.SoftLink("/nowhere"),
        "circle": h5py.SoftLink(f"{group.name.rstrip('/')}/{name}"),
        "outside": h5py.ExternalLink("../../../etc/passwd", "/"),
        "device": h5py.ExternalLink("/dev/zero", "/"),
        "root": h5py.SoftLink("/"),
        "seed": h5py.ExternalLink("seed.h5", "/particles"),
    }[target]
    return f"{group.name} {name} links to {target}"


# ------------------------------------------------------------------------------------------------------------ text

_TOKEN = re.compile(r"\"[^\"\n]*\"|[-+\w.]+|[\[\]{}=,:;]")


def damage_text(path, random):
    """Put another word in the place of one or more, drop, repeat or move lines."""
    text = path.read_text(encoding="utf-8", errors="replace")
    for _ in range(random.choice([1, 1, 1, 2, 5])):
        text, words = _text_changed(text, random)
    path.write_bytes(text.encode(random.choice(["utf-8"] * 12 + ["utf-16", "latin-1", "utf-8-sig"]), "replace"))
    return words


def _text_changed(text, random):
    tokens = list(_TOKEN.finditer(text))
    lines = text.splitlines(keepends=True)
    others = ["drop line", "repeat line", "move line", "deep", "law", "cut"]
    what = random.choice(["word"] * 6 + ["number"] * 5 + others)
    if not tokens or not lines:
        return random.choice(WORDS), "text out of nothing"
    if what == "number":
        tokens = [token for token in tokens if re.fullmatch(r"[-+]?\d[\d.eE+-]*", token[0])] or tokens
    if what in ("word", "number", "law"):
        token = random.choice(tokens)
        word = random.choice(LAWS) if what == "law" else str(random.choice([*WORDS, *REAL, *WHOLE, 1e-3, 0.5, 30, 500]))
        if token[0].startswith('"') and random.random() < 0.7:
            word = f'"{word}"'
        return text[: token.start()] + word + text[token.end() :], f"{token[0][:20]!r} is {word[:20]!r}"
    k = random.randrange(len(lines))
    if what == "drop line":
        del lines[k]
    elif what == "repeat line":
        lines[k:k] = [lines[k]] * random.choice([1, 2, 300])
    elif what == "move line":
        lines.insert(random.randrange(len(lines)), lines.pop(k))
    elif what == "deep":
        depth = random.choice([10, 100, 3000])
        lines.insert(k, "x = " + "[" * depth + "]" * depth + "\n")
    else:
        return text[: random.randrange(len(text))], what
    return "".join(lines), f"{what} {k + 1}"


def damage_scene(path, random):
    """Give one key of a sound scene another value, add or drop one, so that the text stays TOML; or damage the text."""
    if random.random() < 0.25:
        return damage_text(path, random)
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    done = _scene_changed(tables, random)
    path.write_text(_as_toml(tables), encoding="utf-8")
    return done


def _scene_changed(tables, random):
    """Change one value in place; a number by another one mostly, as no check of its type would catch."""
    places = [place for place in _json_places(tables) if not isinstance(place[0][place[1]], (dict, list))]
    numbers = [(holder, key) for holder, key in places if isinstance(holder[key], (int, float))]
    what = random.choice(["number"] * 8 + ["value"] * 3 + ["drop", "add", "table", "law", "file"])
    holder, key = random.choice(numbers if what == "number" and numbers else places)
    if what == "number":
        old = holder[key]
        near = old * random.choice([0.5, 2, 3, 10, 30, 100, 1e-1, 1e-2, 1e-3, 1e-6, 1e3, 1e6])
        near = round(near) if isinstance(old, int) and random.random() < 0.8 else near
        holder[key] = random.choice([near] * 3 + [random.uniform(0, 100), random.choice([*REAL, *WHOLE])])
    elif what == "drop" and isinstance(holder, dict):
        del holder[key]
        return f"{key} is gone"
    elif what == "table":
        name = random.choice(SCENE_TABLES)
        tables[name] = random.choice([{}, {"use": "on"}, {"use": "off"}, [], [{}], 1, [{"source": "wall.gpkg"}]])
        return f"[{name}] = {tables[name]}"
    elif what == "add":
        places = [place for place in _json_places(tables) if isinstance(place[0][place[1]], dict)]
        holder, key = (lambda place: (place[0][place[1]], random.choice(SCENE_KEYS)))(random.choice(places))
        holder[key] = random.choice([*REAL, *WHOLE, *WORDS, *SCENE_FILES, True, [], [1.0, 2.0]])
    else:
        holder[key] = random.choice({"law": LAWS, "file": SCENE_FILES}.get(what, [*WORDS, True, [], {}, [[1]], 1.5]))
    return f"{key} = {str(holder[key])[:30]!r}"


SCENE_TABLES = [
    "release",
    "hydrograph",
    "secondary_release",
    "friction",
    "material",
    "softening",
    "zones",
    "cohesion",
    "earth_pressure",
    "viscosity",
    "curvature",
    "still_water",
    "entrainment",
    "barrier",
    "numerics",
    "stage",
    "terrain",
    "output",
]
SCENE_KEYS = [
    "source",
    "particles",
    "thickness",
    "surface",
    "density",
    "speed",
    "window",
    "crs",
    "band",
    "points",
    "seed",
    "mu",
    "xi",
    "law",
    "use",
    "height",
    "crest",
    "width",
    "cell_size",
    "particles_per_cell",
    "clamp",
    "form",
    "edges",
    "points_per_cell",
    "stiffness",
    "arrival_thickness",
    "stop_at_rest",
    "level",
    "lower_bed",
    "cohesion",
    "viscosity",
    "yield_stress",
    "friction_angle",
    "trigger_thickness",
    "velocity",
]
SCENE_FILES = [
    "dtm.tif",
    "tiled.tif",
    "mask.tif",
    "release.shp",
    "release.gpkg",
    "release.geojson",
    "wall.gpkg",
    "seed.h5",
    "points.h5",
    "inflow.csv",
    "scene.toml",
    "results",
    ".",
    "out",
    "/dev/null",
    "/dev/zero",
    "/dev/stdin",
    "release.gpkg|layername=release",
    "release.gpkg|layername=none",
    "/vsizip/dtm.tif",
    "fifo",
]


def _as_toml(tables):
    """Tables as TOML; what they hold may be wrong, the text is not."""
    plain = {key: value for key, value in tables.items() if not _is_table(value)}
    lines = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in plain.items()]
    for name, value in tables.items():
        if _is_table(value):
            for table in value if isinstance(value, list) else [value]:
                lines.append(f"[[{name}]]" if isinstance(value, list) else f"[{name}]")
                lines += [f"{_toml_key(key)} = {_toml_value(entry)}" for key, entry in table.items()]
    return "\n".join(lines) + "\n"


def _is_table(value):
    return isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict))


def _toml_key(key):
    return json.dumps(key)


def _toml_value(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml_key(key)} = {_toml_value(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value)


def damage_table(path, random):
    """Give one cell or name of a CSV another value, or damage its text."""
    if random.random() < 0.25:
        return damage_text(path, random)
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    row = random.choice(rows)
    cell = random.randrange(len(row))
    names = ["time", "discharge", "thickness", "speed", "velocity_east", "velocity_north"]
    hurting = random.choice([*REAL, *WHOLE, *WORDS, *names])
    row[cell] = str(random.choice([hurting, random.uniform(0, 1000), 1.5, 3, 20]))
    separator = random.choice([",", ",", ";", "\t"])
    path.write_text("\n".join(separator.join(row) for row in rows) + "\n", encoding="utf-8")
    return f"a cell is {row[cell][:20]!r}"


def damage_json(path, random):
    """Change one value of a GeoJSON, or its text."""
    if random.random() < 0.5:
        return damage_text(path, random)
    content = json.loads(path.read_text(encoding="utf-8"))
    holder, key = random.choice(list(_json_places(content)))
    value = random.choice([*WORDS, *REAL, *WHOLE, None, [], {}, [[[]]], [[0, 0]], True])
    holder[key] = value
    path.write_text(json.dumps(content), encoding="utf-8")
    return f"{key!r} = {str(value)[:20]!r}"


def _json_places(content):
    """(holder, key) of every value in nested JSON."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in pairs:
        yield content, key
        if isinstance(value, (dict, list)):
            yield from _json_places(value)


_BY_SUFFIX = {
    ".tif": damage_tiff,
    ".shp": damage_shapefile,
    ".gpkg": damage_gpkg,
    ".h5": damage_hdf5,
    ".toml": damage_scene,
    ".csv": damage_table,
    ".geojson": damage_json,
    ".json": damage_json,
    ".vtp": damage_text,
    ".vtu": damage_text,
    ".pvd": damage_text,
    ".res": damage_text,
    ".msh": damage_text,
    ".lammpstrj": damage_text,
}


def copy_of(sound, folder):
    """Copy the sound inputs into `folder`, which is made."""
    shutil.copytree(sound, folder)
