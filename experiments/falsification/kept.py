"""What searches and pools came to, kept when their directories are gone.

A suite takes more hours than one machine or session has. ``suite keep`` writes rows of what there
is in a directory into files of the repository; ``suite table`` counts these, too.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from experiments.falsification.pairs import Pair
from experiments.falsification.pools import Pool, pool_of, pool_outcomes, read_draws
from mrta_falsify.campaigns.journal import read_rows
from mrta_falsify.campaigns.store import SETTINGS
from mrta_falsify.campaigns.survival import SearchCost
from mrta_falsify.core import codec
from mrta_falsify.commands.search_outcomes import SearchOutcome, search_outcome
from mrta_falsify.commands.stored_trials import open_campaign

KEPT = "searches.jsonl"
KEPT_POOLS = "pools.jsonl"
RANDOM = "random"
Key = tuple[str, str, bool, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """What one search came to."""

    pair: str
    sampler: str
    knife_edges: bool  #: whether they count as failures
    seed: int  #: of the search; of ``random`` its place in the pool
    code: str  #: version that proposed
    outcome: SearchOutcome

    @property
    def key(self) -> Key:
        """What tells searches apart; a pool has so many, hence their seeds come last."""
        return self.pair, self.sampler, self.knife_edges, self.seed

    def within(self, budget: int) -> SearchOutcome:
        """Say what it came to in ``budget`` simulations."""
        if self.outcome.simulations.spent <= budget:
            return self.outcome
        cut = SearchCost(spent=float(budget), found=False)
        return dataclasses.replace(self.outcome, simulations=cut, trials=budget, modes=())


def keep(pairs: Iterable[Pair], options: argparse.Namespace) -> None:
    """Write rows of the directory's searches and pools; those of the same ones are replaced."""
    pairs = list(pairs)
    options.output.mkdir(parents=True, exist_ok=True)
    searches, pools = all_searches(pairs, options), all_pools(pairs, options)
    for name, found in ((KEPT, searches), (KEPT_POOLS, pools)):
        rows = [json.dumps(codec.encode(row)) for _, row in sorted(found.items())]
        (options.output / name).write_text("".join(f"{row}\n" for row in rows))
        print(f"{options.output / name}: {len(rows)} rows")


def all_pools(pairs: Iterable[Pair], options: argparse.Namespace) -> dict[str, Pool]:
    """Read the pools that were kept, and those of the directory in their place, by pair.

    Raises:
        InputError: a row has other fields.
    """
    path = options.output / KEPT_POOLS
    kept = (codec.decode(Pool, row, where=str(path)) for row in read_rows(path))
    found = {pool.pair: pool for pool in kept}
    for pair in pairs:
        if draws := read_draws(options.directory, pair):
            found[pair.name] = pool_of(pair.name, draws.records)
    return found


def all_searches(pairs: Iterable[Pair], options: argparse.Namespace) -> dict[Key, Search]:
    """Read the searches that were kept, and those of the directory.

    Raises:
        InputError: a row has other fields.
    """
    path = options.output / KEPT
    found = {
        of.key: of for of in (codec.decode(Search, r, where=str(path)) for r in read_rows(path))
    }
    found.update({of.key: of for pair in pairs for of in _searches_of(pair, options)})
    return found


def _searches_of(pair: Pair, options: argparse.Namespace) -> Iterator[Search]:
    """Read a pair's searches; pools are cut into searches of ``random``."""
    root = options.directory / "searches" / pair.name
    campaigns = {
        (path.parent.parent.name, int(path.parent.name)): open_campaign(path.parent)
        for path in sorted(root.glob(f"*/*/{SETTINGS}"))
    }
    draws = read_draws(options.directory, pair)
    for knife_edges in (False, True):
        how = {"budget": options.budget, "knife_edges": knife_edges}
        found = {key: search_outcome(of, **how) for key, of in campaigns.items() if of.records}
        if draws is not None:
            found = {key: of for key, of in found.items() if key[0] != RANDOM}
            found |= {(RANDOM, place): of for place, of in enumerate(pool_outcomes(draws, **how))}
        for (sampler, seed), outcome in found.items():
            yield Search(
                pair=pair.name,
                sampler=sampler,
                knife_edges=knife_edges,
                seed=seed,
                code=options.code,
                outcome=outcome,
            )
