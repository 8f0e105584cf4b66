"""A vision-language model behind an OpenAI-compatible server as a describer."""

from __future__ import annotations

from afford.common.image_files import encode_jpeg
from afford.models.chat_endpoint import complete
from afford.render.views.draw import contact_sheet, sheet_labels
from afford.surface.describe import Served, prompt
from afford.surface.describe.prompt import part_prompt
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription

SERVER = "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` or none"
QUALITY = 90


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Served) -> PartDescription:
    """See `Describer`."""
    asked = part_prompt(mesh.category, task, sheet_labels(views, params.views))
    picture = encode_jpeg(contact_sheet(views, params.views), QUALITY).tobytes()
    return prompt.parse_answer(complete(params, asked, picture), mesh.name, task, "endpoint")
