"""Records of formats 1 and 2, which are one flat object each: read as format 3, and told so.

``show --format json`` tells a record in these words still, which scripts read.
"""

from __future__ import annotations

from typing import Any

from mrta_falsify.campaigns.rules import JUDGED_SINCE
from mrta_falsify.campaigns.signature import signature_before
from mrta_falsify.core import codec
from mrta_falsify.core.record import EngineRun, SearchData, TrialRecord
from mrta_falsify.core.run_result import RunResult, Vote
from mrta_falsify.specs.causes import group_of

FLAT = "status"  #: a field that lines of formats 1 and 2 have, and no other line
#: where fields of a flat record are now; those of other names and places are told below
ORIGIN = {
    "proposal_digest": "proposal",
    "uniform": "uniform",
    "values": "values",
    "world_digest": "world",
    "attempts": "attempts",
    "scene_s": "scene_s",
    "shut": "shut",
    "notes": "notes",
    "versions": "versions",
}
RESULT = {
    "verdicts": "verdicts",
    "objectives": "margins",
    "signature": "signature",
    "ended": "ended",
    "trace_digest": "trace",
    "sim_time": "sim_time",
    "wall_s": "wall_s",
    "engine": "engine",
    "layer": "layer",
    "trace_file": "trace_file",
    "coupling": "coupling",
}
SEARCH = {
    "score": "score",
    "descriptors": "descriptors",
    "situations": "situations",
    "blamed": "blamed",
}
#: are not told where they are empty
OPTIONAL = frozenset(
    ("values", "situations", "blamed", "uniform", "is_afterthought", "is_shut", "signature_before",
     "confirmed", "repeated", "other", "coupling", "shut", "notes")
)  # fmt: skip
NO_SEARCH = SearchData()
RESULT_STATUS = {"ok": "judged", "crashed": "error"}  #: where it has another name


def is_flat(line: Any) -> bool:
    """Whether a line of a log, as JSON-shaped data, is of format 1 or 2."""
    return isinstance(line, dict) and FLAT in line


def migrated(line: Any) -> Any:
    """Give a line of the log as format 3 has it; one of format 3 is given as it is.

    What belongs to no field stays where it is, so that decoding names it.

    Args:
        line: JSON-shaped data.
    """
    if not is_flat(line):
        return line
    flat = dict(line)
    status = flat.pop("status")
    flat.pop("signature_before", None)  # follows from the verdicts
    record = {
        "candidate": flat.pop("candidate", None),
        "origin": _taken(flat, ORIGIN),
        "search": _taken(flat, SEARCH),
    }
    result = _taken(flat, RESULT)
    if status == "rejected":
        flat.update({name: value for name, value in result.items() if value})
    else:
        record["result"] = {**result, **_judgement(status, flat, result)}
    flat.pop("is_afterthought", None)
    flat.pop("is_shut", None)
    if (copies := flat.pop("jittered", None)) is not None:
        record["vote"], told = _vote(copies)
        record["search"] = {**record["search"], **told}
    if (repeats := flat.pop("repeated", None)) is not None:
        record["repeats"] = repeats
    if (screening := flat.pop("screening", None)) is not None:
        record["origin"]["screening"] = _engine_run(screening)
    runs = flat.pop("confirmed", None)
    if isinstance(runs, list) and all(isinstance(run, dict) for run in runs):
        record["engines"] = {str(run.get("engine")): _engine_run(run) for run in runs}
    elif runs is not None:
        record["engines"] = runs
    return {**flat, **record}


def _taken(flat: dict[str, Any], places: dict[str, str]) -> dict[str, Any]:
    """Take fields out of a flat record, under the names that they have now."""
    return {now: flat.pop(then) for then, now in places.items() if then in flat}


def _judgement(status: Any, flat: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    """Tell status and rank of a result from what a flat record says."""
    verdicts = result.get("verdicts")
    rows = [v for v in verdicts if isinstance(v, dict)] if isinstance(verdicts, list) else []
    fails = any(verdict.get("violated") for verdict in rows)
    rank = "none"
    if fails:
        is_secondary = flat.get("is_afterthought") or flat.get("is_shut")
        rank = "secondary" if is_secondary else "primary"
    now = RESULT_STATUS.get(status, status) if isinstance(status, str) else status
    if now == "judged" and not fails and any(verdict.get("not_judged") for verdict in rows):
        now = "not_judged"
    return {"status": now, "rank": rank}


def _vote(copies: Any) -> tuple[Any, dict[str, Any]]:
    """Split what copies said into a vote and what the search learns of it."""
    if not isinstance(copies, dict):
        return copies, {}
    vote = dict(copies)
    told = _taken(vote, {"objectives": "expected", "noise": "noise"})
    return vote, told


def _engine_run(run: Any) -> Any:
    if not isinstance(run, dict) or run.get("jittered") is None:
        return {k: v for k, v in run.items() if k != "jittered"} if isinstance(run, dict) else run
    told = dict(run)
    vote, _ = _vote(told.pop("jittered"))
    return {**told, "vote": vote}


# --- as it was told ------------------------------------------------------------------------


def flat_record(record: TrialRecord, rules: int) -> dict[str, Any]:
    """Tell a record as formats 1 and 2 did: one object, whose keys scripts know.

    Args:
        record: of a trial.
        rules: of its campaign.
    """
    origin, search = record.origin, record.search
    result = record.result or RunResult(status="error")
    group = group_of(record.result)
    is_signed_twice = record.failed and rules >= JUDGED_SINCE
    told = {
        "candidate": record.candidate,
        "status": record.status,
        "error": record.error,
        **{then: getattr(origin, now) for then, now in ORIGIN.items()},
        **{then: getattr(result, now) for then, now in RESULT.items()},
        **{then: getattr(search, now) for then, now in SEARCH.items()},
        "is_afterthought": group == "secondary",
        "is_shut": group == "shut",
        "signature_before": signature_before(record.verdicts) if is_signed_twice else "",
        "screening": _flat_engine_run(origin.screening),
        "jittered": _flat_vote(record.vote, search),
        "confirmed": [_flat_engine_run(run) for run in record.engines.values()],
        "repeated": record.repeats,
        "other": record.other,
    }
    data = {name: codec.encode(value) for name, value in told.items()}
    return {name: value for name, value in data.items() if value or name not in OPTIONAL}


def _flat_vote(vote: Vote | None, search: SearchData = NO_SEARCH) -> dict[str, Any] | None:
    if vote is None:
        return None
    told = {"runs": vote.runs, "failed": vote.failed, "objectives": search.expected}
    return {**told, "noise": search.noise} if search.noise else told


def _flat_engine_run(run: EngineRun | None) -> dict[str, Any] | None:
    if run is None:
        return None
    data: dict[str, Any] = codec.encode(run)
    data.pop("vote", None)
    return {**data, "jittered": _flat_vote(run.vote)} if run.vote is not None else data
