"""What a stack did wrong beside driving badly, in plain words."""

from __future__ import annotations

from mrta_falsify.core.external import Coupling
from mrta_falsify.core.verdict import Verdict

#: what a layer, or the stack, did, by the kind of its failure
DID = {
    "crash": "crashed",
    "hang": "hung",
    "memory": "took too much memory",
    "answer": "answered nonsense",
}
#: where answers that differ usually come from
NOISE = (
    "Usual sources: threads, clocks, random numbers without a seed, the order of sets (hash seeds)."
)
_OTHERWISE = "the same run again may go otherwise"
#: what each coupling of a stack to simulated time means
COUPLED: dict[Coupling, str] = {
    "stepped": "stepped: it answered when all of a tick's work was done",
    "awaited": f"awaited: it waited for its parts, up to a limit; {_OTHERWISE}",
    "paced": f"paced: its parts ran by the clock on the wall; {_OTHERWISE}",
}


def coupling_facts(coupling: Coupling | None) -> tuple[tuple[str, str], ...]:
    """Say how tightly a stack in a process of its own was coupled; nothing of the shipped one."""
    return (("coupling", COUPLED[coupling]),) if coupling is not None else ()


def stack_failure_sentence(verdict: Verdict) -> str:
    """Say how the stack failed to answer a tick, and where in its code.

    Args:
        verdict: violated, of ``stack_runs``.
    """
    evidence = verdict.evidence
    who = str(evidence.get("layer") or "stack").replace("_", " ")
    what = DID.get(str(evidence.get("kind")), "failed")
    exception, message = evidence.get("exception", ""), evidence.get("message", "")
    is_named = evidence.get("kind") == "crash" and exception and exception not in message
    why = f"{exception}: {message}" if is_named and message else message or exception
    frames = evidence.get("frames") or []
    where = f" ({frames[-1]})" if frames else ""
    when = f" at {verdict.violated_at:.2f} s" if verdict.violated_at is not None else ""
    return f"The {who} {what}{when}{f': {why}' if why else ''}{where}."


def repeated_sentence(verdict: Verdict) -> str:
    """Say which answer differed when the stack was asked again.

    Args:
        verdict: violated, of ``repeatable``.
    """
    evidence = verdict.evidence
    of = f" of {evidence['robot']}" if evidence.get("robot") else ""
    when = f" at {verdict.violated_at:.2f} s" if verdict.violated_at is not None else ""
    tick = f" (tick {evidence['tick']})" if "tick" in evidence else ""
    return (
        f"Asked the same again{when}{tick}, the stack answered otherwise: {evidence['field']}{of} "
        f"was {evidence['first']} and then {evidence['again']}. {NOISE}"
    )
