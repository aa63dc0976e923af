"""The option `device`: what is chosen, refused and recorded; whole runs in the simulator of CUDA."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
import rasterio
import shapely
from slope_site import LAW, record, run, slide, write_block_site, write_shapes

from mpmgis.commands.shell.main import main
from mpmgis.frames.frame_digest import AS_WRITTEN
from mpmgis.frames.frame_files import read_frame
from mpmgis.scene import scene_from_tables
from mpmgis.simulation import run_device as rules
from mpmgis.simulation.preparation import prepare
from mpmgis.simulation.run_device import devices_record, require_devices
from mpmgis.solvers.gpu import available
from mpmgis.solvers.gpu.available import Device, Found
from mpmgis.solvers.gpu.device_point_solver import device_memory
from mpmgis.system.errors import SceneError

CARD = Device("NVIDIA H100", (9, 0), 80_000_000_000, 79_000_000_000)
NONE_HERE = Found(None, "no CUDA device can be used: none is there")
NEEDS_SIMULATOR = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed"
)
COARSE = {"cell_size": 8.0, "end_time": 0.2, "frame_interval": 0.1}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = write_block_site(tmp_path_factory.mktemp("device"))
    write_shapes(folder / "wall.geojson", [shapely.box(200, 150, 204, 250)])
    return folder


def scene(device="", **more):
    """A scene of 3D points on coarse cells."""
    return slide(**(COARSE | more), more=f'device = "{device}"' if device else "")


def prepared(site, text, device=None):
    """The Prepared run of the scene `text`."""
    path = site / "scene.toml"
    path.write_text(text)
    return prepare(path, device=device)


def chosen(site, text, monkeypatch, found, fewest=0, device=None):
    """Devices of the stages with a machine whose device is `found`."""
    monkeypatch.setattr(available, "found_device", lambda: found)
    monkeypatch.setattr(rules, "FEWEST_ON_DEVICE", fewest)
    return [stage.device for stage in prepared(site, text, device).stages]


def test_the_processor_is_the_default(site, monkeypatch):
    assert chosen(site, scene(), monkeypatch, Found(CARD)) == ["cpu"]


def test_the_option_replaces_the_key(site, monkeypatch):
    assert chosen(site, scene("cuda"), monkeypatch, Found(CARD)) == ["cuda"]
    assert chosen(site, scene("cuda"), monkeypatch, Found(CARD), device="cpu") == ["cpu"]
    assert chosen(site, scene(), monkeypatch, Found(CARD), device="auto") == ["cuda"]


@pytest.mark.parametrize(
    ("found", "fewest", "more", "reason"),
    [
        (NONE_HERE, 0, "", "cpu, because no CUDA device can be used: none is there"),
        (Found(CARD), 10**6, "", "are fewer than 1000000"),
        (Found(CARD._replace(free=10)), 0, "", "GB on the device"),
        (Found(CARD), 0, "", "cuda, for "),
    ],
)
def test_auto_names_its_reason(site, monkeypatch, caplog, found, fewest, more, reason):
    with caplog.at_level("INFO", "mpmgis"):
        devices = chosen(site, scene("auto") + more, monkeypatch, found, fewest)
    assert devices == ["cuda" if reason.startswith("cuda") else "cpu"]
    (line,) = [text for text in caplog.messages if "device = 'auto'" in text]
    assert reason in line


def test_all_stages_are_on_the_device(site, monkeypatch):
    staged = slide(**COARSE, head="", more='particles_per_cell = 4\ndevice = "cuda"')
    staged += '[[stage]]\nsolver = "columns"\nuntil = {time = 0.1}\n[[stage]]\nsolver = "points"\n'
    assert chosen(site, staged, monkeypatch, Found(CARD)) == ["cuda", "cuda"]


def test_columns_outside_a_window_are_refused(site, monkeypatch):
    staged = slide(**COARSE, head="", more="particles_per_cell = 4")
    staged += '[[stage]]\nsolver = "columns"\nuntil = {time = 0.1}\n'
    staged += '[[stage]]\nsolver = "points"\nwindow = "wall.geojson"\noutside = "columns"\n'
    with pytest.raises(SceneError, match="device = 'cuda': a device cannot compute outside = 'columns' of stage 2"):
        prepared(site, staged, "cuda")
    assert chosen(site, staged, monkeypatch, Found(CARD), device="auto") == ["cpu", "cpu"]


def test_columns_need_memory_too(site, monkeypatch):
    columns = slide(**COARSE, head='solver = "columns"', friction='law = "Coulomb"\nmu = 0.3')
    columns = columns[: columns.index("[material]")] + columns[columns.index("[friction]") :]
    assert chosen(site, columns, monkeypatch, Found(CARD), device="cuda") == ["cuda"]
    assert chosen(site, columns, monkeypatch, Found(CARD._replace(free=1000)), device="auto") == ["cpu"]


def test_a_run_without_a_device_writes_nothing(site, monkeypatch, capsys):
    monkeypatch.setattr(available, "found_device", lambda: NONE_HERE)
    assert run(site, scene("cuda"), "-q", "-o", str(site / "none")) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.endswith("device = 'cuda': no CUDA device can be used: none is there; or take device = 'cpu'")
    assert not (site / "none").exists()


def test_a_later_stage_that_is_too_large_is_refused_before_the_run(site, monkeypatch):
    monkeypatch.setattr(available, "found_device", lambda: Found(CARD._replace(free=1000)))
    with pytest.raises(SceneError, match=r"the run needs \S+ GB on the device \(NVIDIA H100"):
        require_devices(prepared(site, scene("cuda")))


def test_the_digest_does_not_depend_on_the_device(site):
    tables = {
        "solver": "points",
        "terrain": {"dem": "dtm.tif"},
        "release": {"source": "block.geojson", "thickness": 2.0},
        "material": {"law": "Elastic", "bulk_modulus": 1e6, "shear_modulus": 1e6},
        "output": {"end_time": 1.0, "frame_interval": 1.0},
    }
    digests = {
        device: scene_from_tables(tables | {"numerics": {"cell_size": 1.0, "device": device}}).digest()
        for device in ("cpu", "cuda", "auto")
    }
    assert len(set(digests.values())) == 1
    other = scene_from_tables(tables | {"numerics": {"cell_size": 2.0}}).digest()
    assert other not in digests.values()


def test_the_record_lists_the_devices_of_a_run():
    first = devices_record((), 0.0, "cpu")
    assert first == [{"from": 0.0, "device": "cpu"}]
    assert devices_record(first, 3.0, "cpu") == first
    both = devices_record(first, 3.0, "cuda: X")
    assert both == [*first, {"from": 3.0, "device": "cuda: X"}]
    assert devices_record(both, 2.0, "cpu") == first  # went back to a frame before the change
    assert devices_record(both, 0.0, "cuda: X") == [{"from": 0.0, "device": "cuda: X"}]


def test_float32_needs_half_the_memory(site):
    material = prepared(site, scene()).effects.material
    assert device_memory(10**8, "float64", material) == pytest.approx(
        2 * device_memory(10**8, "float32", material), rel=0.1
    )


@pytest.fixture
def few(site):
    """The site with a release of a few particles: the simulator takes milliseconds a particle and step."""
    write_shapes(site / "few.geojson", [shapely.box(104, 192, 120, 200)])
    return site


def command(site, name, text, *options, simulator=False, plain=False):
    """(`devices` of the record, standard error) of a run into the folder `name`; `plain`: without compiled kernels."""
    (site / f"{name}.toml").write_text(text.replace("block", "few"))
    environment = os.environ | ({"NUMBA_ENABLE_CUDASIM": "1"} if simulator else {})
    done = subprocess.run(
        [sys.executable, "-m", "mpmgis", "run", f"{name}.toml", "-o", name, *options],
        cwd=site,
        timeout=500,
        capture_output=True,
        text=True,
        env=environment | ({"NUMBA_DISABLE_JIT": "1"} if plain else {}),
    )
    assert done.returncode == 0, done.stderr
    return record(site, name)["devices"], done.stderr


def both(site, text, *options):
    """Folders of a run on the processor and of one on a device in the simulator."""
    on_processor, on_device = site / "on_processor", site / "on_device"
    for folder in (on_processor, on_device):
        shutil.rmtree(folder, ignore_errors=True)
    command(site, on_processor.name, text, *options, plain=True)
    devices, _ = command(site, on_device.name, text, *options, "--device", "cuda", simulator=True, plain=True)
    assert [entry["device"].split(":")[0] for entry in devices] == ["cuda"]
    return on_processor, on_device


def require_same_end(folder, others):
    """Fail unless the last frames of runs agree to rounding; returns the largest speed [m s-1]."""
    first, *rest = [read_frame(sorted(path.glob("frame_*.h5"))[-1]).particles for path in (folder, *others)]
    for other in rest:
        for quantity in ("position", "velocity", "mass"):
            a, b = (getattr(particles, quantity) for particles in (first, other))
            assert np.abs(a - b).max() <= 1e-9 * max(np.abs(a - a.mean(axis=0)).max(), 1.0)
    return float(np.abs(first.velocity).max())


@pytest.mark.thorough
@NEEDS_SIMULATOR
def test_a_run_goes_on_between_processor_and_device(few):
    """A whole run on a device, and one that changes the device at a frame, are those of the processor to rounding."""
    text = slide(8.0, 0.1, 0.05).replace("thickness = 12.0", "thickness = 9.0")
    names = ["processor", "device", "both"]
    assert [entry["device"] for entry in command(few, names[0], text)[0]] == ["cpu"]
    devices, printed = command(few, names[1], text, "--device", "cuda", simulator=True)
    assert [entry["device"].split(":")[0] for entry in devices] == ["cuda"] and "steps: cuda" in printed
    command(few, names[2], text)
    written = record(few, names[2])
    frames = sorted((few / names[2]).glob("frame_*.h5"))
    frames[-1].unlink()  # as if the run had been stopped before its last frame
    (few / names[2] / "run.json").write_text(json.dumps(written | {"state": "interrupted", "frames": len(frames) - 1}))
    devices, printed = command(few, names[2], text, "--resume", "--device", "cuda", simulator=True)
    assert [entry["device"].split(":")[0] for entry in devices] == ["cpu", "cuda"]
    assert devices[1]["from"] == pytest.approx(0.05) and "the run began on another device" in printed
    processor, *others = [few / name for name in names]
    require_same_end(processor, others)


@pytest.mark.thorough
@NEEDS_SIMULATOR
def test_a_law_of_the_user_is_computed_on_a_device(few):
    (few / "mine.py").write_text(LAW)
    text = slide(**COARSE, head='solver = "columns"', friction='law = "mine.py:Mine"\nmu = 0.3\nxi = 10')
    text = text[: text.index("[material]")] + text[text.index("[friction]") :]
    processor, device = both(few, text, "--law", "mine.py")
    assert require_same_end(processor, [device]) > 1.0


@pytest.mark.thorough
@NEEDS_SIMULATOR
def test_stages_and_rasters_of_a_device_are_those_of_the_processor(few, capsys):
    """Columns, then points, with rasters; the digest of the results is stored."""
    text = slide(**COARSE, head="", more="particles_per_cell = 4").replace("[output]", "[output]\nrasters = true")
    text += '[[stage]]\nsolver = "columns"\nuntil = {time = 0.1}\n[[stage]]\nsolver = "points"\n'
    processor, device = both(few, text)
    assert require_same_end(processor, [device]) > 1.0
    paths = sorted(processor.rglob("on_processor_*.tif"))
    assert len(paths) >= 3
    for path in paths:
        other = device / path.parent.relative_to(processor) / path.name.replace("processor", "device")
        with rasterio.open(path) as one, rasterio.open(other) as two:
            expected, found = one.read(masked=True), two.read(masked=True)
        assert expected.count() and np.array_equal(expected.mask, found.mask)
        np.testing.assert_allclose(found.filled(0.0), expected.filled(0.0), rtol=1e-5, atol=1e-6)
    assert main(["info", "--json", str(device)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["result_digest"]) == 64 and facts["frames_are"] == AS_WRITTEN
    assert facts["result_digest"] == record(few, device.name)["result_digest"]
