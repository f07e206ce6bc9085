"""A campaign of somebody else is data: nothing of it runs, but after --trust."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import mrta_falsify as mf
from mrta_falsify.campaigns import store
from mrta_falsify.campaigns.made_here import SEAL, has_seal, write_seal
from mrta_falsify.cli import main
from mrta_falsify.core.errors import InputError, NeedsOption
from mrta_falsify.core.trace import Trace
from mrta_falsify.core.user_state import KEY, TRUSTED, secret_key, state_folder
from mrta_falsify.core.world import World
from mrta_falsify.testing.records import changed
from tests.commands.foreign_folders import OF_RESUMING, OF_RUNS, Folder, make_folder

BAD_INPUT = 2
ALL = OF_RUNS | OF_RESUMING
#: commands that look, with what they are given behind the folder
LOOKING = {
    "list": ["list", "{}"],
    "show": ["show", "{}", "0"],
    "report": ["report", "{}"],
    "certify": ["certify", "{}"],
    "nav2": ["export", "{}", "0", "--format", "nav2", "-o", "out/map.yaml"],
}
PICTURES = {
    "gif": ["export", "{}", "0", "--format", "gif", "-o", "out/run.gif"],
    "mcap": ["export", "{}", "0", "--format", "mcap", "-o", "out/run.mcap"],
    "issue": ["issue", "{}", "0", "-o", "out"],
}
RUNNING = {
    "replay": ["replay", "{}", "0"],
    "explain": ["explain", "{}", "0", "--max-runs", "1", "--workers", "1"],
    "minimize": ["minimize", "{}", "0", "--max-runs", "1", "--workers", "1"],
    "corpus": ["corpus", "{}", "--workers", "1"],
    "--resume": ["campaign", "--resume", "{}", "--workers", "1"],
}
AGAIN = {
    "export": [*LOOKING["nav2"], "--run"],
    "gif": [*PICTURES["gif"], "--run"],
    "issue": [*PICTURES["issue"], "--run"],
    "report": ["report", "{}", "--run"],
    "beside": ["report", "{}", "--beside"],
}
ours = pytest.mark.usefixtures("own_home")


@pytest.fixture
def own_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A user who has trusted nothing yet, in an unpacked archive."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "unpacked").mkdir()
    monkeypatch.chdir(tmp_path / "unpacked")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    return


@pytest.fixture
def folder(own_home: None, tmp_path: Path, hall: World, hall_trace: Trace) -> Folder:
    return make_folder(tmp_path, hall, hall_trace)


def call(words: list[str], folder: Folder, *more: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main([word.replace("{}", str(folder.directory)) for word in (*words, *more)])
    return int(ended.value.code or 0)


@pytest.mark.parametrize("payload", ALL)
def test_verbs_that_look_run_nothing(payload: str, folder: Folder) -> None:
    ALL[payload](folder)
    for words in LOOKING.values():
        assert call(words, folder) in (0, 1, BAD_INPUT), words
        assert not folder.mark.exists(), words
    try:
        mf.open_campaign(folder.directory).frame()
    except InputError:
        assert payload.startswith("link")
    assert not folder.mark.exists()


@pytest.mark.parametrize("payload", ["component_costmap", "program_by_dots", "command_of_a_stack"])
@pytest.mark.parametrize("verb", PICTURES)
def test_pictures_run_nothing(verb: str, payload: str, folder: Folder) -> None:
    ALL[payload](folder)
    assert call(PICTURES[verb], folder) in (0, BAD_INPUT)
    assert not folder.mark.exists()


@pytest.mark.parametrize("payload", ALL)
def test_verbs_that_run_ask_for_trust(
    payload: str, folder: Folder, capfd: pytest.CaptureFixture[str]
) -> None:
    ALL[payload](folder)
    for verb, words in RUNNING.items():
        if payload in OF_RESUMING and verb != "--resume":
            continue
        assert call(words, folder) == BAD_INPUT, verb
        assert not folder.mark.exists(), verb
        told = capfd.readouterr().err
        assert told.rstrip().endswith("--trust"), told
        assert str(folder.directory) in told


@pytest.mark.parametrize("payload", OF_RUNS)
def test_what_is_made_again_asks_for_trust(payload: str, folder: Folder) -> None:
    OF_RUNS[payload](folder)
    if not payload.startswith("link"):
        shutil.rmtree(folder.directory / "trials")
    verbs = ("export",) if "link" in payload or "program" in payload else ("gif", "issue", "report")
    for verb in verbs:
        assert call(AGAIN[verb], folder) == BAD_INPUT, verb
        assert not folder.mark.exists(), verb


@pytest.mark.parametrize(
    "payload", ["component_planner", "specification", "component_in_a_package", "component_engine"]
)
@pytest.mark.parametrize("verb", ["replay", "explain", "minimize"])
def test_trust_lets_it_run(verb: str, payload: str, folder: Folder) -> None:
    OF_RUNS[payload](folder)
    assert call(RUNNING[verb], folder) == BAD_INPUT
    assert not folder.mark.exists()
    call(RUNNING[verb], folder, "--trust")
    assert folder.mark.read_text() == "ran"


@pytest.mark.parametrize("payload", ["sampler", "component_human_model", "engine_that_confirms"])
def test_trust_lets_a_campaign_go_on(
    payload: str, folder: Folder, capfd: pytest.CaptureFixture[str]
) -> None:
    ALL[payload](folder)
    call(RUNNING["--resume"], folder, "--trust")
    assert f"trusted: the component {folder.module}:Evil" in capfd.readouterr().err


@pytest.mark.parametrize("payload", ["program_in_the_folder", "program_imports_a_module"])
def test_trust_lets_a_program_run(payload: str, folder: Folder) -> None:
    OF_RUNS[payload](folder)
    assert call(LOOKING["nav2"], folder) == BAD_INPUT
    assert call(LOOKING["nav2"], folder, "--trust") == BAD_INPUT  # looking runs nothing
    assert call(LOOKING["nav2"], folder, "--run") == BAD_INPUT
    assert not folder.mark.exists()
    call(LOOKING["nav2"], folder, "--run", "--trust")
    assert folder.mark.exists()


def test_a_world_elsewhere_is_read_after_trust(folder: Folder) -> None:
    OF_RUNS["link_to_a_world"](folder)
    assert call(LOOKING["nav2"], folder) == BAD_INPUT
    assert call(LOOKING["nav2"], folder, "--run") == BAD_INPUT
    assert call(LOOKING["nav2"], folder, "--run", "--trust") == 0


# --- what is remembered ----------------------------------------------------------------------


def asked(folder: Folder, **options: object) -> bool:
    """Whether a replay asks for trust; what comes after that does not matter."""
    try:
        mf.replay(folder.directory, 0, **options)
    except NeedsOption as error:
        return error.option == "--trust"
    except InputError:
        return False
    return False


def test_trust_is_remembered_until_what_runs_changes(folder: Folder) -> None:
    OF_RUNS["component_planner"](folder)
    assert asked(folder)
    assert not asked(folder, trust=True)
    assert not asked(folder)
    (folder.directory / "corpus.journal.jsonl").write_text("")  # the log is not what runs
    (folder.directory / "report.html").write_text("")
    assert not asked(folder)
    module = folder.beside / f"{folder.module}.py"
    module.write_text(module.read_text() + "\n")
    assert asked(folder)


@pytest.mark.parametrize("name", ["helper.py", "deep/helper.py", "helper.so", "helper.txt"])
def test_what_lies_beside_a_module_belongs_to_it(name: str, folder: Folder) -> None:
    OF_RUNS["component_planner"](folder)
    helper = folder.beside / name
    helper.parent.mkdir(exist_ok=True)
    helper.write_text("1")
    assert not asked(folder, trust=True)
    assert not asked(folder)
    helper.write_text("2")
    assert asked(folder)


def test_another_stack_is_another_question(folder: Folder) -> None:
    OF_RUNS["component_planner"](folder)
    assert not asked(folder, trust=True)
    OF_RUNS["command_of_a_stack"](folder)
    assert asked(folder)


def test_a_folder_that_is_too_large_is_not_remembered(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mrta_falsify.campaigns.code_content.MAX_FILES", 0)
    OF_RUNS["component_planner"](folder)
    told: list[str] = []
    assert not asked(folder, trust=told.append)
    assert "cannot be remembered" in told[0]
    assert asked(folder)


# --- whose folder it is ------------------------------------------------------------------------


def test_a_folder_of_ones_own_asks_nothing(folder: Folder) -> None:
    OF_RUNS["component_planner"](folder)
    write_seal(folder.directory, {f"{folder.module}:Evil": str(folder.beside / "x.py")})
    assert asked(folder)  # the module lay elsewhere
    place = folder.beside / f"{folder.module}.py"
    write_seal(folder.directory, {f"{folder.module}:Evil": str(place)})
    assert not asked(folder)
    folder.set("trials", "seed", value=7)  # somebody has changed it
    assert asked(folder)


def test_a_program_of_the_same_name_elsewhere_is_not_ones_own(
    folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    OF_RUNS["program_relative_to_here"](folder)
    place = folder.directory / "day.scenic"
    write_seal(folder.directory, {"downloaded/day.scenic": str(place)})
    (tmp_path / "elsewhere" / "downloaded").mkdir(parents=True)
    copy = folder.write_program(tmp_path / "elsewhere" / "downloaded" / "day.scenic")
    monkeypatch.chdir(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="has changed"):  # a copy of it is: it may run
        mf.replay(folder.directory, 0)
    folder.mark.unlink()
    copy.write_text(copy.read_text() + "# other\n")
    assert asked(folder)
    assert not folder.mark.exists()


def test_the_key_of_another_user_fits_no_folder_of_ours(
    folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_seal(folder.directory, {})
    assert has_seal(folder.directory)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    assert not has_seal(folder.directory)
    assert secret_key(make=True) is not None
    assert not has_seal(folder.directory)


def test_limits_of_a_resumed_campaign_are_not_sealed(folder: Folder) -> None:
    write_seal(folder.directory, {})
    folder.set("budget", value=9)
    folder.set("time_limit", value=9.0)
    assert has_seal(folder.directory)


@ours
def test_a_key_that_others_can_read_is_no_key() -> None:
    assert secret_key() is None
    key = secret_key(make=True)
    assert key == secret_key()
    path = state_folder() / KEY
    assert path.stat().st_mode & 0o777 == 0o600
    path.chmod(0o644)
    assert secret_key(make=True) is None


@ours
@pytest.mark.parametrize("home", ["here", "~nobody-at-all"])
def test_a_user_without_a_home_has_no_key(home: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", home)
    assert secret_key(make=True) is None
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("seal", ["", "{}", "[]", '{"mac": 1, "places": []}', '{"mac": "é"}'])
def test_a_seal_that_is_none(seal: str, folder: Folder) -> None:
    assert secret_key(make=True) is not None
    (folder.directory / SEAL).write_text(seal)
    assert not has_seal(folder.directory)


def test_a_home_that_cannot_be_written_asks_each_time(
    folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    OF_RUNS["component_planner"](folder)
    assert not asked(folder, trust=True)
    assert asked(folder)
    write_seal(folder.directory, {})
    assert not (folder.directory / SEAL).exists()


def test_shipped_parts_ask_nothing(folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not (state_folder() / TRUSTED).exists()
    reached: list[str] = []
    for module, name in (("explain",) * 2, ("minimize",) * 2, ("corpus", "recheck")):
        target = f"mrta_falsify.commands.{module}.{name}"
        monkeypatch.setattr(target, lambda *args, name=name, **options: reached.append(name))
    mf.explain(folder.directory, 0)
    mf.minimize(folder.directory, 0)
    mf.corpus(folder.directory)
    assert reached == ["explain", "minimize", "recheck"]


def test_a_changed_stack_on_the_command_line_is_trusted(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    reached: list[object] = []
    monkeypatch.setattr(
        "mrta_falsify.commands.corpus.recheck",
        lambda campaign, config, **options: reached.append(config),
    )
    OF_RUNS["command_of_a_stack"](folder)
    mf.corpus(folder.directory, settings=["allocator=nearest"])
    assert len(reached) == 1
    OF_RUNS["component_engine"](folder)  # it is kept, and the folder names it
    with pytest.raises(NeedsOption):
        mf.corpus(folder.directory, settings=["allocator=nearest"])
    mf.corpus(folder.directory, settings=["engine=kinematic"])
    assert not folder.mark.exists()


def test_what_is_missing_is_said(folder: Folder) -> None:
    folder.lose("world.json", "trace.zip")
    calls: list[Callable[[], object]] = [
        lambda: mf.export(folder.directory, 0, format="nav2", output="out"),
        lambda: mf.issue(folder.directory, 0),
        lambda: mf.corpus(folder.directory),
    ]
    for one in calls:
        with pytest.raises(NeedsOption) as error:
            one()
        assert error.value.option == "--run"


def test_an_empty_digest_is_equal_to_nothing(folder: Folder) -> None:
    path = folder.directory / "records.jsonl"
    record = mf.open_campaign(folder.directory).records[0]
    path.write_bytes(store._line(changed(record, world="")))
    with pytest.raises(InputError, match="no digest"):
        mf.export(folder.directory, 0, format="nav2", output="out")
    folder.set("trials", "sources_digest", value="")
    with pytest.raises(InputError, match="no digest of its program"):
        mf.resume_campaign(folder.directory)


@pytest.mark.parametrize("name", ["report.html", "report.html.part", "corpus.journal.jsonl"])
def test_nothing_is_written_through_a_link(name: str, folder: Folder) -> None:
    page = folder.directory / name
    (folder.beside / "precious").write_text("precious")
    page.symlink_to(folder.beside / "precious")
    call(LOOKING["report"], folder)
    if name.startswith("corpus"):
        assert call(RUNNING["corpus"], folder) == BAD_INPUT
    assert (folder.beside / "precious").read_text() == "precious"


# --- projects ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "scenarios: {day.scenic: {}}",
        "scenarios: {hot_room: {sampler: 'evil_of_ci:S'}}",
        "scenarios: {hot_room: {specs: ['evil_of_ci:S']}}",
        "scenarios: {hot_room: {}}\nstacks: {mine: {settings: ['planner=evil_of_ci:P']}}",
        "scenarios: {hot_room: {}}\nstacks: {mine: 'exec:sh -c true'}",
        "scenarios: {hot_room: {}}\nstacks: {mine: 'connect:127.0.0.1:9'}",
        "scenarios: {hot_room: {}}\nstacks: {mine: stack.yaml}",
        "scenarios: {hot_room: {}}\nkeep: ../elsewhere",
        "corpus: [downloaded]",
    ],
)
def test_ci_asks_for_trust(text: str, folder: Folder) -> None:
    OF_RUNS["specification"](folder)
    folder.write_program(folder.beside / "day.scenic")
    (folder.beside / "evil_of_ci.py").write_text(folder.payload)
    (folder.beside / "stack.yaml").write_text("planner: evil_of_ci:P\n")
    (folder.beside / "mrta-falsify.yaml").write_text(text)
    assert call(["ci", "--workers", "1"], folder) == BAD_INPUT
    assert not folder.mark.exists()


def test_ci_runs_after_trust(folder: Folder) -> None:
    (folder.beside / "evil_of_ci2.py").write_text(folder.payload)
    (folder.beside / "mrta-falsify.yaml").write_text(
        "scenarios: {hot_room: {sampler: 'evil_of_ci2:S'}}"
    )
    with pytest.raises(NeedsOption):
        mf.ci()
    with pytest.raises(InputError):  # it has no class S
        mf.ci(trust=True)
    assert folder.mark.exists()
