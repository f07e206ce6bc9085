"""What is not judged is neither safe nor unsafe: scores, signatures, forms of reports."""

import dataclasses
import xml.etree.ElementTree as ET

import pytest

from mrta_falsify.campaigns.signature import leading, signature
from mrta_falsify.core import codec
from mrta_falsify.core.config import StackConfig, apply_setting
from mrta_falsify.core.errors import ConfigError, UnknownNameError
from mrta_falsify.core.fleet import Tells
from mrta_falsify.core.verdict import Verdict, unjudged
from mrta_falsify.specs.objectives import objectives, search_score
from mrta_falsify.trial import refuse_unjudgeable
from reports.junit import TrialResult, render_junit
from reports.run_report import run_headline

HELD = Verdict(spec="deadlines", robustness=12.0, violated=False)
BROKEN = Verdict(spec="progress", robustness=-1.0, violated=True)
UNKNOWN = unjudged("all_tasks_done", "the stack does not tell its deliveries")


def test_what_is_not_judged_is_left_out_of_the_score():
    assert set(objectives([HELD, UNKNOWN])) == {"deadlines"}
    assert search_score(objectives([HELD, UNKNOWN])) == search_score(objectives([HELD]))


def test_a_run_of_which_nothing_was_judged_is_no_failure_and_draws_no_search():
    assert search_score(objectives([UNKNOWN])) == 1.0
    assert (signature([UNKNOWN]), leading([UNKNOWN])) == ("", None)


def test_signatures_ignore_what_was_not_judged():
    assert signature([UNKNOWN, BROKEN]) == "progress"


def test_a_headline_never_says_that_what_was_not_judged_holds():
    assert run_headline([HELD]) == "all 1 specifications hold"
    assert run_headline([HELD, UNKNOWN]) == (
        "1 of 2 specifications hold; not judged: all_tasks_done"
    )


def test_junit_skips_what_was_not_judged():
    row = TrialResult(name="trial 0000", time=1.0, skipped="deadlines: not told")
    suite = ET.fromstring(render_junit("suite", [row]))
    assert suite.attrib["skipped"] == "1"
    assert suite.find("testcase/skipped").attrib["message"] == "deadlines: not told"


def test_only_a_job_of_which_nothing_can_be_judged_is_refused():
    refuse_unjudgeable([HELD, UNKNOWN])
    with pytest.raises(ConfigError, match="all_tasks_done: the stack does not tell its deliv"):
        refuse_unjudgeable([UNKNOWN])


def test_what_a_stack_lacks_is_said_in_words():
    tells = Tells(deliveries=False, goals=False)
    assert tells.lacking("paths") == ""
    assert tells.lacking("goals", "paths") == "the stack does not tell its goals"
    assert (
        tells.lacking("deliveries", "goals") == "the stack does not tell its deliveries and goals"
    )


def test_withholding_is_a_setting_and_leaves_other_digests_alone():
    assert "withheld" not in codec.encode(StackConfig())
    hidden = apply_setting(StackConfig(), "withheld=[goals, deliveries]")
    assert hidden.withheld == ("deliveries", "goals")
    assert apply_setting(StackConfig(), "withheld=goals").withheld == ("goals",)
    assert hidden.digest() != StackConfig().digest()
    assert codec.decode(StackConfig, codec.encode(hidden), where="here") == hidden
    assert dataclasses.replace(hidden, withheld=()).digest() == StackConfig().digest()
    with pytest.raises(UnknownNameError, match="deliveries, goals, paths"):
        apply_setting(StackConfig(), "withheld=[motion]")
