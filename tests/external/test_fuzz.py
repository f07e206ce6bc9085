"""Garbled messages in both directions: each ends in a sentence; the benchmark takes 10,000."""

from __future__ import annotations

import sys

import pytest

from tests.external.garbled import fuzz

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are kept on Linux")


@pytest.mark.parametrize(
    ("part", "messages"),
    [
        ("answers read", 250),
        ("Python client in process", 150),
        pytest.param("episodes told garbled answers", 60, marks=pytest.mark.long),
        pytest.param("stacks that send them", 8, marks=pytest.mark.long),
        pytest.param("Python client", 6, marks=pytest.mark.long),
        pytest.param("C++ client", 40, marks=pytest.mark.long),
    ],
)
def test_a_garbled_message_ends_in_a_sentence(part, messages, tmp_path):
    tally = fuzz.PARTS[part][1](messages, 1, tmp_path)
    if part == "C++ client" and not tally.messages:
        pytest.skip("there is no C++ compiler")
    assert tally.messages >= messages
    assert tally.defects == []
    assert sum(tally.outcomes[what] for what in ("refused", "answer")) > 0
    assert tally.outcomes["refused before the last"] == 0  # what is allowed is taken
