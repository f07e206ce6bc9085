"""Certificates of the deadlocks of a campaign."""

from __future__ import annotations

from dataclasses import dataclass

from mrta_falsify.analysis.certify.certifying import certify
from mrta_falsify.campaigns.finding_files import write_finding
from mrta_falsify.campaigns.store import Campaign
from mrta_falsify.commands.folders import Place
from mrta_falsify.commands.made_again import keep_run
from mrta_falsify.commands.stored_trials import open_campaign
from mrta_falsify.commands.trust import Trust, open_to_run
from mrta_falsify.core.errors import InputError
from mrta_falsify.core.findings import Certificate
from mrta_falsify.core.record import TrialRecord
from mrta_falsify.lab.stored import TRACE_NAME
from mrta_falsify.specs.causes import DEADLOCK

NO_TRACE = "its trace was not kept; `--run` makes it again"


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifiedTrial:
    """A trial with a deadlock, and its certificate."""

    id: str
    certificate: Certificate | None
    missing: str = ""  #: why there is none


def certify_trials(
    directory: Place, id: str | int | None = None, *, run: bool = False, trust: Trust = False
) -> tuple[CertifiedTrial, ...]:
    """Look for certificates of confirmed deadlocks, and write them beside their trials.

    Args:
        directory: of the campaign.
        id: of a trial; all trials with a deadlock if None.
        run: make again the worlds and traces that were not kept.
        trust: then run what is not ours, though somebody else has made the campaign.

    Raises:
        InputError: not a campaign, no such trial, or no deadlock in it.
    """
    campaign = open_to_run(directory, trust) if run else open_campaign(directory)
    if id is None:
        records = [record for record in campaign.records if _members(record)]
    else:
        records = [campaign.record(str(id))]
        if not _members(records[0]):
            raise InputError(f"trial {records[0].id}: has no confirmed deadlock to certify")
    for record in records if run else ():
        keep_run(campaign, record, trust)
    return tuple(_certified(campaign, record) for record in records)


def _members(record: TrialRecord) -> tuple[str, ...]:
    found = [v for v in record.verdicts if v.spec == DEADLOCK and v.violated]
    return found[0].who if found else ()


def _certified(campaign: Campaign, record: TrialRecord) -> CertifiedTrial:
    folder = campaign.folder(record)
    if not (folder / TRACE_NAME).is_file():
        return CertifiedTrial(id=record.id, certificate=None, missing=NO_TRACE)
    sought = certify(folder, _members(record))
    if sought.certificate is not None:
        write_finding(folder, sought.certificate)
    return CertifiedTrial(id=record.id, certificate=sought.certificate, missing=sought.missing)
