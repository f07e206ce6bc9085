from __future__ import annotations

import contextlib
import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mrta_falsify.campaigns.executors import SerialExecutor
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import TRIALS, Store
from mrta_falsify.commands.campaign import run_store
from mrta_falsify.commands.campaign_settings import new_settings
from mrta_falsify.commands.workers import chosen_executor
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, HarnessError, InputError, PlaceError
from tests.campaigns.logs import files_of_trials, log_without_times
from tests.campaigns.standin import settings
from tests.quick_program import PROGRAM
from tests.survival.kept_trials import kept_settings

ROOT = Path(__file__).parents[2]
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two worker processes on loopback."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    """Address of a scheduler with two workers, each with a home and temporary folder of its own."""
    root = tmp_path_factory.mktemp("machines")
    with contextlib.ExitStack() as running:

        def start(name, *words):
            home, temporary = root / name / "home", root / name / "tmp"
            home.mkdir(parents=True)
            temporary.mkdir()
            places = {"HOME": str(home), "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *words, "--no-dashboard"],
                cwd=home,
                env={**os.environ, **places},
                stderr=subprocess.DEVNULL,
            )
            running.callback(process.wait)
            running.callback(process.terminate)

        known = root / "scheduler.json"
        start("first", "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", known)
        for name in ("second", "third"):
            one = ("--nworkers", "1", "--nthreads", "1", "--memory-limit", "0")
            start(name, "worker", "--scheduler-file", known, *one)
        with distributed.Client(scheduler_file=str(known), timeout=60.0) as client:
            client.wait_for_workers(2, timeout=60.0)
            yield client.scheduler.address
    left = [path for path in root.rglob("*") if path.is_file() and path.suffix != ".lock"]
    assert set(left) <= {known}


def run(directory, chosen, executor, **limits):
    Store.create(directory, chosen).close()
    return go_on(directory, executor, **limits)


def go_on(directory, executor, **limits):
    with Store.resume(directory) as store:
        try:
            executor.open(store.settings)
            run_campaign(store, Limits(**limits), executor)
        finally:
            executor.close()
    return log_without_times(directory)


def on_dask(scheduler):
    from mrta_falsify.campaigns.dask_executor import DaskExecutor

    return DaskExecutor(DaskExecutor.Options(scheduler=scheduler))


def test_two_dask_workers_give_the_records_of_the_serial_executor(tmp_path, scheduler):
    chosen = settings(reject_above=0.8)
    serial = SerialExecutor(SerialExecutor.Options())
    expected = run(tmp_path / "serial", chosen, serial, budget=25)
    assert run(tmp_path / "dask", chosen, on_dask(scheduler), budget=25) == expected


def test_what_dask_began_is_gone_on_with_here_and_the_other_way_round(tmp_path, scheduler):
    chosen = settings(reject_above=0.8)
    expected = run(tmp_path / "serial", chosen, SerialExecutor(SerialExecutor.Options()), budget=24)
    run(tmp_path / "dask", chosen, on_dask(scheduler), budget=8)
    go_on(tmp_path / "dask", SerialExecutor(SerialExecutor.Options()), budget=16)
    assert go_on(tmp_path / "dask", on_dask(scheduler), budget=24) == expected


def test_workers_that_do_not_see_the_campaign_send_its_files(tmp_path, machines, monkeypatch):
    """The folder is named by the current directory of each process, so no worker has it."""
    for name in ("serial", "dask"):
        (tmp_path / name).mkdir()
    here = Path("/proc/self/cwd/c")
    monkeypatch.chdir(tmp_path / "serial")
    serial = SerialExecutor(SerialExecutor.Options())
    expected = run(here, kept_settings(str(here)), serial, budget=8)
    monkeypatch.chdir(tmp_path / "dask")
    assert run(here, kept_settings(str(here)), on_dask(machines), budget=8) == expected
    files = files_of_trials(tmp_path / "dask" / "c")
    assert files == files_of_trials(tmp_path / "serial" / "c")
    assert len(files) == 2 * 8


def test_what_a_worker_has_sent_and_cannot_be_kept_stops_the_campaign(
    tmp_path, machines, monkeypatch
):
    here = Path("/proc/self/cwd/c")
    monkeypatch.chdir(tmp_path)
    Store.create(here, kept_settings(str(here))).close()
    (tmp_path / "c" / TRIALS).write_text("in the way")
    with pytest.raises(PlaceError, match=r"trials.*: cannot be written: .*trial 000\d"):
        go_on(here, on_dask(machines), budget=3)
    assert not log_without_times(tmp_path / "c")


def test_machines_with_homes_of_their_own_run_the_trials_of_a_program(tmp_path, machines):
    program = tmp_path / "ward.scenic"
    program.write_text(PROGRAM)
    found = {}
    for name, choice in (
        ("serial", Choice("serial")),
        ("dask", Choice("dask", {"scheduler": machines})),
    ):
        chosen = new_settings(
            program, output=tmp_path / name, settings=["engine=kinematic"], sampler="random"
        )
        with Store.create(tmp_path / name, chosen) as store:
            run_store(store, Limits(budget=6), choice)
        found[name] = log_without_times(tmp_path / name), files_of_trials(tmp_path / name)
    assert found["dask"] == found["serial"]
    assert found["dask"][1]


@pytest.mark.parametrize("fault", ["crash", "hang", "unfit"])
def test_a_trial_that_a_worker_loses_is_run_again(tmp_path, scheduler, fault):
    lost = {fault: [2], "tries": str(tmp_path / "tries"), "times": 1, "time_limit": 1.0}
    serial = SerialExecutor(SerialExecutor.Options())
    expected = run(tmp_path / "serial", settings(), serial, budget=5)
    assert run(tmp_path / "dask", settings(**lost), on_dask(scheduler), budget=5) == expected


def test_a_scenario_that_workers_refuse_is_bad_input(tmp_path, scheduler):
    with pytest.raises(InputError, match=r"^Dask worker on \S+, in .*: standin.scenic:3: refused"):
        run(tmp_path, settings(refuse=True), on_dask(scheduler), budget=3)


def test_no_scheduler_at_the_address_is_bad_input():
    known = clients()
    gc.disable()
    try:
        with pytest.raises(ConfigError, match="no scheduler answers at 'nowhere'"):
            on_dask("nowhere").open(settings())
        # Collected later, while another one starts, it would wait for that one's lock.
        assert clients() <= known
    finally:
        gc.enable()


def clients():
    """Ids of all clients that are there, garbage or not."""
    return {id(one) for one in gc.get_objects() if type(one) is distributed.Client}


def test_an_executor_that_is_not_open_says_so():
    with pytest.raises(HarnessError, match="not open"):
        on_dask("").submit({"number": 0, "u": []})


def test_without_an_address_a_cluster_is_started_and_ended_here(tmp_path):
    from mrta_falsify.campaigns.dask_executor import DaskExecutor

    made = DaskExecutor(DaskExecutor.Options(workers=1))
    assert len(run(tmp_path, settings(), made, budget=3)) == 3


def test_an_executor_by_name_gets_the_number_of_workers_if_it_has_any():
    named = chosen_executor("mrta_falsify.campaigns.dask_executor:DaskExecutor", 3)
    assert named.options == {"workers": 3}
    assert chosen_executor("serial", 3) == Choice("serial")
    assert chosen_executor(None, 2) == Choice("processes", {"workers": 2})
