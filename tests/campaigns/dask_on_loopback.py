from __future__ import annotations

import gc

import pytest

from mrta_falsify.campaigns.executors import SerialExecutor
from mrta_falsify.campaigns.runner import run_campaign
from mrta_falsify.campaigns.settings import Limits
from mrta_falsify.campaigns.store import Store, read_campaign
from mrta_falsify.core import codec
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import ConfigError, HarnessError, InputError
from mrta_falsify.verbs.workers import chosen_executor
from tests.campaigns.standin import settings

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two worker processes on loopback."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield cluster.scheduler_address


def run(directory, chosen, executor, **limits):
    with Store.create(directory, chosen) as store:
        try:
            executor.open(store.settings)
            run_campaign(store, Limits(**limits), executor)
        finally:
            executor.close()
    return [codec.encode(record) for record in read_campaign(directory).records]


def on_dask(scheduler):
    from mrta_falsify.campaigns.dask_executor import DaskExecutor

    return DaskExecutor(DaskExecutor.Options(scheduler=scheduler))


def test_two_dask_workers_give_the_records_of_the_serial_executor(tmp_path, scheduler):
    chosen = settings(reject_above=0.8)
    serial = SerialExecutor(SerialExecutor.Options())
    expected = run(tmp_path / "serial", chosen, serial, budget=25)
    assert run(tmp_path / "dask", chosen, on_dask(scheduler), budget=25) == expected


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["crash", "hang", "unfit"])
def test_a_trial_that_a_worker_loses_is_run_again(tmp_path, scheduler, fault):
    lost = {fault: [2], "tries": str(tmp_path / "tries"), "times": 1, "time_limit": 1.0}
    serial = SerialExecutor(SerialExecutor.Options())
    expected = run(tmp_path / "serial", settings(), serial, budget=5)
    assert run(tmp_path / "dask", settings(**lost), on_dask(scheduler), budget=5) == expected


def test_a_scenario_that_workers_refuse_is_bad_input(tmp_path, scheduler):
    with pytest.raises(InputError, match=r"standin.scenic:3: refused"):
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


@pytest.mark.slow
def test_without_an_address_a_cluster_is_started_and_ended_here(tmp_path):
    from mrta_falsify.campaigns.dask_executor import DaskExecutor

    made = DaskExecutor(DaskExecutor.Options(workers=1))
    assert len(run(tmp_path, settings(), made, budget=3)) == 3


def test_an_executor_by_name_gets_the_number_of_workers_if_it_has_any():
    named = chosen_executor("mrta_falsify.campaigns.dask_executor:DaskExecutor", 3)
    assert named.options == {"workers": 3}
    assert chosen_executor("serial", 3) == Choice("serial")
    assert chosen_executor(None, 2) == Choice("processes", {"workers": 2})
