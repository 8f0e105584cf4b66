"""Every choreography by name."""

from __future__ import annotations

from collections.abc import Callable

from afford.synthetic.kitchens import scripts_hard, scripts_kitchen, scripts_tools
from afford.synthetic.kitchens.cast import Cast

SCRIPTS: dict[str, Callable[[Cast], None]] = {
    "carry": scripts_kitchen.carry_one,
    "carry_both": scripts_kitchen.carry_both,
    "carry_two": scripts_kitchen.carry_two,
    "parallax": scripts_kitchen.carry_far,
    "pour": scripts_kitchen.pour,
    "open_jar": scripts_kitchen.open_jar,
    "cut": scripts_kitchen.cut,
    "stir": scripts_kitchen.stir,
    "hand_over": scripts_kitchen.hand_over,
    "hammer": scripts_tools.hammer,
    "screw": scripts_tools.screw,
    "fetch_tool": scripts_tools.fetch_tool,
    "fetch_item": scripts_tools.fetch_item,
    "tidy_desk": scripts_tools.tidy_desk,
    "never_free": scripts_hard.never_free,
    "turn_over": scripts_hard.turn_over,
    "open_hinged": scripts_hard.open_hinged,
    "dart": scripts_hard.dart,
}
STRONG_PARALLAX = ("parallax",)


def script(name: str) -> Callable[[Cast], None]:
    """The choreography of this name; ValueError lists the names."""
    if name not in SCRIPTS:
        raise ValueError(f"SceneSpec.script: unknown script {name!r}; choose one of {', '.join(sorted(SCRIPTS))}")
    return SCRIPTS[name]
