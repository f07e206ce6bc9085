"""The nearest passing trial, ranked parameters, and what the table of trials says of both."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner

from mrta_falsify.cli import main
from mrta_falsify.commands import made_again
from mrta_falsify.commands.report.overview import summary_sentences
from mrta_falsify.commands.report.parameters import (
    nearest_passing,
    neighbour_of,
    parameter_importances,
    passing_trials,
    rank_dimensions,
    trial_table,
)
from mrta_falsify.commands.report.reading import view_of
from mrta_falsify.commands.report.writing import keep_neighbours
from mrta_falsify.core.candidate import Dimension, SearchSpace
from mrta_falsify.core.config import Choice
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.feedback import Cube
from mrta_falsify.core.trace import read_trace
from mrta_falsify.core.verdict import Verdict
from mrta_falsify.testing.records import changed
from tests.reports.planted import stalled_campaign

SPACE = SearchSpace(
    (
        Dimension(name="bed.x", kind="range", low=0.0, high=10.0),
        Dimension(name="people", kind="integer", low=0, high=3, choices=4),
    )
)


@pytest.fixture(scope="module")
def stored_failure(stalled, tmp_path_factory):
    return stalled_campaign(tmp_path_factory.mktemp("neighbours") / "campaign", stalled)


@pytest.fixture
def campaign(stored_failure):
    """One failure at (0.5, 0.1), passing trials around it."""
    (failure,) = stored_failure.records

    def at(number, x, people, record=failure):
        candidate = dataclasses.replace(failure.candidate, number=number, u=np.array([x, people]))
        return changed(record, candidate=candidate, values=(10.0 * x, float(int(4 * people))))

    holds = Verdict(spec="no_deadlock", robustness=1.0, violated=False)
    passing = changed(failure, verdicts=(holds,), signature="", layer="", trace_file="")
    settings = dataclasses.replace(
        stored_failure.settings, cube=Cube(dimensions=2, levels=(0, 4)), space=SPACE,
        sampler=Choice("random"),
    )  # fmt: skip
    return dataclasses.replace(
        stored_failure,
        settings=settings,
        records=(
            at(0, 0.5, 0.1),
            at(1, 0.9, 0.1, passing),  # 0.4 away
            at(2, 0.5, 0.3, passing),  # another number of people, which counts 1
            at(3, 0.45, 0.2, passing),  # as many people: 0.05 away
        ),
    )


def test_the_nearest_passing_trial_is_found_and_what_differs_is_told(campaign):
    settings, record = campaign.settings, campaign.records[0]
    near = nearest_passing(settings, passing_trials(campaign.records, 2), record)
    found = neighbour_of(settings, record, near, "report --beside")
    assert found.id == "0003"
    assert found.differences == (("bed.x", "5", "4.5"),)
    assert found.command == "report --beside"


def test_without_a_passing_trial_there_is_no_neighbour(campaign):
    alone = campaign.records[:1]
    assert nearest_passing(campaign.settings, passing_trials(alone, 2), alone[0]) is None


def test_the_run_of_a_neighbour_is_kept_if_it_is_the_recorded_one(
    campaign, stalled, tmp_path, monkeypatch
):
    world, judged = stalled
    elsewhere = dataclasses.replace(campaign, directory=tmp_path)
    near = elsewhere.records[3]
    monkeypatch.setattr(made_again, "stored_world", lambda *_: world)
    monkeypatch.setattr(made_again.Lab, "judge", lambda *_: judged)
    other = changed(near, trace="0" * 64)
    with pytest.raises(InputError, match="runs differently now"):
        made_again.keep_run(elsewhere, other)
    assert not elsewhere.folder(near).exists()
    keep_neighbours(elsewhere, [elsewhere.records[0]])
    assert read_trace(elsewhere.folder(near) / "trace.zip").digest == near.trace_digest


def test_parameters_are_ranked_by_trials_that_were_drawn_evenly(campaign):
    failure, passing = campaign.records[0], campaign.records[1]
    stream = np.random.default_rng(0)
    records = []
    for number in range(80):
        u = stream.random(2)
        record = failure if u[0] > 0.5 else passing
        candidate = dataclasses.replace(record.candidate, number=number, u=u)
        records.append(changed(record, candidate=candidate, values=(10.0 * u[0], None)))
    many = dataclasses.replace(campaign, records=tuple(records))
    ranking = rank_dimensions(many.settings, records)
    assert ranking.is_even
    assert ranking.mattering == (0,)
    first, second = parameter_importances(many.settings, records, ranking)
    assert (first.name, second.name) == ("bed.x", "people")
    assert first.parts[-1].high == pytest.approx(max(r.origin.values[0] for r in records))
    table = trial_table(many.settings, records, many.stats().modes, [1, 0])
    assert table.parameters == ("people", "bed.x")
    assert table.rows[0].values == (None, records[0].origin.values[0])
    failed = [record.id for record in records if record.failed]
    layers = dict.fromkeys(failed, "queue_policy")
    told = " ".join(summary_sentences(view_of(many, layers)))
    assert f"Suspected part of the stack, by trials: the queue policy ({len(failed)})." in told
    assert "ended in a deadlock" in told
    assert "Failing goes with bed.x." in told
    searched = dataclasses.replace(many.settings, sampler=Choice("auto"))
    ranking = rank_dimensions(searched, records)
    assert not ranking.is_even
    assert ranking.mattering == ()  # nothing is claimed of trials that depend on each other


def test_the_page_is_opened_in_the_browser_when_asked(stored_failure, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    page = tmp_path / "page.html"
    words = ["report", str(stored_failure.directory), "-o", str(page), "--open"]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert opened == [page.resolve().as_uri()]
