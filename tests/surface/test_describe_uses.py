"""Uses of objects from a CSV file: lines, descriptions, and the option --uses."""

from __future__ import annotations

from pathlib import Path

import pytest

from afford.surface.describe.uses import described, parse_use
from commands.errors import UsageError
from commands.settings import settings
from commands.uses import setting_of
from stages.surface import part_describe
from tests.helpers.made_objects import looked

HEAD = "object,task,hold,avoid\n"


def test_lines_name_parts_by_the_lexicon_or_by_their_shape() -> None:
    use = parse_use("jerrycan | pour petrol | handle | cap = a short thick tube at the end; Spout")
    assert use.object == "jerrycan" and use.task == "pour petrol" and use.hold == {"handle": ""}
    assert use.avoid == {"cap": "a short thick tube at the end", "spout": ""}


@pytest.mark.parametrize("line", ["jerrycan | pour", "jerrycan | pour | |", "| pour | handle |", "can | pour | rim | rim"])
def test_lines_of_another_form_are_refused(line: str) -> None:
    with pytest.raises(ValueError, match="use "):
        parse_use(line)


def test_descriptions_are_those_of_the_object_and_replace_the_lexicon() -> None:
    x = looked()
    name = x.mesh.name
    lines = (f"{name} | cut rope | handle | blade", f"{name} | hand over | blade | handle", "other | cut | handle | blade")
    found = part_describe.run(x.mesh, x.views, part_describe.Params(uses=lines))
    assert [one.task for one in found.descriptions] == ["cut rope", "hand over"]
    first = {note.part: note for note in found.descriptions[0].notes}
    assert (first["handle"].role, first["blade"].role) == ("positive", "negative")
    assert all(note.task_changes for note in first.values()) and "blade of" in first["blade"].phrase
    assert part_describe.run(x.mesh, x.views, part_describe.Params(uses=lines[2:])) == part_describe.run(
        x.mesh, x.views, part_describe.Params())


def test_part_of_unknown_shape_is_refused_by_name() -> None:
    x = looked()
    with pytest.raises(ValueError, match="part gizmo: expected one of"):
        described(x.mesh, (f"{x.mesh.name} | use | gizmo |",))


def test_option_becomes_a_parameter(tmp_path: Path) -> None:
    path = tmp_path / "uses.csv"
    path.write_text(HEAD + "pitcher_base, pour water, handle, rim;spout\nbox,carry the box,body,\n")
    chosen = settings([setting_of(path)], None).surface.part_describe.uses
    assert [parse_use(line).object for line in chosen] == ["pitcher_base", "box"]
    assert parse_use(chosen[0]).avoid == {"rim": "", "spout": ""}


@pytest.mark.parametrize("text", ["", HEAD, "a,b\n1,2\n", HEAD + "mug,drink,handle\n", HEAD + "mug,drink,handle,rim,more\n",
                                  HEAD + 'mug,drink,"handle, body",rim\n', HEAD + "mug,drink,,\n"])  # fmt: skip
def test_file_of_another_form_is_a_usage_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "uses.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match="--uses"):
        setting_of(path)
    with pytest.raises(UsageError, match="expected a CSV file"):
        setting_of(tmp_path / "none.csv")
