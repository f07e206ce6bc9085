"""A campaign live in the browser: what it tells, whom it refuses, what it costs."""

from __future__ import annotations

import dataclasses
import gc
import http.client
import json
import threading
import tracemalloc

import pytest
from click.testing import CliRunner

from mrta_falsify.campaigns.store import RECORDS, Store
from mrta_falsify.cli import main
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.verbs.serve import MOST_POINTS, LiveServer
from tests import browser
from tests.reports.planted import stalled_campaign


@pytest.fixture(scope="module")
def one_failure(stalled, tmp_path_factory):
    """A campaign with one failure; tests add trials to copies of its record."""
    return stalled_campaign(tmp_path_factory.mktemp("served") / "campaign", stalled)


@pytest.fixture
def served(one_failure, tmp_path):
    directory = tmp_path / "campaign"
    with (
        Store.create(directory, one_failure.settings) as store,
        LiveServer(directory) as server,
    ):
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        yield server, store, one_failure.records[0]
        server.shutdown()
        thread.join()


def asked(server, path="/summary.json", method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=300)
    host = headers.pop("Host", f"127.0.0.1:{server.server_port}")
    connection.putrequest(method, path, skip_host=True)
    for name, value in {"Host": host, **headers}.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def numbered(record, number, *, passes=False):
    candidate = dataclasses.replace(record.candidate, number=number)
    if not passes:
        return dataclasses.replace(record, candidate=candidate)
    holds = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
    return dataclasses.replace(record, candidate=candidate, verdicts=(holds,), signature="")


def test_the_summary_follows_the_campaign(served):
    server, store, record = served
    assert json.loads(asked(server)[1])["judged"] == 0
    store.add(numbered(record, 0))
    store.add(numbered(record, 1, passes=True))
    data = json.loads(asked(server)[1])
    assert (data["judged"], data["failed"], data["deadlocks"]) == (2, 1, 1)
    assert data["kinds"] == {"deadlock": 0, "stuck": 1, "shut": 0}
    assert "process" in data["running"]
    assert "robot1 is stuck" in data["latest"]
    assert data["modes"][0][0] == 1
    assert data["points"][-1] == [2, 1, 0]  # judged, failed, of these deadlocks


def test_a_torn_last_line_is_read_once_it_is_whole(served):
    server, store, record = served
    store.add(numbered(record, 0))
    path = store.directory / RECORDS
    line = path.read_bytes()
    with path.open("ab") as log:
        log.write(line[:100])
    assert json.loads(asked(server)[1])["trials"] == 1
    path.write_bytes(line)  # as the next owner cuts it off
    store.add(numbered(record, 1))
    assert json.loads(asked(server)[1])["trials"] == 2


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:8377"},
        {"Host": "127.0.0.1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ],
)
def test_other_hosts_and_origins_are_refused(served, headers):
    server, _, _ = served
    for path in ("/", "/summary.json", "/report"):
        status, body = asked(server, path, **headers)
        assert status == 403
        assert b"campaign" not in body


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS"])
def test_nothing_but_get_is_answered(served, method):
    assert asked(served[0], method=method)[0] == 501


@pytest.mark.parametrize("path", ["/../campaign.json", "/campaign.json", "/%2e%2e/lock"])
def test_no_file_can_be_asked_for(served, path):
    assert asked(served[0], path)[0] == 404


def test_only_this_machine_can_connect(served):
    assert served[0].server_address[0] == "127.0.0.1"


def test_the_summary_of_a_thousand_trials_is_as_small_as_that_of_a_hundred(served):
    server, store, record = served
    sizes, kept = {}, {}
    tracemalloc.start()
    for number in range(1000):
        store.add(numbered(record, number, passes=number % 3 > 0))
        store.finished.clear()  # the store's own memory is not the server's
        if number % 10 == 9:
            body = asked(server)[1]
        if number in (399, 999):
            gc.collect()
            sizes[number], kept[number] = len(body), tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert json.loads(body)["failed"] == 334
    assert len(json.loads(body)["points"]) <= MOST_POINTS + 2
    assert sizes[999] < 2 * sizes[399] < 20_000
    assert kept[999] - kept[399] < 200_000  # bytes


def test_a_port_in_use_and_a_directory_that_is_no_campaign_are_bad_input(served, tmp_path):
    server, store, _ = served
    with pytest.raises(InputError, match="cannot be used"):
        LiveServer(store.directory, server.server_port)
    result = CliRunner().invoke(main, ["serve", str(tmp_path / "absent")])
    assert result.exit_code == 2
    assert "is not a campaign directory" in result.stderr


def test_one_lichtblick_may_read_runs_in_parts_and_nothing_else(served, monkeypatch):
    server, _, _ = served
    monkeypatch.setattr(server, "run_file", lambda id: f"run of {id}".encode())
    assert asked(server, "/runs/0000.mcap")[0] == 404  # unless it is named
    server.lichtblick = "http://localhost:8080"
    viewer = {"Origin": "http://localhost:8080"}
    assert asked(server, "/runs/0000.mcap", **viewer) == (200, b"run of 0000")
    assert asked(server, "/runs/0000.mcap", Range="bytes=7-9", **viewer) == (206, b"000")
    assert asked(server, "/runs/0000.mcap", Range="bytes=7-", **viewer) == (206, b"0000")
    assert asked(server, "/runs/0000.mcap", Range="bytes=70-", **viewer)[0] == 416
    assert asked(server, "/runs/0000.mcap", Origin="http://evil.example")[0] == 403
    assert asked(server, "/summary.json", **viewer)[0] == 403
    assert asked(server, "/runs/../lock.mcap", **viewer)[0] == 403


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 390])
def test_the_live_page_follows_a_campaign(served, width):
    if browser.find() is None:
        pytest.skip("no Chromium on this machine")
    server, store, record = served
    with browser.browser() as running:
        running.open_address(server.address, width=width, mobile=width < 500)
        head = "document.getElementById('headline').textContent"
        running.wait(f"{head}.startsWith('0 trials')")
        store.add(numbered(record, 0))
        running.wait(f"{head}.startsWith('1 trial: 0 deadlocks, 1 stuck')")
        assert running.value("document.documentElement.scrollWidth") <= width
        assert running.errors == []


def test_the_full_report_is_written_from_the_trials_so_far(served):
    server, store, record = served
    store.add(numbered(record, 0, passes=True))
    status, body = asked(server, "/report")
    assert status == 200
    assert b"None of 1 trials violates a specification" in body
