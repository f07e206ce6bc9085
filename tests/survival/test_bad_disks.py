"""Full disks, removed folders, damaged logs and power cuts: nothing is lost, nothing is made up."""

from __future__ import annotations

import os
import shutil

import pytest

from mrta_falsify.campaigns.journal import append_row, read_rows
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import RECORDS, SETTINGS, Store, StoreError, read_campaign
from mrta_falsify.commands.campaign import open_store, run_store
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.durable import staged, write_atomically
from mrta_falsify.core.errors import PlaceError
from mrta_falsify.core.trace import read_trace
from tests.survival.disks import PowerCuts, read_tree, small_disk, write_tree
from tests.survival.kept_trials import kept_settings

TRIALS = 4
POINTS = 30  # sizes of the disk
VOLATILE = {"lock"}


def search(root, *, budget=TRIALS, on_record=lambda record, is_new: None, executor=None):
    """Begin a campaign at ``root``, or run what is missing of it."""
    with open_store(root, kept_settings(str(root))) as store:
        limits = Limits(budget=budget)
        run_store(store, limits, executor or Choice("serial"), on_record=on_record)


def kept(root):
    """Give what is stored: settings, records by number, and files of trials."""
    files = {name: data for name, data in read_tree(root).items() if name.startswith("trials/")}
    return [codec.encode(record) for record in read_campaign(root).records], files


def check_sound(root, whole):
    """Make sure that each record that stands is that of an undisturbed campaign, with its files."""
    records = read_campaign(root).records
    for record in records:
        assert codec.encode(record) == whole[0][record.number]
        assert read_trace(root / record.trace_file).digest == record.trace_digest
    return {record.number for record in records}


@pytest.fixture(autouse=True)
def unsynced(monkeypatch):
    """Do not wait for the disk of this machine."""
    monkeypatch.setattr(os, "fsync", lambda handle: None)


@pytest.fixture
def whole(tmp_path):
    """What an undisturbed campaign stores in ``tmp_path / "c"``, which is empty again."""
    root = tmp_path / "c"
    search(root)
    found = kept(root)
    assert len(found[0]) == TRIALS
    shutil.rmtree(root)
    return found


def test_a_full_disk_stops_the_campaign_and_leaves_no_error_of_a_trial(tmp_path, whole):
    root = tmp_path / "c"
    search(root)
    size = sum(len(data or b"") for data in read_tree(root).values())
    stopped = set()
    for point in range(POINTS):
        shutil.rmtree(root)
        with pytest.MonkeyPatch.context() as patch:
            small_disk(patch, root, round(size * point / POINTS))
            with pytest.raises(PlaceError, match="No space left on device; make room") as full:
                search(root)
        assert str(root) in str(full.value)
        assert not [name for name in read_tree(root) if name.endswith(".part")]
        if (root / SETTINGS).exists():
            stopped.add(len(check_sound(root, whole)))
            assert "--resume" in str(full.value) or not (root / RECORDS).exists()
        search(root)
        assert kept(root) == whole
    assert len(stopped) == TRIALS  # in the first trial, between others, in the last


def test_a_power_cut_at_any_write_loses_no_record_and_leaves_none_without_its_files(
    tmp_path, whole
):
    root = tmp_path / "c"
    with pytest.MonkeyPatch.context() as patch:
        cuts = PowerCuts(patch, root)
        search(root, on_record=lambda record, is_new: cuts.acknowledged.add(record.number))
    assert kept(root) == whole
    tried = {}
    for moment in cuts.moments:
        for how, tree in moment.trees.items():
            tried[codec.digest([sorted(tree), list(map(str, tree.values()))])] = moment, how, tree
    assert len(tried) > 20 * TRIALS
    for moment, how, tree in tried.values():
        write_tree(tree, root)
        if (root / SETTINGS).exists():
            there = check_sound(root, whole)
            assert moment.acknowledged <= there, f"{how} before {moment.step}"
        else:
            assert not moment.acknowledged
        search(root)
        assert kept(root) == whole, f"{how} before {moment.step}"


@pytest.mark.parametrize("again", [False, True])
def test_a_directory_that_is_removed_ends_the_campaign(tmp_path, again):
    root = tmp_path / "c"

    def remove(record, is_new):
        if record.number == 1:
            shutil.rmtree(root)
            if again:
                root.mkdir()

    with pytest.raises(PlaceError, match="was removed"):
        search(root, on_record=remove)
    assert not root.exists() or not list(root.iterdir())


def test_a_directory_that_is_removed_behind_the_last_trial_is_noticed(tmp_path):
    root = tmp_path / "c"
    with pytest.raises(PlaceError, match="was removed"):
        search(
            root,
            on_record=lambda record, is_new: record.number < TRIALS - 1 or shutil.rmtree(root),
        )


