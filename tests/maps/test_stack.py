"""Stacks have the values of the steps, one band per step, by relative path."""

import shutil

import numpy as np
import pytest
import qgis_run
import rasterio
from pyproj import CRS

from mpmgis.maps.qgis.qgis_files import write_stacks


@pytest.mark.parametrize("crs", [CRS.from_epsg(32632), CRS.from_epsg(31468), CRS.from_epsg(2154), None])
def test_bands_are_the_steps_also_after_moving_the_folder(tmp_path, crs):
    here = tmp_path / "here"
    here.mkdir()
    run = qgis_run.make_run(here, crs, times=[0, 0.25, 0.5])
    write_stacks(run)
    there = shutil.move(here, tmp_path / "there")
    for band, quantity in enumerate(run.step_bands, start=1):
        with rasterio.open(there / run.stack_file(quantity)) as stack:
            assert stack.count == 3
            assert stack.descriptions[1] == f"{quantity.band} at t = 0.25 s"
            assert stack.units[0] == quantity.unit
            assert stack.nodata == -9999
            assert stack.transform == run.grid.transform
            if crs is not None:
                assert CRS.from_user_input(stack.crs) == crs
            for k, file in enumerate(run.step_files):
                with rasterio.open(there / file) as step:
                    assert np.array_equal(stack.read(k + 1), step.read(band))
