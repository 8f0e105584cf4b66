"""Sets of composite clips: specifications by set name, of increasing difficulty, with everything drawn from one seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.hands.pasted import CompositeSpec, gloved

SCRIPTS = (("pour", "kitchen"), ("carry", "kitchen"), ("stir", "kitchen"), ("carry_both", "kitchen"), ("hammer", "workshop"),
           ("hand_over", "kitchen"), ("tidy_desk", "desk"), ("cut", "kitchen"), ("screw", "workshop"), ("open_jar", "kitchen"),
           ("carry_two", "kitchen"))  # fmt: skip


def composites(seed: int, prefix: str = "c") -> tuple[CompositeSpec, ...]:
    """Return 32 clips: both viewpoints and backgrounds, still and moving, small, one and no hand, gloves, dark, blurred, free."""
    kinds: list[dict[str, object]] = [
        {}, {"viewpoint": "facing"}, {"background": "scene"}, {"viewpoint": "facing", "background": "scene", "zoom": 0.7},
        {"moving": True}, {"viewpoint": "facing", "zoom": 0.45}, {"background": "scene", "moving": True, "crf": 34},
        {"viewpoint": "facing", "hands": 1}, {"hands": 0, "moving": True, "face": True},
        {"light": 0.28, "background": "scene"}, {"blur": 5, "frames": 24, "moving": True}, {"hands": 1, "zoom": 0.7},
        {"viewpoint": "facing", "face": True, "moving": True}, {"glove": True}, {"zoom": 1.6, "moving": True},
        {"viewpoint": "facing", "background": "scene", "hands": 0, "face": True},
        {"viewpoint": "facing", "light": 0.3}, {"background": "scene", "zoom": 0.6, "moving": True, "face": True},
        {"viewpoint": "facing", "blur": 4, "frames": 24, "crf": 32}, {"viewpoint": "facing", "background": "scene", "glove": True},
        {"free": True, "contrast": 1.4}, {"free": True, "contrast": 1.6, "background": "scene", "moving": True},
        {"contrast": 1.5}, {"free": True, "contrast": 1.3, "moving": True, "zoom": 0.75}, {"contrast": 1.6, "background": "scene"},
        {"free": True, "viewpoint": "facing", "contrast": 1.4}, {"free": True, "hands": 1, "contrast": 1.5, "face": True},
        {"contrast": 1.4, "moving": True, "zoom": 0.7}, {"free": True, "contrast": 1.5, "zoom": 1.5, "background": "scene"},
        {"contrast": 1.5, "hands": 1, "background": "scene", "crf": 32}, {"free": True, "contrast": 1.5, "zoom": 0.5},
        {"free": True, "viewpoint": "facing", "contrast": 1.6, "zoom": 0.55, "background": "scene", "moving": True},
    ]  # fmt: skip
    out = []
    for n, kind in enumerate(kinds):
        script, setting = SCRIPTS[(n * 3 + n // 11) % len(SCRIPTS)]
        own = int(np.random.SeedSequence([seed, n]).generate_state(1)[0] >> 1)
        wears = kind.pop("glove", False)
        spec = replace(CompositeSpec(f"{prefix}{n + 1:02d}", script, setting, own), **kind)  # type: ignore[arg-type]
        out.append(gloved(spec) if wears else spec)
    return tuple(out)
