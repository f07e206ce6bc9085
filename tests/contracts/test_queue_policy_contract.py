"""What every registered queue policy keeps."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrta_falsify.core import registry
from mrta_falsify.core.config import Choice
from mrta_falsify.core.protocols import QueuePolicy, Waiter

NAMES = registry.names("queue_policy")
NUMBERS = st.floats(0.0, 1000.0)
WAITERS = st.lists(
    st.builds(
        Waiter,
        robot=st.integers(0, 30),
        since=NUMBERS,
        distance=NUMBERS,
        deadline=NUMBERS | st.just(float("inf")),
    ),
    unique_by=lambda waiter: waiter.robot,
    max_size=8,
)


@pytest.mark.parametrize("name", NAMES)
class TestQueuePolicy:
    def test_it_offers_the_protocol(self, name):
        assert isinstance(registry.build("queue_policy", Choice(name)), QueuePolicy)

    @given(waiters=WAITERS)
    def test_nobody_is_lost_and_nobody_is_added(self, name, waiters):
        order = registry.build("queue_policy", Choice(name)).order(waiters)
        assert sorted(order) == sorted(waiter.robot for waiter in waiters)

    @given(waiters=WAITERS, random=st.randoms(use_true_random=False))
    def test_the_order_does_not_depend_on_how_waiters_are_listed(self, name, waiters, random):
        policy = registry.build("queue_policy", Choice(name))
        shuffled = list(waiters)
        random.shuffle(shuffled)
        assert policy.order(shuffled) == policy.order(waiters)
