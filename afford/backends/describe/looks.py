"""What parts look like, in few words that mean the same of every thing: who never saw a nozzle knows a short tube at the end."""

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
    "pivot": "a small disc in the middle",
}  # fmt: skip
"""Parts, as most things have them."""
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
}  # fmt: skip
"""Parts that look otherwise on one thing."""
PARTS = {
    "axe": "handle head blade", "brush": "handle head bristles", "chisel": "handle ferrule blade", "cleaver": "handle blade",
    "drill": "battery handle body trigger chuck bit", "fork": "handle neck tines", "hair_dryer": "cord handle switch body nozzle",
    "hammer": "handle head face claw", "iron": "plate body handle dial cord", "kettle": "handle body lid knob spout opening",
    "knife": "handle bolster blade", "ladle": "handle bowl", "mug": "handle body rim", "pan": "handle neck body",
    "pot": "handle body lid knob", "razor": "handle head blade", "saw": "handle blade", "scissors": "handle blade pivot",
    "screwdriver": "handle shaft tip", "soldering_iron": "cord handle guard shaft tip", "spatula": "handle shaft head",
    "trowel": "handle neck blade",
}  # fmt: skip
"""What things are made of."""
WHOLE = {"scissors": "a pair of scissors"}


def phrase(kind: str, part: str) -> str:
    """A part in words, e.g. 'the blade of a saw, a long flat thin plate at the end'; KeyError for one that is not in the table."""
    whole = kind.replace("_", " ")
    article = "an" if whole[0] in "aeiou" else "a"
    return f"the {part} of {WHOLE.get(kind, f'{article} {whole}')}, {LOOKS_OF.get((kind, part)) or LOOKS[part]}"
