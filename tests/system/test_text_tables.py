"""All tables that users write are read in one form: hydrographs, particles, observations, results of other codes."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mpmgis.exchange.declarations import Declarations
from mpmgis.exchange.frame_list import list_frames
from mpmgis.results.reports.file_facts import inspect
from mpmgis.studies.other_code_results import read_other_results
from mpmgis.system.errors import FormatError, MpmgisError
from mpmgis.system.text_tables import cells_of, decoded, delimiter_of, header_cells, with_point
from mpmgis.terrain.hydrograph_file import read_hydrograph
from mpmgis.terrain.vector_table import read_table, require_polygons

ENCODINGS = {
    "utf-8": lambda text: text.encode(),
    "utf-8 with a mark": lambda text: text.encode("utf-8-sig"),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-16, big-endian": lambda text: b"\xfe\xff" + text.encode("utf-16-be"),
}
FORMS = st.fixed_dictionaries(
    {
        "encoding": st.sampled_from(list(ENCODINGS)),
        "delimiter": st.sampled_from([",", ";", "\t", " "]),
        "comma": st.booleans(),
        "end": st.sampled_from(["\n", "\r\n"]),
        "named": st.booleans(),
        "trailing": st.booleans(),
        "last": st.booleans(),
        "comment": st.booleans(),
        "quoted": st.booleans(),
    }
)


def written(form, columns):
    """Bytes of a table in a form; None for one that no spreadsheet writes."""
    sign = form["delimiter"]
    if (sign == "," and form["comma"]) or (sign == " " and (form["trailing"] or form["named"] or form["quoted"])):
        return None
    if sign == " " and any(isinstance(value, str) and " " in value for values in columns.values() for value in values):
        return None

    def cell(value):
        word = value if isinstance(value, str) else repr(float(value))
        word = word if isinstance(value, str) or not form["comma"] else word.replace(".", ",")
        return f'"{word}"' if form["quoted"] or (isinstance(value, str) and sign in value) else word

    rows = [[f'"{name}"' if form["quoted"] else name for name in columns]]
    rows += [[cell(value) for value in row] for row in zip(*columns.values(), strict=True)]
    lines = [sign.join(row) + (sign if form["trailing"] else "") for row in rows]
    lines = [f"sep={sign}"] * form["named"] + ["# made by hand"] * form["comment"] + lines
    text = form["end"].join(lines) + (form["end"] if form["last"] else "")
    return ENCODINGS[form["encoding"]](text)


@given(FORMS)
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_table_is_read_from_every_form(tmp_path, form):
    path = tmp_path / "table.csv"
    times, amounts = [0.0, 1.5, 4.25], [2.5, 1e-3, 0.0]
    raw = written(form, {"time": times, "discharge": amounts})
    if raw is None:
        return
    path.write_bytes(raw)
    hydrograph = read_hydrograph(path)
    np.testing.assert_array_equal(hydrograph.time, times)
    np.testing.assert_array_equal(hydrograph.discharge, amounts)

    place, values = np.arange(12.0).reshape(4, 3) + 0.5, np.array([1.25, 2.0, 3.5, 0.125])
    columns = dict(zip("xyz", place.T, strict=True)) | {"vx": values, "vy": -values, "vz": 2 * values, "mass": values}
    path.write_bytes(written(form, columns))
    (entry,) = list_frames([path], Declarations(axes=("e", "n", "u"), origin=(0, 0, 0), times=(0.0,), density=2.0))
    particles = entry.read().particles
    np.testing.assert_array_equal(particles.position, place)
    np.testing.assert_array_equal(particles.velocity, np.column_stack([values, -values, 2 * values]))
    np.testing.assert_array_equal(particles.mass, values)

    names = ["a", "Hütte", "c", "d"]
    raw = written(form, {"name": names, "x": place[:, 0], "y": place[:, 1], "h_max": values})
    path.write_bytes(raw)
    table = read_table(path, "Point", "--points ")
    np.testing.assert_array_equal(table.columns["h_max"], values)
    assert table.columns["name"].tolist() == names and [p.x for p in table.geometry] == place[:, 0].tolist()

    path.write_bytes(written(form, {"setting": names, "seconds": values, "error_thickness": 0.5 * values}))
    rows = read_other_results(path, "thickness")
    assert [row.setting for row in rows] == names
    assert [row.seconds[0] for row in rows] == values.tolist()
    assert [row.errors.thickness for row in rows] == (0.5 * values).tolist()

    seed = {"x": place[:, 0], "y": place[:, 1], "z_bed": place[:, 2], "mass": values, "volume": values}
    seed |= {"u": values, "v": values, "w": values, "z_surface": values, "thickness": values, "area": values}
    path.write_bytes(written(form, seed))
    facts = inspect(path)
    assert facts["n"] == 4 and facts["mass"] == values.sum() and facts["thickness"] == [0.125, 3.5]


def read_features(path):
    return require_polygons(read_table(path), path)


def read_particles(path):
    return list_frames([path], Declarations(reader="csv"))


READERS = {
    "hydrograph": (read_hydrograph, "time,discharge\n0,1\n1,2\n"),
    "features": (read_features, "x,y\n0,1\n1,2\n"),
    "results": (lambda path: read_other_results(path, "thickness"), "setting,seconds,error_thickness\na,1,2\nb,1,2\n"),
    "particles": (read_particles, "x,y,z,vx,vy,vz,mass\n0,1,2,3,4,5,6\n1,2,3,4,5,6,7\n"),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("damage", "word"),
    [
        (lambda text: text.replace("0", "0,5").replace("1", "1,5").replace("a,", "a,b,"), "columns"),
        (lambda text: text.replace("\n", ",9,9,9,9\n", 2).replace(",9,9,9,9", "", 1), "columns"),
        (lambda text: text.encode("utf-16-le"), ""),  # without a mark
        (lambda text: ("ä" + text).encode("latin-1"), ""),
        (lambda text: b"\xff\xfe" + text.encode("utf-16-le")[:-1], ""),
        (lambda text: text.encode() + b"\xff\xff\n", ""),
        (lambda text: "", "empty"),
        (lambda text: "\n\n  \n", ""),
        (lambda text: '"' + "x" * 200_000 + '"\n1\n', ""),
    ],
)
def test_a_table_that_is_none_is_refused_in_a_line(tmp_path, reader, damage, word):
    path = tmp_path / "table.csv"
    read, text = READERS[reader]
    made = damage(text)
    path.write_bytes(made if isinstance(made, bytes) else made.encode())
    with pytest.raises(MpmgisError) as caught:
        found = read(path)
        _ = [entry.read() for entry in found] if reader == "particles" else None
    assert "\n" not in str(caught.value) and "table.csv" in str(caught.value) and word in str(caught.value)


def test_decimal_commas_between_commas_are_explained(tmp_path):
    for reader, text in (("hydrograph", "time,discharge\n0,5,1,5\n"), ("features", "x,y\n0,5,1,5\n")):
        (tmp_path / "t.csv").write_text(text)
        with pytest.raises(FormatError, match="use decimal points, or semicolons"):
            READERS[reader][0](tmp_path / "t.csv")


def test_a_geometry_in_wkt_and_a_crs_beside_it(tmp_path):
    (tmp_path / "t.csv").write_text('WKT;thickness;note\n"POLYGON ((0 0, 9 0, 9 9, 0 0))";1,5;a\n;;b\n')
    (tmp_path / "t.prj").write_text("EPSG:32632")
    table = read_table(tmp_path / "t.csv")
    assert table.columns["thickness"][0] == 1.5 and np.isnan(table.columns["thickness"][1])
    assert table.geometry[0].area == 40.5 and table.geometry[1] is None and table.crs.to_epsg() == 32632
    (tmp_path / "t.csv").write_text('WKT;thickness\n"POLYGON ((0 0, 9 0))";1,5\n')
    with pytest.raises(FormatError, match="line 2: no geometry in WKT"):
        read_table(tmp_path / "t.csv")


def test_quoted_cells_may_have_several_lines_and_lines_any_end(tmp_path):
    (tmp_path / "t.csv").write_bytes(
        b'\r\n# by hand\rx;y;note\n1,5;2;"first\r\nsecond \xe2\x80\xa8 third"\r3;4;"#"\n;;\n'
    )
    table = read_table(tmp_path / "t.csv", "Point")
    assert [p.x for p in table.geometry] == [1.5, 3.0]
    assert table.columns["note"].tolist() == ["first\nsecond \u2028 third", "#"]
    (tmp_path / "t.csv").write_bytes(b'x;y;note\n1;2;"first\nsecond"\n3;4\n')
    with pytest.raises(FormatError, match="line 4: 2 values for 3 columns"):
        read_table(tmp_path / "t.csv", "Point")


def test_cells_and_signs():
    assert delimiter_of("a b\tc") == "\t" and delimiter_of("a  b") == " " and delimiter_of("a;b,c;d") == ";"
    assert cells_of(' "a;b" ; c ', ";") == ["a;b", "c"] and cells_of("1  2\t3", " ") == ["1", "2", "3"]
    assert header_cells("a;;b;;", ";") == ["a", "column 2", "b"]
    assert with_point("1,5", ";") == "1.5" and with_point("1,500", ",") == "1,500"
    assert with_point("1.234,5", ";") == "1.234,5" and with_point("1,2,3", ";") == "1,2,3"
    assert decoded("é".encode("utf-16")) == decoded("é".encode("utf-8-sig")) == "é"
