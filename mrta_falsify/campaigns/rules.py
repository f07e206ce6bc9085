"""The rules by which the trials of a campaign were drawn and judged, by number.

A campaign stores the number of its rules; without one it is 1. Campaigns of earlier rules are read,
replayed and run again, with the verdicts that they stored, and compared in their own form of the
signature. They do not go on: a campaign of two rules would count two things as one.

1. Robots that stand are one kind of failure. Up to commit 73399d2.
2. Deadlock, stuck and shut by the world are told apart. Up to commit 6271a96.
3. Scenic's pruning no longer draws position and orientation of an object apart, so a point of the
   cube may be another world (:mod:`scenic_worlds.compiling`). Judged as by rules 2.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrta_falsify.campaigns.signature import signature, signature_before
from mrta_falsify.core.verdict import Verdict

RULES = 3
JUDGED_SINCE = 2  #: rules from which on runs are judged and signed as today
LAST_COMMIT = {1: "73399d2", 2: "6271a96"}  #: that has earlier rules, by their number


def signed(verdicts: Sequence[Verdict], rules: int) -> str:
    """Write the signature of a run in the form of a campaign's rules.

    Args:
        verdicts: of one run.
        rules: number of the campaign's rules.
    """
    return signature_before(verdicts) if rules < JUDGED_SINCE else signature(verdicts)


def why_no_resume(rules: int) -> str:
    """Say why a campaign of some rules cannot go on; empty if it can."""
    if rules == RULES:
        return ""
    if rules > RULES:
        return (
            f"a newer version began it (rules {rules}, this version has {RULES}); update to go on"
        )
    return (
        f"it was begun with rules {rules}, this version has rules {RULES}, so it cannot go on; "
        f"the last commit that can is {LAST_COMMIT[rules]}. It can still be listed, shown, "
        "reported, replayed and run again by corpus; or begin one in another directory"
    )
