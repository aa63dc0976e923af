"""Numbers, units and places as a report prints them."""

import pytest

from mpmgis.results.reports.printed_numbers import printed, printed_line, printed_place, printed_unit


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


def test_lines_have_no_exponents():
    line = "mass: 2.48891e+08 kg, error 0.0e+00; 1.547e+12 J lost; closes to 2e-05; area 2.441e+05 m2, digest 12e45"
    assert printed_line(line).replace("\u202f", " ") == (
        "mass: 249 000 000 kg, error 0; 1.55 × 10¹² J lost; closes to 0.0000200; area 244 000 m², digest 12e45"
    )


def test_places_are_readable():
    assert printed_place(312742.5, 4008692.0).replace("\u202f", " ") == "E 312 742.5 N 4 008 692.0"
