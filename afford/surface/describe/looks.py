"""Short descriptions of the shape of parts, in words that mean the same for every object.

A scorer that has never seen a nozzle can still find a short tube at the end.
"""

from __future__ import annotations

LOOKS = {
    "handle": "a long thick bar at the end", "blade": "a long flat thin plate at the end", "head": "a small block across the end",
    "bolster": "a short ring in the middle", "ferrule": "a short ring in the middle", "guard": "a short wide ring in the middle",
    "bristles": "many short thin wires at the end", "face": "a short thick cylinder across the end",
    "claw": "a curved flat wedge across the end", "shaft": "a long thin rod at the end", "tip": "a small point at the very end",
    "chuck": "a short cone at the end", "bit": "a thin rod at the very end", "body": "a large round vessel",
    "battery": "a large box at the bottom", "trigger": "a small block on the side", "switch": "a small block on the side",
    "rim": "a thin ring around the top", "spout": "a curved tube on the side", "opening": "a small ring at the end of a tube",
    "lid": "a flat round disc on top", "knob": "a small ball on top", "plate": "a large flat plate at the bottom",
    "cord": "a thin curved wire at the end", "dial": "a small disc on top", "nozzle": "a short thick tube at the end",
    "tines": "thin pointed rods at the end", "neck": "a short thin bar in the middle", "bowl": "a round hollow bowl at the end",
    "pivot": "a small disc in the middle", "jaw": "two short thick hooks at the end", "wheel": "a thin round disc at the end",
    "roller": "a thick cylinder across the end", "foot": "a flat round disc at the bottom", "stem": "a thin rod in the middle",
    "holder": "a round dish at the bottom", "wick": "a small thin rod at the top", "lens": "a flat round disc at the very end",
}  # fmt: skip
"""shape of a part on most objects"""
LOOKS_OF = {
    ("mug", "handle"): "a small loop on the side", ("kettle", "handle"): "a loop on top", ("iron", "handle"): "a thick loop on top",
    ("pot", "handle"): "small loops on both sides", ("drill", "handle"): "a thick bar below",
    ("hair_dryer", "handle"): "a thick bar below", ("scissors", "handle"): "rings at the end",
    ("saw", "handle"): "a thick block with a hole at the end", ("ladle", "handle"): "a long thin bar at the end",
    ("razor", "handle"): "a thin bar at the end", ("soldering_iron", "handle"): "a thick bar in the middle",
    ("cleaver", "blade"): "a large flat thin plate at the end", ("axe", "blade"): "a flat wedge across the end",
    ("trowel", "blade"): "a wide flat thin plate at the end", ("razor", "blade"): "small flat thin plates across the end",
    ("brush", "head"): "a wide flat plate at the end", ("spatula", "head"): "a wide flat thin plate at the end",
    ("spatula", "shaft"): "a long thin rod in the middle", ("soldering_iron", "shaft"): "a thin rod at the end",
    ("drill", "body"): "a thick cylinder on top", ("hair_dryer", "body"): "a thick cylinder on top",
    ("iron", "body"): "a large dome in the middle", ("pan", "body"): "a large round shallow vessel at the end",
    ("fork", "neck"): "a flat short plate in the middle",
    ("toothbrush", "head"): "a small flat plate at the end", ("toothbrush", "neck"): "a thin rod in the middle",
    ("toothbrush", "bristles"): "many short thin wires on a small plate", ("shovel", "handle"): "a bar or loop across the end",
    ("shovel", "shaft"): "a long thick rod in the middle", ("shovel", "blade"): "a wide flat curved plate at the end",
    ("pliers", "handle"): "two long curved bars at the end", ("pliers", "jaw"): "two short pointed wedges at the end",
    ("wrench", "handle"): "a long flat bar at the end", ("wine_glass", "bowl"): "a large round hollow bowl on top",
    ("teapot", "handle"): "a loop or bar on the side", ("spray_bottle", "body"): "a large tall block at the bottom",
    ("spray_bottle", "neck"): "a short ring in the middle", ("spray_bottle", "head"): "a small block on top",
    ("spray_bottle", "trigger"): "a thin curved bar on the side", ("flashlight", "body"): "a long thick cylinder at the end",
    ("flashlight", "head"): "a short wide tube at the end", ("candle", "handle"): "a small loop or bar on the side",
    ("candle", "body"): "a tall thick rod on top", ("pizza_cutter", "neck"): "flat short bars in the middle",
    ("paint_roller", "shaft"): "a thin bent wire in the middle", ("rolling_pin", "handle"): "short thick bars at both ends",
    ("rolling_pin", "roller"): "a long thick cylinder in the middle",
}  # fmt: skip
"""(object, part) -> shape, where it differs from `LOOKS`"""
PARTS = {
    "axe": "handle head blade", "brush": "handle head bristles", "candle": "holder handle body wick",
    "chisel": "handle ferrule blade", "cleaver": "handle blade", "drill": "battery handle body trigger chuck bit",
    "flashlight": "body switch head lens", "fork": "handle neck tines", "hair_dryer": "cord handle switch body nozzle",
    "hammer": "handle head face claw", "iron": "plate body handle dial cord", "kettle": "handle body lid knob spout opening",
    "knife": "handle bolster blade", "ladle": "handle bowl", "mug": "handle body rim", "paint_roller": "handle shaft roller",
    "pan": "handle neck body", "pizza_cutter": "handle guard neck wheel", "pliers": "handle pivot jaw",
    "pot": "handle body lid knob", "razor": "handle head blade", "rolling_pin": "handle roller", "saw": "handle blade",
    "scissors": "handle blade pivot", "screwdriver": "handle shaft tip", "shovel": "handle shaft blade",
    "soldering_iron": "cord handle guard shaft tip", "spatula": "handle shaft head",
    "spray_bottle": "body neck head trigger nozzle", "teapot": "handle body lid knob spout",
    "toothbrush": "handle neck head bristles", "trowel": "handle neck blade", "wine_glass": "foot stem bowl rim",
    "wrench": "handle jaw",
}  # fmt: skip
"""parts of each object category"""
WHOLE = {"pliers": "a pair of pliers", "scissors": "a pair of scissors"}


def part_phrase(kind: str, part: str) -> str:
    """Describe a part, e.g. 'the blade of a saw, a long flat thin plate at the end'; KeyError for an unknown one."""
    return word_phrase(kind, part, LOOKS_OF.get((kind, part)) or LOOKS[part])


def word_phrase(kind: str, part: str, looks: str) -> str:
    """Describe any part of any object: its name before the first comma, its shape after it."""
    whole = kind.replace("_", " ")
    article = "an" if whole[0] in "aeiou" else "a"
    return f"the {part.replace('_', ' ')} of {WHOLE.get(kind, f'{article} {whole}')}, {looks}"
