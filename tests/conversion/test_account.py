"""What a user is told of a conversion."""

import numpy as np
from converting import columns_on, doubled, slope, terrain_of

from mpmgis.conversion.columns_to_points import columns_to_points
from mpmgis.conversion.conversion_account import account_of_columns, account_of_points
from mpmgis.conversion.conversion_options import ColumnOptions, PointOptions
from mpmgis.conversion.points_to_columns import points_to_columns

GROUND = terrain_of(slope())


def told(frame, options):
    return "\n".join(account_of_points(columns_to_points(frame, GROUND, options).report, options))


def test_gaps_are_reported_until_a_cell_is_given():
    frame = columns_on(GROUND, 2.0)
    assert "up to 1.25 m apart" in told(frame, PointOptions()) and "--cell" in told(frame, PointOptions())
    text = told(frame, PointOptions(cell=0.5))
    assert "up to 25 stacks" in text and "curtains" not in text


def test_overlap_is_reported_with_its_fix_and_then_with_what_was_done():
    frame = doubled(columns_on(GROUND, 1.0))
    assert "too high in places (--relevel" in told(frame, PointOptions(cell=1.0))
    assert "were raised to the height of their mass" in told(frame, PointOptions(cell=1.0, relevel=True))


def test_thin_sampling_and_another_bed_are_reported():
    steep, options = terrain_of(slope(2.0)), PointOptions(cell=1.0)
    report = columns_to_points(columns_on(steep, 0.1), steep, options).report
    assert "fewer than 4 points in the median cell" in "\n".join(account_of_points(report, options))
    frame = columns_on(GROUND, 2.0)
    frame.particles.position[:, 2] += 0.25
    assert "beds of the columns are up to 0.25 m off" in told(frame, PointOptions())


def test_columns_off_the_ground_are_reported_with_their_mass():
    frame = columns_on(terrain_of(slope(), length=200), 2.0, box=(80.0, 120.0, 20.0, 50.0))
    assert "have no ground under them and are left out: 1.56e+06 kg (50 % of the mass)" in told(frame, PointOptions())


def test_lost_columns_of_the_printed_algorithm_are_reported():
    frame = columns_on(GROUND, lambda x, y: np.where(x < 40, 0.2, 2.0))
    text = told(frame, PointOptions.as_printed(0.2))
    assert "Eq (2) is 0/0" in text and "384 columns are lost" in text and "(9.1 % of the mass)" in text


def test_the_way_back_is_reported():
    points = columns_to_points(columns_on(GROUND, 2.0), GROUND, PointOptions(cell=1.0)).frame
    for options, word in (
        (ColumnOptions(), "of the points of one parent"),
        (ColumnOptions(), "the bed takes the motion across it"),
        (ColumnOptions(cell=5.0), "cells of 5 m were not used"),
        (ColumnOptions(by="cell", cell=5.0), "of a cell of 25 m2"),
    ):
        assert word in "\n".join(account_of_columns(points_to_columns(points, GROUND, options).report, options))
