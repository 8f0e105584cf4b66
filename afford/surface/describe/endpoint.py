"""A vision-language model behind an OpenAI-compatible server as a describer."""

from __future__ import annotations

from afford.common.image_files import encode_jpeg
from afford.models.chat_endpoint import ask
from afford.render.views.draw import contact_sheet, labels
from afford.surface.describe import Served, answer
from afford.surface.describe.question import question
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription

SERVER = "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` or none"
QUALITY = 90


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Served) -> PartDescription:
    """See `Describer`."""
    asked = question(mesh.category, task, labels(views, params.views))
    picture = encode_jpeg(contact_sheet(views, params.views), QUALITY).tobytes()
    return answer.read(ask(params, asked, picture), mesh.name, task, "endpoint")
