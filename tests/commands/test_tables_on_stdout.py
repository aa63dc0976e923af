"""`-o -` and `--json` of answers that are tables; labelled sizes of `info`."""

import csv
import io
import json

import pytest
from block_frames import write_block_run

from mpmgis.commands.shell.main import main


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_block_run(tmp_path_factory.mktemp("tables"), (150.0, 450.0, 600.0), speeds=(0.0, 10.0, 0.0))


def answered(words, capsys):
    capsys.readouterr()
    assert main(words) == 0
    return capsys.readouterr().out


def test_a_series_as_csv_and_as_json_leaves_no_file(run, capsys):
    before = sorted(run.parent.rglob("*"))
    x, y = json.loads(answered(["info", str(run), "--json"], capsys))["bbox"][:2]
    words = ["timeseries", str(run), "--at", f"{x + 1},{y + 1}", "-o", "-"]
    rows = list(csv.DictReader(io.StringIO(answered(words, capsys))))
    assert rows and any(name.startswith("time") for name in rows[0])
    told = json.loads(answered([*words, "--json"], capsys))["rows"]
    assert len(told) == len(rows) and list(told[0]) == list(rows[0])
    assert sorted(run.parent.rglob("*")) == before


def test_runout_has_its_own_facts(run, capsys):
    assert json.loads(answered(["runout", str(run), "-o", "-", "--json"], capsys))
    assert "," in answered(["runout", str(run), "-o", "-"], capsys).splitlines()[0]


def test_what_is_no_table_refuses_stdout(run, capsys):
    assert main(["export-raster", str(run), "-o", "-"]) == 2
    assert "for answers that are tables" in capsys.readouterr().err


def test_info_names_columns_and_rows(run, capsys):
    dtm = next(run.parent.rglob("*.tif"))
    facts = json.loads(answered(["info", str(dtm), "--json", "-o", "-"], capsys))
    assert [facts["size"]["rows"], facts["size"]["columns"]] == facts["cells"]
    shown = next(line for line in answered(["info", str(dtm)], capsys).splitlines() if "size" in line)
    assert f"columns {facts['size']['columns']}" in shown and f"rows {facts['size']['rows']}" in shown
