"""Planted defects take the place of parts, alone and together, and parts know nothing of it."""

from __future__ import annotations

import pytest

from mrta_falsify.core.defects import defect, defect_names, with_defects
from mrta_falsify.core.errors import UnknownNameError
from mrta_falsify.stack.control.cluster import ClusterCbf
from mrta_falsify.stack.control.decentralised import DecentralisedCbf
from mrta_falsify.stack.resources.queue import Queue


def test_a_part_that_no_defect_concerns_is_itself():
    assert with_defects(Queue, ()) is Queue
    assert with_defects(Queue, ("follower_zero_command",)) is Queue
    assert with_defects(DecentralisedCbf, ("follower_zero_command",)) is DecentralisedCbf


def test_several_defects_of_one_part_are_planted_together():
    faulty = with_defects(ClusterCbf, ("humans_unseen_beyond_two", "fixed_priority_starves"))
    assert issubclass(faulty, ClusterCbf)
    parts = {
        cls
        for name in ("humans_unseen_beyond_two", "fixed_priority_starves")
        for sound, cls in defect(name).parts.items()
        if sound is ClusterCbf
    }
    assert parts <= set(faulty.__mro__)
    assert faulty is with_defects(
        ClusterCbf, ("fixed_priority_starves", "humans_unseen_beyond_two")
    )


def test_a_part_of_a_user_that_derives_from_ours_gets_the_fault():
    class Mine(ClusterCbf):
        pass

    assert issubclass(with_defects(Mine, ("follower_zero_command",)), Mine)


def test_every_defect_has_a_layer_and_parts_of_their_class():
    for name in defect_names():
        planted = defect(name)
        assert planted.layer
        assert planted.parts
        assert all(issubclass(faulty, sound) for sound, faulty in planted.parts.items())


def test_an_unknown_defect_is_told_with_those_there_are():
    with pytest.raises(UnknownNameError, match="unknown defect 'sloth'"):
        defect("sloth")
