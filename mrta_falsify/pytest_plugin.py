"""A pytest plug-in: stored failures as tests, and tests that search a scenario.

::

    pytest --mrta-corpus runs/mine                      # each stored failure is a test
    pytest --mrta-corpus runs/mine --mrta-stack new.yaml -m mrta_corpus

    @pytest.mark.mrta_scenario("hot_room", budget=20, stack="stack.yaml")
    def test_the_stack_survives_hot_rooms(mrta_campaign):
        assert mrta_campaign.progress.ran == 20

It does nothing unless one of the two is used.
"""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from mrta_falsify.core.errors import InputError, MrtaFalsifyError

if TYPE_CHECKING:
    from mrta_falsify.commands.campaign import CampaignResult
    from mrta_falsify.core.findings import Recheck
    from mrta_falsify.core.record import TrialRecord

MAX_PERTURBED = 100  # as of the command `corpus`
BUDGET = 20  # trials of a scenario unless its marker names a number
CORPUS, SCENARIO = "mrta_corpus", "mrta_scenario"  # markers
FIXTURE = "mrta_campaign"


class StackFailedError(Exception):
    """The stack under test fails; the message is all that is worth reading."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of stored failures."""
    group = parser.getgroup("mrta-falsify", "stored failures of mrta-falsify as tests")
    group.addoption(
        "--mrta-corpus",
        action="append",
        default=[],
        metavar="DIR",
        help="Make each failure of this campaign a test, which passes if the stack survives it. "
        "Repeatable.",
    )
    group.addoption(
        "--mrta-stack",
        metavar="STACK",
        help="The stack under test, as --stack of mrta-falsify takes it; default: the campaign's.",
    )
    group.addoption(
        "--mrta-set",
        action="append",
        default=[],
        metavar="LAYER[.OPTION]=VALUE",
        help="Choose an implementation or set an option of the stack. Repeatable.",
    )
    group.addoption(
        "--mrta-trust",
        action="store_true",
        help="Run foreign code that the campaign's folder names, as --trust of mrta-falsify does.",
    )
    group.addoption(
        "--mrta-perturbed",
        "--mrta-jittered",  # its name up to 0.1
        dest="mrta_jittered",
        type=int,
        default=2,
        metavar="N",
        help="Runs beside each failure with starts, pace and times a little different (2).",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Make the markers known."""
    config.addinivalue_line(
        "markers", f"{CORPUS}: a stored failure of mrta-falsify, made by --mrta-corpus"
    )
    config.addinivalue_line(
        "markers",
        f"{SCENARIO}(scenario, *, budget={BUDGET}, **options): search the Scenic program, and fail "
        "if the stack does; options as of mrta_falsify.campaign. Names of files are relative to "
        "the test's folder",
    )


@pytest.hookimpl(tryfirst=True)  # so that -k and -m see the tests that are added
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Add the stored failures; let marked tests have their campaign."""
    for item in items:
        if item.get_closest_marker(SCENARIO) and isinstance(item, pytest.Function):
            item.fixturenames.append(FIXTURE)
    if not 0 <= config.getoption("mrta_jittered") <= MAX_PERTURBED:
        raise pytest.UsageError(f"--mrta-perturbed must be from 0 to {MAX_PERTURBED}")
    for directory in config.getoption("mrta_corpus"):
        items.extend(StoredFailures.from_parent(session, name=directory).collect())


# --- stored failures -------------------------------------------------------------------------


class StoredFailures(pytest.Collector):
    """The failures of a campaign."""

    def __init__(self, name: str, parent: pytest.Session, **kwargs: Any) -> None:
        super().__init__(name, parent, nodeid=name, **kwargs)

    def collect(self) -> Iterator[StoredFailure]:
        """Yield a test for each failure.

        Raises:
            pytest.UsageError: not a campaign.
        """
        from mrta_falsify.commands.stored_trials import list_trials  # noqa: PLC0415 - loads slowly

        try:
            rows = list_trials(self.name, failed=True)
        except InputError as error:
            raise pytest.UsageError(f"--mrta-corpus {error}") from None
        for row in rows:
            test = StoredFailure.from_parent(self, name=row.id)
            test.signature = row.signature
            test.add_marker(CORPUS)
            yield test


class StoredFailure(pytest.Item):
    """A stored failure, which passes if the stack survives its world and copies of it."""

    signature = ""
    row: Recheck

    def setup(self) -> None:
        """Run the world and its copies; what goes wrong here is no verdict about the stack."""
        from mrta_falsify.commands.corpus import recheck_corpus  # noqa: PLC0415

        assert self.parent is not None
        option = self.config.getoption
        (self.row,) = recheck_corpus(
            self.parent.name,
            stack=option("mrta_stack"),
            settings=option("mrta_set"),
            jittered=option("mrta_jittered"),
            only=(self.name,),
            pictures=_picture_folder(self.config, self.parent.name),
            trust=option("mrta_trust"),
        )

    def runtest(self) -> None:
        """Fail unless the failure is gone.

        Raises:
            StackFailedError: says what happens, where its picture is and how to run it again.
        """
        row = self.row
        if row.fate == "fixed":
            return
        told = [f"{row.fate}: {row.sentence or row.signature}"]
        if row.jittered_failures:
            told.append(f"{row.jittered_failures} of {row.jittered} perturbed runs fail")
        if row.picture:
            told.append(f"picture: {row.picture}")
        raise StackFailedError("\n".join([*told, f"again: {self._command()}"]))

    def _command(self) -> str:
        assert self.parent is not None
        option = self.config.getoption
        given = ["--stack", option("mrta_stack")] if option("mrta_stack") is not None else []
        changes = [word for setting in option("mrta_set") for word in ("--set", setting)]
        if not given and not changes and self.row.fate == "still failing":
            return _command("replay", self.parent.name, self.name, "--live")
        copies = ["--perturbed", str(option("mrta_jittered"))]
        return _command("corpus", self.parent.name, "--only", self.name, *given, *changes, *copies)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Show a failure, and an error of the user's, without a traceback."""
        if isinstance(excinfo.value, StackFailedError | MrtaFalsifyError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Name the test: its campaign, its number, what failed."""
        return self.path, None, f"{self.nodeid} {self.signature}"


def _picture_folder(config: pytest.Config, directory: str) -> Path | None:
    """Make a folder for pictures in pytest's cache; None if that is switched off."""
    cache = getattr(config, "cache", None)
    if cache is None:
        return None
    folder: Path = cache.mkdir("mrta-falsify") / Path(directory).resolve().name
    return folder


def _command(*words: str) -> str:
    return shlex.join(["mrta-falsify", *words])


# --- scenarios -------------------------------------------------------------------------------


@pytest.fixture
def mrta_campaign(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> CampaignResult:
    """Search the scenario of the test's marker ``mrta_scenario``; stop at the first failure."""
    from mrta_falsify.commands.campaign import campaign  # noqa: PLC0415 - loads slowly

    marker = request.node.get_closest_marker(SCENARIO)
    if marker is None or len(marker.args) != 1:
        raise pytest.UsageError(f"{request.node.nodeid}: it must be marked {SCENARIO}(SCENARIO)")
    known = [name for name in inspect.signature(campaign).parameters if name[:3] != "on_"]
    options = {"budget": BUDGET, "stop_after": 1, **marker.kwargs}
    unknown = sorted(options.keys() - set(known[2:]))
    if unknown:
        raise pytest.UsageError(
            f"{request.node.nodeid}: {SCENARIO} has no option {unknown[0]!r}; it has "
            f"{', '.join(known[2:])}"
        )
    folder = request.path.parent
    options |= {
        name: _beside(folder, options[name]) for name in ("stack", "against") if name in options
    }
    output = tmp_path_factory.mktemp(Path(str(marker.args[0])).stem) / "campaign"
    result = campaign(_beside(folder, marker.args[0]), output, **options)
    if result.ended == "interrupted":
        raise KeyboardInterrupt
    return result


def _beside(folder: Path, name: Any) -> Any:
    """Take the file of that name beside the test if there is one, else the name as it is."""
    if isinstance(name, str | Path) and (folder / name).is_file():
        return str(folder / name)
    return name


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> None:
    """Fail a test whose campaign has found a failure, before its own code runs."""
    found = getattr(item, "funcargs", {}).get(FIXTURE)
    if found is None:
        return
    stats = found.campaign.stats()
    if stats.first_own_failure is not None:
        record = found.campaign.record(stats.first_own_failure)
        pytest.fail(_failure_text(found, record, stats.own_failures), pytrace=False)


def _failure_text(found: CampaignResult, record: TrialRecord, failures: int) -> str:
    """Say what failed first, where its picture is, and how to run it again."""
    from mrta_falsify.commands.pictures import draw_trial  # noqa: PLC0415 - matplotlib loads slowly
    from mrta_falsify.commands.stored_trials import what_happened  # noqa: PLC0415

    directory = str(found.campaign.directory)
    return "\n".join(
        [
            f"{failures} of {found.progress.ran} trials fail: "
            f"{what_happened(found.campaign, record)[0]}",
            f"picture: {draw_trial(found.campaign, record)}",
            f"again: {_command('replay', directory, record.id)}",
        ]
    )
