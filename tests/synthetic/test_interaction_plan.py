"""Plan of interactions: shares of affordances, two affordances per object type, disjoint splits."""

from __future__ import annotations

from collections import Counter

import pytest

from afford.dataset.affordance_rules import AFFORDANCE_RULES, SHARES
from schemas.interaction import AFFORDANCES, CODE_ORDER, COLOURS_BGR, OBJECT_TYPES
from stages.synthetic import interaction_plan

SPECS = interaction_plan.run(interaction_plan.Params())


def test_object_types_have_two_affordances_each() -> None:
    """The paper requires at least two; both the rules and the plan satisfy it."""
    assert tuple(AFFORDANCE_RULES) == OBJECT_TYPES
    assert set().union(*AFFORDANCE_RULES.values()) == set(AFFORDANCES) == set(CODE_ORDER) == set(COLOURS_BGR) == set(SHARES)
    for split in ("train", "val"):
        seen = {kind: {s.affordance for s in SPECS if (s.split, s.object_type) == (split, kind)} for kind in OBJECT_TYPES}
        assert min(map(len, seen.values())) >= 2, seen


def test_splits_share_no_instance_person_or_seed() -> None:
    """Instances, their seeds, people, names and sequence seeds are disjoint."""
    train, val = ([s for s in SPECS if s.split == split] for split in ("train", "val"))
    assert (len(train), len(val)) == (360, 60)
    for field in ("instance", "instance_seed", "subject", "name", "seed"):
        assert not {getattr(s, field) for s in train} & {getattr(s, field) for s in val}, field
    assert len({s.name for s in SPECS}) == len({s.seed for s in SPECS}) == len(SPECS)


def test_affordances_follow_their_shares() -> None:
    """Counts are as close to the shares as integers allow, for plans of any length."""
    for count in (9, 100, 240):
        plan = interaction_plan.run(interaction_plan.Params(train=count, val=0))
        found = Counter(spec.affordance for spec in plan)
        total = sum(SHARES.values())
        assert all(abs(found[name] - count * share / total) <= 1 for name, share in SHARES.items()), found


def test_instances_have_several_affordances() -> None:
    """An instance alone does not reveal the affordance."""
    uses: dict[str, set[str]] = {}
    for spec in SPECS:
        uses.setdefault(spec.instance, set()).add(spec.affordance)
    assert sum(len(names) > 1 for names in uses.values()) > len(uses) / 2


def test_empty_plan_is_refused() -> None:
    """The error is one sentence."""
    with pytest.raises(ValueError, match="interaction_plan: expected at least one sequence"):
        interaction_plan.run(interaction_plan.Params(train=0, val=0))
