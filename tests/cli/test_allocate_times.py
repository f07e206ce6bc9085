"""Times of a task file in seconds since 1970, as ``allocate`` prints them."""

from __future__ import annotations

import json

import pytest

TRAVEL = {"units": "s", "travel_time": [[0, 20, 35], [20, 0, 18], [35, 18, 0]]}


@pytest.mark.parametrize(("begin", "clock"), [(1584457000, " (14:57:01 UTC)"), (1000, "")])
def test_times_can_be_told_apart_and_dates_have_hours(cli, tmp_path, begin, clock):
    tasks = [{"start": 1, "end": 2, "deadline": begin + 100}]
    late = [{"start": 2, "end": 0, "deadline": begin + 20}]
    case = {"agents": [0], "tasks_stream": [{"arrival": begin, "tasks": tasks}]}
    (tmp_path / "case.json").write_text(json.dumps(case))
    (tmp_path / "times.json").write_text(json.dumps(TRAVEL))
    done = cli("allocate", "case.json", "--travel-times", "times.json")
    assert done.exit_code == 0, done.stderr
    assert f"pickup 0.0 in 1 at {begin + 21}{clock};" in done.stdout
    case["tasks_stream"][0]["tasks"] = late
    (tmp_path / "case.json").write_text(json.dumps(case))
    done = cli("allocate", "case.json", "--travel-times", "times.json")
    assert done.exit_code == 1
    assert "e+09" not in done.stdout
    assert f"by {begin + 20} s" in " ".join(done.stdout.split())
