"""What a certificate proves, in sentences."""

from __future__ import annotations

from pathlib import Path

from mrta_falsify.analysis.certify import checker
from mrta_falsify.analysis.certify.certifying import REFUSALS
from mrta_falsify.campaigns.finding_files import read_finding
from mrta_falsify.core import codec
from mrta_falsify.core.findings import Certificate, CertifiedMember
from mrta_falsify.core.words import listed

ASSUMED = (
    "This follows from World and trace if robots are discs of their radius, robots without work "
    "stay, no robot enters a full area, and goals are as the stack reports them."
)


def claim_sentences(certificate: Certificate) -> tuple[str, ...]:
    """Say what a certificate proves: who waits for whom, and what is assumed."""
    members = certificate.members
    who = listed([member.name for member in members])
    alone = len(members) == 1
    stands = "stands" if alone else "stand, and wait for each other in a closed circle"
    return (
        f"Certified: from {certificate.since:.1f} s on {who} {stands}.",
        *(_reason_sentence(member) for member in members),
        ASSUMED,
    )


def _reason_sentence(member: CertifiedMember) -> str:
    others = listed(member.robots)
    if member.area:
        fill = "fills" if len(member.robots) == 1 else "fill"
        return f"{member.name} wants to enter {member.area}, which {others} {fill}."
    if others:
        return f"{member.name} has no way to its goal past {others}."
    return f"{member.name} has no way to its goal past solids."


def read_certificate(folder: Path) -> Certificate | None:
    """Read the certificate beside a trial, if there is one that the checker accepts.

    Raises:
        InputError: the file cannot be read.
    """
    found = read_finding(folder, Certificate)
    if found is None:
        return None
    try:
        checker.accept(folder, codec.encode(found))
    except REFUSALS:
        return None
    return found
