"""Campaigns of older formats: read as they are, and brought up to date by who resumes them."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path

import pytest

from mrta_falsify.campaigns import store as stores
from mrta_falsify.campaigns.record_formats import flat_record, migrated
from mrta_falsify.campaigns.settings import FORMAT_VERSION
from mrta_falsify.campaigns.store import RECORDS, SETTINGS, Store, format_version, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.errors import PlaceError
from mrta_falsify.core.record import TrialRecord
from tests.campaigns.standin import settings
from tests.campaigns.test_runner import _run
from tests.survival.disks import PowerCuts, read_tree, small_disk, write_tree

RECORDED = Path(__file__).parent.parent / "recorded" / "campaigns"
KEPT = "records.2.jsonl"
CHOSEN = settings(seed=5, dimensions=2, jittered=4, reject_above=0.9)


def lines(path):
    return [json.loads(line.split("\t", 1)[1]) for line in path.read_text().splitlines()]


def told(campaign):
    return [codec.encode(record) for record in campaign.records]


@pytest.fixture
def begun(tmp_path):
    """A campaign of format 2, with 14 trials."""
    return Path(shutil.copytree(RECORDED / "format_2", tmp_path / "c"))


def test_a_record_of_format_2_is_told_in_its_words_still():
    campaign = read_campaign(RECORDED / "format_2")
    stored = lines(RECORDED / "format_2" / RECORDS)
    assert any(line["jittered"] for line in stored)
    assert {line["status"] for line in stored} == {"ok", "rejected"}
    for record, line in zip(campaign.records, stored, strict=True):
        assert json.loads(json.dumps(flat_record(record, rules=1))) == line


def test_what_belongs_to_no_field_is_still_named():
    (line, *_) = lines(RECORDED / "format_2" / RECORDS)
    with pytest.raises(stores.InputError, match="colour is not a known field"):
        codec.decode(TrialRecord, migrated({**line, "colour": 1}))
    with pytest.raises(stores.InputError, match=r"result\.status is 'fine'"):
        codec.decode(TrialRecord, migrated({**line, "status": "fine"}))
    for name in line:
        for value in (None, 3, "x", [], [3], {}, {"x": 1}):
            try:  # whatever it holds, it is read or refused in words
                codec.decode(TrialRecord, migrated({**line, name: value}))
            except stores.InputError:
                continue


def test_reading_writes_nothing(begun):
    before = read_tree(begun)
    read_campaign(begun)
    Store.resume(begun).close()
    assert {name: data for name, data in read_tree(begun).items() if name != "lock"} == before


def test_who_resumes_brings_the_log_up_to_date_and_keeps_the_old_one(begun, tmp_path):
    before, old = told(read_campaign(begun)), (begun / RECORDS).read_bytes()
    with Store.resume(begun) as store:
        _run(store, budget=20)
    assert format_version(begun) == FORMAT_VERSION == 3
    assert (begun / KEPT).read_bytes() == old
    assert not any("status" in line for line in lines(begun / RECORDS))
    after = read_campaign(begun)
    assert told(after)[: len(before)] == before
    with Store.create(tmp_path / "anew", CHOSEN) as store:
        _run(store, budget=20)
    anew = read_campaign(tmp_path / "anew")
    assert told(anew) == told(after)
    assert codec.encode(anew.settings) == codec.encode(after.settings)
    assert (tmp_path / "anew" / RECORDS).read_bytes() == (begun / RECORDS).read_bytes()


def test_a_torn_last_line_is_not_taken_over(begun):
    log = begun / RECORDS
    log.write_bytes(log.read_bytes()[:-20])
    old = log.read_bytes()
    with Store.resume(begun) as store:
        store.begin()
    assert len(read_campaign(begun).records) == 13
    assert old.startswith((begun / KEPT).read_bytes())


def test_a_power_cut_or_a_kill_at_any_step_loses_no_record(tmp_path, monkeypatch):
    root, again = tmp_path / "c", tmp_path / "again"
    tree = read_tree(RECORDED / "format_2")
    with monkeypatch.context() as patch:
        cuts = PowerCuts(patch, root)
        for name, data in tree.items():
            with stores.replacing(root / name) as file:
                file.write(data)
        first = len(cuts.moments)
        with Store.resume(root) as store:
            store.begin()
    whole = told(read_campaign(root))
    assert len(whole) == 14
    steps = {moment.step for moment in cuts.moments[first:]}
    assert {f"replace {RECORDS}.part", f"fsync {RECORDS}.part.part"} <= steps
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    seen = set()
    for moment in cuts.moments[first:]:
        for left in moment.trees.values():
            key = str(sorted(left.items()))
            if key in seen:
                continue
            seen.add(key)
            write_tree(left, again)
            assert told(read_campaign(again)) == whole, moment.step
            with Store.resume(again) as store:
                store.begin()
            assert told(read_campaign(again)) == whole, moment.step
            assert format_version(again) == FORMAT_VERSION
            assert lines(again / KEPT) == lines(RECORDED / "format_2" / RECORDS), moment.step
    assert len(seen) > 5


def test_a_disk_without_room_leaves_the_campaign_as_it_was(begun, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    before, whole = read_tree(begun), told(read_campaign(begun))
    size = sum(len(data or b"") for data in before.values())
    said = []
    for room in range(0, size + 400, 400):
        write_tree(before, begun)
        with pytest.MonkeyPatch.context() as patch:
            small_disk(patch, begun, size + room)
            try:
                with Store.resume(begun) as store:
                    store.begin()
            except PlaceError as error:
                said.append(str(error))
        assert told(read_campaign(begun)) == whole
        assert not [name for name in read_tree(begun) if name.endswith(".part")]
    assert len(said) > 5
    assert all("No space left on device" in text for text in said)
    assert format_version(begun) == FORMAT_VERSION


def test_where_there_are_no_links_the_old_log_is_copied(begun, monkeypatch):
    def refuse(*paths):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", refuse)
    old = (begun / RECORDS).read_bytes()
    with Store.resume(begun) as store:
        store.begin()
    assert (begun / KEPT).read_bytes() == old
    assert (begun / SETTINGS).is_file()
