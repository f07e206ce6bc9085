"""The pytest plug-in: stored failures as tests, and tests that search a scenario."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from scenic_worlds import program as _loaded  # noqa: F401 - a run in this process would unload it
from tests.quick_program import PROGRAM

pytest_plugins = ["pytester"]
PLUGIN = ("-p", "mrta_falsify.pytest_plugin", "-p", "no:randomly")
ROOT = Path(__file__).parent.parent.parent


def test_the_plug_in_is_registered_under_the_name_of_its_module():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    names = project["entry-points"]["pytest11"]
    assert names == {"mrta_falsify.pytest_plugin": "mrta_falsify.pytest_plugin"}


def test_it_does_nothing_unless_it_is_asked(pytester):
    pytester.makepyfile("import sys\ndef test_it(): assert 'numba' not in sys.modules\n")
    result = pytester.runpytest_subprocess(*PLUGIN, "--strict-markers")
    result.assert_outcomes(passed=1)


@pytest.mark.usefixtures("in_process")
@pytest.mark.slow
def test_a_stored_failure_is_a_test_that_tells_what_happens(pytester, campaign):
    pytester.makepyfile("def test_other(): pass\n")
    args = (*PLUGIN, f"--mrta-corpus={campaign.directory}", "--mrta-perturbed=0")
    result = pytester.runpytest_inprocess(*args, "-m", "mrta_corpus")
    result.assert_outcomes(failed=1, deselected=1)
    result.stdout.fnmatch_lines(
        [
            "still failing: robot* stuck*",
            "picture: *.pytest_cache/d/mrta-falsify/campaign/0000.png",
            f"again: mrta-falsify replay {campaign.directory} 0000 --live",
        ]
    )
    result.stdout.no_fnmatch_line("*Traceback*")
    assert (pytester.path / ".pytest_cache/d/mrta-falsify/campaign/0000.png").stat().st_size > 1000
    cured = pytester.runpytest_inprocess(*args, "-m", "mrta_corpus", "--mrta-set", "defects=[]")
    cured.assert_outcomes(passed=1, deselected=1)


@pytest.mark.parametrize(
    ("args", "complaint"),
    [
        (("--mrta-corpus", "nowhere"), "*nowhere: is not a campaign directory*"),
        (("--mrta-perturbed", "-1"), "*--mrta-perturbed must be from 0 to 100*"),
    ],
)
def test_bad_options_are_usage_errors(pytester, args, complaint):
    pytester.makepyfile("def test_other(): pass\n")
    result = pytester.runpytest_inprocess(*PLUGIN, *args)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([complaint])


@pytest.mark.usefixtures("in_process")
def test_what_cannot_be_run_is_an_error_and_no_verdict(pytester, campaign):
    (campaign.directory / "trials" / "0000" / "world.json").write_text('{"name": "half a wor')
    pytester.makepyfile("def test_other(): pass\n")
    result = pytester.runpytest_inprocess(*PLUGIN, "--mrta-corpus", str(campaign.directory))
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*world.json: is not valid JSON*"])


@pytest.mark.slow
def test_a_marked_test_fails_with_what_its_search_finds(pytester):
    (pytester.path / "small.scenic").write_text(PROGRAM)
    pytester.makepyfile(
        """
        import pytest

        OPTIONS = dict(
            settings=["engine=kinematic"], sampler="random", seed=4, executor="serial", jittered=0
        )

        @pytest.mark.mrta_scenario("small.scenic", budget=6, specs=["deadlines"], **OPTIONS)
        def test_deadlines_are_kept(mrta_campaign):
            raise AssertionError("its own code does not run")

        @pytest.mark.mrta_scenario("small.scenic", budget=1, specs=["exclusive_use"], **OPTIONS)
        def test_rooms_are_not_shared(mrta_campaign):
            assert mrta_campaign.progress.ran == 1

        @pytest.mark.mrta_scenario("small.scenic", buget=1)
        def test_misspelt():
            pass
        """
    )
    result = pytester.runpytest_inprocess(*PLUGIN, "--strict-markers")
    result.assert_outcomes(passed=1, failed=1, errors=1)
    result.stdout.fnmatch_lines(
        [
            "*mrta_scenario has no option 'buget'; it has budget, *",
            "*of * trials fail: A deadline was missed*",
            "picture: */picture.png",
            "again: mrta-falsify replay */campaign *",
        ]
    )
