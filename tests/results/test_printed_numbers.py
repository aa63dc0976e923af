"""Numbers, units and places as a report prints them."""

import pytest

from mpmgis.results.reports.printed_numbers import printed, printed_place, printed_unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((0.0, "0"), (12.654, "12.7"), (2675.3, "2680"), (99.96, "100"), (120.0, "120"), (-0.25, "-0.250")),
        *((2.4889e8, "249 000 000"), (1.2445e5, "124 000"), (0.0000123456, "0.0000123"), (float("inf"), "inf")),
    ],
)
def test_three_digits_without_an_exponent(value, text):
    assert printed(value).replace("\u202f", " ") == text


@pytest.mark.parametrize(
    ("unit", "text"),
    [("kg m-3", "kg/m³"), ("m3", "m³"), ("m s-2", "m/s²"), ("kN m", "kN m"), ("degrees", "degrees"), ("m/s", "m/s")],
)
def test_units_as_in_books(unit, text):
    assert printed_unit(unit) == text


def test_places_are_readable():
    assert printed_place(312742.5, 4008692.0).replace("\u202f", " ") == "E 312 742.5 N 4 008 692.0"
