"""The benchmark table: every benchmark can be imported, and a row contains value and reference."""

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def load(name, monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", sorted(HERE.glob("bench_*.py")), ids=lambda path: path.stem)
def test_every_benchmark_offers_rows(path, monkeypatch):
    module = load(path.stem, monkeypatch)
    assert module.__doc__
    assert not inspect.signature(module.rows).parameters


def test_a_row_is_one_line_with_its_reference(monkeypatch):
    table = load("run", monkeypatch)
    text = table.line("4 000 000 particles", 0.31234, "s", "paper 25 s", 0.0125)
    assert text.split() == ["4", "000", "000", "particles", "0.3123", "s", "paper", "25", "s", "0.0125"]
    skipped = table.line("1e8 particles", None, "s", "skipped: 3 GB free, wants 20 GB", None)
    assert skipped.split()[2] == "-" and skipped.endswith("-") and "skipped" in skipped


def test_one_failing_benchmark_fails_the_run_and_the_others_are_shown(monkeypatch, capsys, tmp_path):
    table = load("run", monkeypatch)
    (tmp_path / "bench_good_one.py").write_text("def rows():\n    yield 'case', 2.0, 's', 'reference', 0.5\n")
    (tmp_path / "bench_bad_one.py").write_text("def rows():\n    raise OSError('no disk')\n    yield\n")
    monkeypatch.setattr(table, "HERE", tmp_path)
    assert table.run({"bad_one": "bench_bad_one", "good_one": "bench_good_one"}) == 1
    out = capsys.readouterr().out
    assert "bad_one: failed" in out and "reference" in out.splitlines()[-1]


def test_a_benchmark_prints_as_markdown_all_its_rows_or_its_own_summary(monkeypatch, capsys, tmp_path):
    table = load("run", monkeypatch)
    rows = "def rows():\n    yield 'case', 2.0, 's', 'reference', None\n"
    (tmp_path / "bench_all_rows.py").write_text(rows)
    (tmp_path / "bench_shorter.py").write_text(
        rows + "def summary():\n    return ('what', 'error'), [('dam', '1 %')]\n"
    )
    monkeypatch.setattr(table, "HERE", tmp_path)
    assert table.run({"all_rows": "bench_all_rows", "shorter": "bench_shorter"}, as_markdown=True) == 0
    printed = capsys.readouterr().out.splitlines()[1:]
    assert printed[0] == "| case | value | unit | reference | ratio |" and printed[1] == "|" + " --- |" * 5
    assert printed[2:] == ["| case | 2 | s | reference | - |", "| what | error |", "| --- | --- |", "| dam | 1 % |"]


def test_an_unknown_benchmark_is_named():
    done = subprocess.run([sys.executable, HERE / "run.py", "nonsense"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "no benchmark named 'nonsense'" in done.stderr and "solver" in done.stderr
