"""Damaged input of all kinds is answered in one sentence, by every reader."""

from __future__ import annotations

import pytest

from tests.fuzz.readers import CASES, run_case

QUICK, LONG = 400, 20_000  # cases
PART = 50  # cases of one test


@pytest.mark.parametrize("first", range(0, QUICK, PART))
def test_damaged_input_is_answered_in_one_sentence(tmp_path, first):
    for number in range(first, first + PART):
        run_case(1, number, tmp_path)


def test_every_kind_of_case_is_run(tmp_path):
    kinds = {run_case(1, number, tmp_path) for number in range(QUICK)}
    assert kinds == {kind.__name__ for kind, _ in CASES}


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("first", range(0, LONG, 1000))
def test_much_damaged_input_is_answered_in_one_sentence(tmp_path, seed, first):
    for number in range(first, first + 1000):
        run_case(seed, number, tmp_path)
