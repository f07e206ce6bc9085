from __future__ import annotations

import dataclasses
import hashlib
import json
import os

import numpy as np
import pytest

from mrta_falsify.campaigns.store import RECORDS, SETTINGS, Store, StoreError, read_campaign
from mrta_falsify.core.candidate import Candidate, Dimension, SearchSpace
from mrta_falsify.core.errors import InputError, InputNote, PlaceError
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.testing.records import changed, trial_record
from tests.campaigns.standin import settings


def _record(number: int, *, rho: float = 1.0) -> TrialRecord:
    verdict = Verdict(spec="no_deadlock", robustness=rho, violated=rho < 0.0, evidence={"a": [1]})
    candidate = Candidate(number=number, u=np.array([0.1, 1.0 / 3.0]), seed=number)
    return trial_record(number, candidate=candidate, verdicts=(verdict,), score=rho)


def test_what_is_added_is_read_back_bit_by_bit(tmp_path):
    with Store.create(tmp_path / "c", settings()) as store:
        store.add(_record(1, rho=-0.1))
        store.add(_record(0))
    campaign = read_campaign(tmp_path / "c")
    assert [record.id for record in campaign.records] == ["0000", "0001"]
    np.testing.assert_array_equal(campaign.records[1].candidate.u, _record(1).candidate.u)
    assert campaign.records[1].verdicts == _record(1, rho=-0.1).verdicts
    assert campaign.settings == settings()


def test_a_torn_last_line_is_cut_off_and_all_before_it_is_kept(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        store.add(_record(0))
        store.add(_record(1))
    log = tmp_path / RECORDS
    whole = log.read_bytes()
    for cut in (len(whole) - 1, len(whole) - 40, len(whole.splitlines(keepends=True)[0]) + 3):
        log.write_bytes(whole[:cut])
        with Store.resume(tmp_path) as store:
            assert sorted(store.finished) == [0]
            store.add(_record(1))
        assert log.read_bytes() == whole


def test_a_pipe_in_place_of_the_log_is_refused(tmp_path):
    Store.create(tmp_path, settings()).close()
    (tmp_path / RECORDS).unlink(missing_ok=True)
    os.mkfifo(tmp_path / RECORDS)
    for read in (read_campaign, Store.resume):
        with pytest.raises(InputError, match=r"records\.jsonl: is a pipe"):
            read(tmp_path)


def test_damage_in_the_middle_is_named_and_nothing_is_touched(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        for number in range(3):
            store.add(_record(number))
    log = tmp_path / RECORDS
    damaged = log.read_bytes().replace(b'"number":1', b'"number":9')
    log.write_bytes(damaged)
    with pytest.raises(StoreError, match=r"records\.jsonl:2: this record is damaged"):
        Store.resume(tmp_path)
    assert log.read_bytes() == damaged
    with pytest.raises(StoreError, match="damaged"):
        read_campaign(tmp_path)


def test_a_directory_has_one_owner_at_a_time(tmp_path):
    with Store.create(tmp_path, settings()):
        with pytest.raises(StoreError, match="in use by process"):
            Store.resume(tmp_path)
        read_campaign(tmp_path)  # readers need no lock
    Store.resume(tmp_path).close()


def test_a_new_campaign_wants_an_empty_directory(tmp_path):
    Store.create(tmp_path / "a", settings()).close()
    with pytest.raises(StoreError, match="holds a campaign already"):
        Store.create(tmp_path / "a", settings())
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes.txt").write_text("mine")
    with pytest.raises(StoreError, match=r"not empty \(it holds notes.txt\)"):
        Store.create(tmp_path / "b", settings())


def test_a_directory_of_another_version_is_refused(tmp_path):
    Store.create(tmp_path, settings()).close()
    path = tmp_path / SETTINGS
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 99}))
    with pytest.raises(StoreError, match="format version 99"):
        Store.resume(tmp_path)
    with pytest.raises(StoreError, match="not a campaign directory"):
        read_campaign(tmp_path.parent)


def test_a_full_disc_leaves_the_log_as_it_was(tmp_path, monkeypatch):
    with Store.create(tmp_path, settings()) as store:
        store.add(_record(0))
        before = (tmp_path / RECORDS).read_bytes()

        def full(handle, data):
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr("mrta_falsify.core.durable.os.write", full)
            with pytest.raises(PlaceError, match=r"No space left on device; .* --resume .*0001"):
                store.add(_record(1))
        assert (tmp_path / RECORDS).read_bytes() == before
        store.add(_record(1))
    assert len(read_campaign(tmp_path).records) == 2


def test_a_campaign_becomes_a_table_in_one_call(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        store.add(_record(0, rho=-2.0))
        frame = store.campaign().frame()
    assert frame.loc[0, "rho.no_deadlock"] == -2.0
    assert bool(frame.loc[0, "failed"])


def test_each_dimension_is_a_column_with_values_as_a_person_reads_them(tmp_path):
    space = SearchSpace(
        (
            Dimension(name="trolley_2.active", kind="choice", options=("True", "False")),
            Dimension(name="bed_1.position.0", kind="point", low=0.0, high=9.0),
        )
    )
    with Store.create(tmp_path, dataclasses.replace(settings(), space=space)) as store:
        store.add(changed(_record(0), values=(0.0, 4.5)))
        frame = read_campaign(tmp_path).frame()
    assert frame["trolley_2.active"].tolist() == [True]
    assert frame["bed_1.position.0"].tolist() == [4.5]


def test_an_unknown_trial_is_refused_with_what_there_is(tmp_path):
    with Store.create(tmp_path, settings()) as store:
        store.add(_record(0))
        store.add(_record(7))
        campaign = store.campaign()
    assert campaign.record("7").number == 7
    for wrong in ("8", "-1", "x", "7 "):
        with pytest.raises(StoreError, match="trials 0000 to 0007"):
            campaign.record(wrong)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('"status":"judged"', '"status":"fine"', "status is 'fine'"),
        ('"violated":false', '"violated":true', "verdicts"),
        ('"score":1.0', '"score":1.0,"score":2.0', "score is there twice"),
        ('"score":1.0', '"score":' + "9" * 400, "must be finite"),
        ('{"a":[1]}', '{"cycle":[{"robot":3}]}', "evidence"),
        ('{"candidate"', "[" * 2000 + '{"candidate"', "is not valid JSON"),
    ],
)
def test_a_whole_record_of_other_content_is_left_out_by_name_and_stops_resume(
    tmp_path, before, after, words
):
    with Store.create(tmp_path, settings()) as store:
        for number in range(3):
            store.add(_record(number))
    log = tmp_path / RECORDS
    lines = log.read_text().splitlines()
    text = lines[1].split("\t", 1)[1].replace(before, after, 1)
    lines[1] = f"{hashlib.sha256(text.encode()).hexdigest()[:16]}\t{text}"
    log.write_text("\n".join(lines) + "\n")
    with pytest.warns(InputNote, match=rf"records\.jsonl:2.*{words}.*left out"):
        campaign = read_campaign(tmp_path)
    assert [record.number for record in campaign.records] == [0, 2]
    with pytest.raises(StoreError, match=r"records\.jsonl:2"):
        Store.resume(tmp_path)