@pytest.mark.parametrize("left", [0.0, 0.3, 0.5, 0.9])
def test_nothing_is_added_behind_a_cut(tmp_path, whole, left):
    root = tmp_path / "c"

    def cut(record, is_new):
        if is_new and record.number == 1:
            data = (root / RECORDS).read_bytes()
            (root / RECORDS).write_bytes(data[: int(left * len(data))])

    with pytest.raises(StoreError, match="somebody else has changed it"):
        search(root, on_record=cut)
    check_sound(root, whole)
    search(root)
    assert kept(root) == whole


def test_nothing_is_added_behind_damage_of_the_same_length(tmp_path):
    root = tmp_path / "c"

    def damage(record, is_new):
        if record.number == 1:
            with (root / RECORDS).open("r+b") as log:
                log.seek(40)
                log.write(b"#")

    with pytest.raises(StoreError, match=r"records.jsonl:1: this record is damaged"):
        search(root, on_record=damage)
    assert (root / RECORDS).read_bytes().count(b"\n") == 2


def test_a_second_owner_is_refused_though_the_lock_was_deleted(tmp_path):
    with Store.create(tmp_path / "c", kept_settings(str(tmp_path / "c"))):
        (tmp_path / "c" / "lock").unlink()
        with Store.resume(tmp_path / "c") as second, pytest.raises(StoreError, match="in use by"):
            second.begin()


def test_zeros_at_the_end_of_a_log_are_a_torn_line_and_within_it_damage(tmp_path, whole):
    root = tmp_path / "c"
    search(root, budget=2)
    with (root / RECORDS).open("ab") as log:
        log.write(b"0123\0\0\0\0\0\n")
    assert check_sound(root, whole) == {0, 1}
    search(root)
    assert kept(root) == whole
    data = (root / RECORDS).read_bytes()
    (root / RECORDS).write_bytes(data[:30] + b"\0" + data[31:])
    with pytest.raises(StoreError, match=r"records.jsonl:1: this record is damaged"):
        read_campaign(root)


# --- results and journals -------------------------------------------------------------------


def test_files_of_a_result_are_of_one_call_after_any_power_cut(tmp_path):
    folder = tmp_path / "result"
    with pytest.MonkeyPatch.context() as patch:
        cuts = PowerCuts(patch, folder)
        for version in (b"1", b"2"):
            with staged(folder, mark="mark", others=("a", "b")) as stage:
                for name in ("a", "b", "mark"):
                    write_atomically(stage / name, 100 * version)
            cuts.acknowledged.add(int(version))
    seen = set()
    for moment in cuts.moments:
        for tree in moment.trees.values():
            if "mark" in tree:
                assert tree["mark"] == tree["a"] == tree["b"]
                seen.add(tree["mark"])
    assert seen == {b"1" * 100, b"2" * 100}


def test_a_finished_run_is_in_its_journal_after_any_power_cut(tmp_path):
    path = tmp_path / "journal" / "runs.jsonl"
    with pytest.MonkeyPatch.context() as patch:
        cuts = PowerCuts(patch, path.parent)
        for number in range(4):
            append_row(path, {"run": number})
            cuts.acknowledged.add(number)
    for moment in cuts.moments:
        for tree in moment.trees.values():
            write_tree(tree, path.parent)
            there = [row["run"] for row in read_rows(path)]
            assert there == sorted(set(there))
            assert moment.acknowledged <= set(there)
            append_row(path, {"run": 9})
            assert [row["run"] for row in read_rows(path)] == [*there, 9]


# --- workers ---------------------------------------------------------------------------------


def test_what_a_worker_cannot_write_stops_the_campaign(tmp_path, whole):
    root = tmp_path / "c"
    Store.create(root, kept_settings(str(root))).close()
    (root / "trials").write_text("in the way")
    with pytest.raises(PlaceError, match=r"trials.*: cannot be written: .* --resume .*trial 0000"):
        search(root, executor=Choice("processes", {"workers": 1}))
    assert (root / RECORDS).read_bytes() == b""
    (root / "trials").unlink()
    search(root, executor=Choice("processes", {"workers": 1}))
    assert kept(root) == whole


def test_what_a_dask_worker_cannot_write_is_told(tmp_path):
    chosen = kept_settings(str(tmp_path))
    (tmp_path / "trials").write_text("in the way")
    job = {"number": 0, "u": [0.5, 0.5, 0.5]}
    pytest.importorskip("distributed")
    from mrta_falsify.campaigns import dask_executor

    try:
        told, _ = dask_executor.run_on_worker("digest", codec.encode(chosen), 1, job)
    finally:
        dask_executor.forget("digest")
    assert told.fate == "unwritable"
    assert "trials" in told.error
