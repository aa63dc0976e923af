"""`--trust`: what scenes, frames and files of others lead to is read where the user says so, and only then."""

import os
import shutil

import h5py
import numpy as np
import pyproj
import pytest
from affine import Affine

import mpmgis
from mpmgis.commands.shell.main import main
from mpmgis.commands.verb import all_verbs
from mpmgis.frames.frame_files import read_frame, write_frame
from mpmgis.frames.particles import Frame, Particles
from mpmgis.laws.quantities import Quantity
from mpmgis.system.errors import FormatError, InputError
from mpmgis.system.file_references import require_local
from mpmgis.system.parallel import frame_pool
from mpmgis.system.trusted_files import is_trusted, trusting
from mpmgis.terrain.grid import Grid
from mpmgis.terrain.raster_output import write_geotiff
from mpmgis.terrain.vector_table import read_table

VRT = """<VRTDataset rasterXSize="20" rasterYSize="20"><GeoTransform>4e5, 10, 0, 5.1002e6, 0, -10</GeoTransform>
<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">dtm.tif</SourceFilename>
<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"""
COUNT = 200


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A frame of columns with its DTM, and the same frame as others may write it."""
    grid = Grid(pyproj.CRS(32632), Affine(10, 0, 4e5, 0, -10, 5.1002e6), (20, 20))
    band = Quantity("elevation", "m", "terrain elevation", "float32"), np.full((20, 20), 50.0)
    write_geotiff(tmp_path / "dtm.tif", grid, [band], {})
    random = np.random.default_rng(1)
    position = np.column_stack([random.uniform(20, 180, (COUNT, 2)), np.full(COUNT, 50.0)])
    ones = np.ones(COUNT)
    particles = Particles(position, np.ones((COUNT, 3)), 1e3 * ones, ones, area=ones, thickness=ones)
    frame = Frame(particles, dimension=2, crs=grid.crs, origin=(4e5, 5.1e6, 0.0), dem="dtm.tif")
    write_frame(tmp_path / "frame_000000.h5", frame)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def with_mass_elsewhere(site, kind):
    """The frame with its mass in mass.h5 (or mass.bin), by way of a link, a virtual dataset or external storage."""
    path = site / "led" / "frame_000000.h5"
    path.parent.mkdir(exist_ok=True)
    shutil.copy(site / "frame_000000.h5", path)
    shutil.copy(site / "dtm.tif", path.parent)
    with h5py.File(path, "r+") as file, h5py.File(path.with_name("mass.h5"), "w") as other:
        group = file["particles"]
        other["mass"] = mass = group["mass"][()]
        del group["mass"]
        if kind == "link":
            group["mass"] = h5py.ExternalLink("mass.h5", "mass")
        elif kind == "virtual":
            layout = h5py.VirtualLayout((COUNT,), "f8")
            layout[:] = h5py.VirtualSource("mass.h5", "mass", (COUNT,))
            group.create_virtual_dataset("mass", layout)
        else:
            mass.tofile(path.with_name("mass.bin"))
            group.create_dataset("mass", (COUNT,), "f8", external=[(str(path.with_name("mass.bin")), 0, 8 * COUNT)])
    return path


def test_nothing_is_trusted_without_the_option():
    assert not is_trusted()
    with trusting(), pytest.raises(ZeroDivisionError):
        assert is_trusted()
        with trusting(False):
            assert not is_trusted()
        raise ZeroDivisionError
    assert not is_trusted()


@pytest.mark.parametrize("kind", ["link", "virtual", "storage"])
def test_frames_of_hdf5_lead_to_other_files_only_where_they_are_trusted(site, kind):
    path = with_mass_elsewhere(site, kind)
    with pytest.raises(FormatError, match="expected values in the file itself"):
        read_frame(path)
    with trusting():
        assert np.array_equal(read_frame(path).particles.mass, np.full(COUNT, 1e3))
    with pytest.raises(FormatError, match="expected values in the file itself"):
        read_frame(path)


@pytest.mark.parametrize("kind", ["link", "virtual", "storage"])
@pytest.mark.parametrize("instead", ["nothing", "a pipe"])
def test_what_trusted_files_lead_to_must_be_there_and_a_file(site, kind, instead):
    path = with_mass_elsewhere(site, kind)
    other = path.with_name("mass.bin" if kind == "storage" else "mass.h5")
    other.unlink()
    if instead == "a pipe":
        if not hasattr(os, "mkfifo"):
            pytest.skip("no pipes with names here")
        os.mkfifo(other)
    says = "which is missing" if instead == "nothing" else "which is not a regular file"
    with trusting(), pytest.raises(FormatError, match=says):
        read_frame(path)


@pytest.mark.parametrize("kind", ["link", "virtual"])
def test_the_command_and_python_read_them_in_threads_too(site, kind, capsys):
    path = with_mass_elsewhere(site, kind)
    words = ["export-raster", str(path), "-o", str(site / "gis"), "--no-qgis", "--workers", "2", "-q"]
    assert main(words) == 2
    assert "expected values in the file itself" in capsys.readouterr().err
    assert main([*words, "--trust"]) == 0 and not is_trusted()
    assert (site / "gis" / "dtm.tif").exists()
    assert main(["info", str(path), "-q"]) == 2
    assert main(["info", str(path), "-q", "--trust"]) == 0
    with pytest.raises(FormatError, match="expected values in the file itself"):
        mpmgis.export_raster(path, site / "again", qgis=False)
    assert mpmgis.export_raster(path, site / "again", qgis=False, trust=True)


@pytest.mark.parametrize("kind", ["link", "virtual"])
def test_another_codes_datasets_are_read_from_other_files(site, kind, capsys):
    path = site / "theirs.hdf5"
    with h5py.File(path, "w") as file, h5py.File(site / "places.h5", "w") as other:
        other["position"] = np.random.default_rng(2).uniform(0, 9, (COUNT, 3))
        if kind == "link":
            file["position"] = h5py.ExternalLink("places.h5", "position")
        else:
            layout = h5py.VirtualLayout((COUNT, 3), "f8")
            layout[:] = h5py.VirtualSource("places.h5", "position", (COUNT, 3))
            file.create_virtual_dataset("position", layout)
        file["velocity"], file["mass"] = np.ones((COUNT, 3)), np.ones(COUNT)
    words = ["info", str(path), "--reader", "hdf5", "--density", "1000", "-q"]
    assert main(words) == 2
    assert "are not read without --trust" in capsys.readouterr().err
    assert main([*words, "--trust"]) == 0
    assert f"{COUNT}" in capsys.readouterr().out


def test_rasters_behind_another_suffix_and_names_in_the_network(site):
    (site / "hidden.tif").write_text(VRT)
    for refuse in (require_local, lambda path: require_local(path, "scene.toml")):
        with pytest.raises(FormatError, match="give --trust"):
            refuse(site / "hidden.tif")
        with trusting():
            refuse(site / "hidden.tif")
    with pytest.raises(FormatError, match="is in the network"):
        require_local("/vsicurl/http://127.0.0.1:9/a.tif", "scene.toml")
    with trusting():
        require_local("/vsicurl/http://127.0.0.1:9/a.tif", "scene.toml")


def test_a_scene_may_name_what_the_user_trusts(site, capsys):
    """The terrain behind another suffix: past the refusal, the DTM is read and the release is missed."""
    (site / "hidden.tif").write_text(VRT)
    (site / "scene.toml").write_text(
        '[terrain]\ndem = "hidden.tif"\ncrs = "EPSG:32632"\n'
        '[release]\nsource = "no.shp"\nthickness = 1\ndensity = 1000\n'
        '[friction]\nlaw = "Coulomb"\nmu = 0.3\n[output]\nend_time = 1\nframe_interval = 1\n'
    )
    assert main(["run", "scene.toml", "-q"]) == 2
    assert "give --trust" in capsys.readouterr().err
    assert main(["run", "scene.toml", "-q", "--trust"]) == 2
    assert "no.shp: no such file" in capsys.readouterr().err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_pipes_are_refused_whoever_is_trusted(site):
    os.mkfifo(site / "dtm.fifo")
    with trusting():
        for refuse in (require_local, lambda path: require_local(path, "scene.toml"), read_table):
            with pytest.raises(FormatError, match="device or pipe"):
                refuse(site / "dtm.fifo")


def test_trust_does_not_go_to_a_cluster(site):
    with trusting(), pytest.raises(InputError, match="not to a Dask cluster"), frame_pool(1, "tcp://127.0.0.1:9"):
        pass


@pytest.mark.parametrize("verb", [verb.name for verb in all_verbs() if not verb.trust])
def test_verbs_that_would_not_heed_it_do_not_take_it(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--trust"])
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    assert "--trust" not in capsys.readouterr().out
