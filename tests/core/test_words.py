from __future__ import annotations

import pytest

from mrta_falsify.core.words import clock_text, date_text, is_date, number_text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.25, "0.25"),
        (0.000123456, "0.0001235"),
        (1.0, "1"),
        (12.5, "12.5"),
        (-3.14159, "-3.142"),
        (43200.25, "43200.25"),
        (1584457021.0, "1584457021"),
        (1584457021.5, "1584457021.5"),
        (1e9, "1000000000"),
        (1e20, "1e+20"),
        (float("inf"), "inf"),
        (float("nan"), "nan"),
    ],
)
def test_numbers_can_be_told_apart_whatever_their_size(value, text):
    assert number_text(value) == text


def test_neighbouring_times_of_an_epoch_differ():
    texts = {number_text(1584457021 + 0.25 * k) for k in range(100)}
    assert len(texts) == 100


def test_dates_have_hours_of_the_day():
    assert date_text(1584457021.0) == "2020-03-17 14:57:01 UTC"
    assert clock_text(1584457021.9) == "14:57:01 UTC"
    assert is_date(1584457021.0)
    assert not is_date(3600.0)
    assert not is_date(float("inf"))
