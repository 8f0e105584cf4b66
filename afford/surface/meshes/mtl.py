"""MTL material files: the colour or the image of each material."""

from __future__ import annotations

import numpy as np

from afford.common.errors import SourceError
from afford.surface.meshes.files import PictureCache, decode_text, find_reference
from afford.surface.meshes.surface import GREY
from schemas.files import FileRef, FileTree

OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1, "-boost": 1, "-bm": 1}
"""options of `map_Kd` that change no colour -> how many words follow them"""


def image_name(rest: str, where: str) -> str:
    """File name in the value of `map_Kd`; SourceError for options that move or scale the image."""
    words = rest.split()
    while words and words[0].startswith("-"):
        if words[0] not in OPTIONS:
            raise SourceError(where, f"map_Kd with no options but {', '.join(OPTIONS)}", words[0],
                              "apply it to the texture coordinates when exporting")
        words = words[1 + OPTIONS[words[0]]:]
    if not words:
        raise SourceError(where, "a file name after map_Kd", "nothing", "name the image or remove the line")
    return " ".join(words)


def mtl_statements(content: str) -> list[tuple[int, str, str]]:
    """Line number, key word and the rest of every line that says something."""
    split = [(number, *line.strip().partition(" ")[::2]) for number, line in enumerate(content.replace("\t", " ").splitlines(), 1)]
    return [(number, word, rest.strip()) for number, word, rest in split if word and not word.startswith("#")]


def read_mtl(files: FileTree, mtl: FileRef, pictures: PictureCache) -> dict[str, np.ndarray]:
    """Material name -> (h, w, 3) uint8 sRGB image, (1, 1, 3) where it has a diffuse colour only; images come from
    `pictures`.
    """
    found: dict[str, np.ndarray] = {}
    mapped: set[str] = set()
    name = ""
    for number, word, rest in mtl_statements(decode_text(mtl)):
        where = f"{mtl.name}, line {number}"
        if word == "newmtl":
            name = rest
            found[name] = np.asarray(GREY, np.uint8).reshape(1, 1, 3)
        elif word in ("map_Kd", "Kd") and not name:
            raise SourceError(where, "newmtl first", word, "is the file cut short? export it again")
        elif word == "map_Kd":
            image = find_reference(files, mtl.name, image_name(rest, where))
            found[name] = pictures.read(image)
            mapped.add(name)
        elif word == "Kd" and name not in mapped:
            found[name] = _diffuse_colour(rest, where)
    return found


def _diffuse_colour(rest: str, where: str) -> np.ndarray:
    try:
        values = np.array([float(word) for word in rest.split()[:3]])
        if len(values) != 3 or not ((values >= 0) & (values <= 1)).all():
            raise ValueError(rest)
    except ValueError as error:
        raise SourceError(where, "Kd with three numbers 0..1", repr(rest), "export the materials again") from error
    return np.round(values * 255).astype(np.uint8).reshape(1, 1, 3)
