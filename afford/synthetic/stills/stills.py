"""A StillSpec -> its stills: lay things out, take pictures, ask for things, and find every way to do them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from afford.common.encode import jpeg
from afford.synthetic.kitchens.epic_files import narration
from afford.synthetic.kitchens.scene_builder import plain_name
from afford.synthetic.stills.still_draw import Shot, Sizes, shoot
from afford.synthetic.stills.still_plans import Plan, plans, weights
from afford.synthetic.stills.still_sets import is_asked, is_new
from afford.synthetic.stills.still_tasks import Act, acts
from afford.synthetic.stills.still_ways import Reach
from afford.synthetic.stills.still_world import Layout, StillWorld
from schemas.scene import Mode, Picture, Still, Stills, StillSpec
from schemas.video import Narration

LEAST_AREA = 0.0005
"""A smaller affordance, as a share of the picture, is no lesson."""
LEAST_SEEN = 0.55
"""Share of a thing that must be in sight for it to be asked for."""
SAME = 0.8
"""Two ways whose masks overlap so much (IoU) look the same."""


@dataclass(frozen=True)
class Quality:
    """How pictures are made and kept."""

    sizes: Sizes
    supersample: int
    jpeg_quality: int


def stills(spec: StillSpec, quality: Quality, progress: Callable[[int, int], None]) -> Stills:
    """All stills of a spec."""
    world = StillWorld(spec)
    images: list[Picture] = []
    found: list[Still] = []
    for _ in range(spec.layouts):
        layout = world.layout()
        reach, names = Reach(layout.things), {thing.number: plain_name(thing.model.noun) for thing in layout.things}
        wanted = [act for act in acts(layout.things, names) if is_asked(spec.asks, is_new(act.verb, act.kinds))]
        for _ in range(spec.views):
            shot = shoot(world, layout, quality.sizes, quality.supersample)
            for act, modes in _asked(world, layout, shot, reach, wanted):
                number = len(found) + 1
                said = _said(spec.video_id, number, act)
                found.append(Still(number, len(images), said, act.kinds, is_new(act.verb, act.kinds), modes))
            images.append(Picture(jpeg(shot.rgb, quality.jpeg_quality)))
            progress(len(images), spec.layouts * spec.views)
    width, height = quality.sizes.image
    person = spec.video_id.rpartition("_")[0]
    return Stills(spec.video_id, person, spec.split, spec.setting, width, height, tuple(images), tuple(found))


Asked = tuple[Act, tuple[Mode, ...]]


def _asked(world: StillWorld, layout: Layout, shot: Shot, reach: Reach, wanted: list[Act]) -> Iterator[Asked]:
    """Up to `spec.tasks` tasks of one picture, one per verb and things, with their modes; what cannot be done is left out."""
    seen = _in_sight(layout, shot)
    for act in _by_turns([act for act in wanted if all(thing.number in seen for thing in act.things)], world.rng, world.spec.tasks):
        modes = _modes(world, shot, plans(act, reach), seen)
        if modes:
            yield act, modes


def _by_turns(wanted: list[Act], rng: np.random.Generator, most: int) -> list[Act]:
    """At most `most` acts, no verb with the same things twice: those that may take two hands and those that take one by turns,
    and among these every verb with the same chance.
    """
    groups: dict[bool, dict[tuple[str, int], list[Act]]] = {True: {}, False: {}}
    for k in rng.permutation(len(wanted)):
        act = wanted[k]
        groups[act.support is not None].setdefault((act.verb, len(act.things)), []).append(act)
    chosen: dict[tuple[object, ...], Act] = {}
    two = bool(rng.random() < 0.5)
    while len(chosen) < most and any(groups.values()):
        two = not two if groups[not two] else two
        names = list(groups[two])
        name = names[int(rng.integers(len(names)))]
        act = groups[two][name].pop()
        if not groups[two][name]:
            del groups[two][name]
        chosen.setdefault((act.verb, *(thing.number for thing in act.things)), act)
    return list(chosen.values())


def _in_sight(layout: Layout, shot: Shot) -> dict[int, np.ndarray]:
    """Complete masks (h, w) of the things that can be recognised, by number."""
    out = {}
    for thing in layout.things:
        mask = shot.complete(thing.model.instances(thing.T_world_obj, thing.number))
        if mask.any() and np.count_nonzero(shot.ids == thing.number) > LEAST_SEEN * np.count_nonzero(mask):
            out[thing.number] = mask
    return out


def _modes(world: StillWorld, shot: Shot, chosen: list[Plan], complete: dict[int, np.ndarray]) -> tuple[Mode, ...]:
    """The plans as masks; those that cannot be seen well or that look like a more comfortable one are left out."""
    kept: list[tuple[Plan, np.ndarray]] = []
    for plan in chosen:
        masks = _masks(world, shot, plan, complete)
        if _shows(plan, masks) and not any(plan.taxonomy == p.taxonomy and _iou(masks, m) > SAME for p, m in kept):
            kept.append((plan, masks))
    if not kept:
        return ()
    shares = weights(plan for plan, _ in kept)
    return tuple(_mode(plan, masks, float(share)) for (plan, masks), share in zip(kept, shares, strict=True))


def _masks(world: StillWorld, shot: Shot, plan: Plan, complete: dict[int, np.ndarray]) -> np.ndarray:
    """(4, h, w) bool: affordance left, right = complete object AND visible hand; complete object left, right."""
    hands = shot.hands(world, plan.ways)
    empty = np.zeros_like(hands[0])
    things = np.stack([complete[way.thing.number] if way else empty for way in plan.ways])
    return np.concatenate([hands & things, things])


def _shows(plan: Plan, masks: np.ndarray) -> bool:
    """Whether every hand that takes part is seen well enough on its thing, and not at the border of the picture."""
    for way, mask in zip(plan.ways, masks, strict=False):
        cut = mask[[0, -1]].any() or mask[:, [0, -1]].any()
        if way is not None and (cut or np.count_nonzero(mask) < LEAST_AREA * mask.size):
            return False
    return True


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a[:2] & b[:2]).sum() / max(int((a[:2] | b[:2]).sum()), 1))


def _mode(plan: Plan, masks: np.ndarray, weight: float) -> Mode:
    left, right = ((plain_name(way.thing.model.noun), way.grip.name) if way else ("", "") for way in plan.ways)
    return Mode(masks, (left[0], right[0]), (left[1], right[1]), plan.taxonomy, weight)


def _said(video_id: str, number: int, act: Act) -> Narration:
    """The narration; its nouns in the order in which they are said."""
    nouns = sorted((thing.model.noun for thing in act.things), key=lambda noun: act.text.find(plain_name(noun)))
    return narration(video_id, number, (number, number), act.text, act.verb, tuple(nouns))
