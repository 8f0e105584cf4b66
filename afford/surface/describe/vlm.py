"""A local vision-language model as a describer."""

from __future__ import annotations

from afford.models.chat_model import load_model, reply
from afford.render.views.draw import contact_sheet, labels
from afford.surface.describe import Vlm, answer
from afford.surface.describe.question import question
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription

WEIGHTS = "a vision-language model with a chat template: folder of save_pretrained, or hub id as llava-hf/llava-1.5-7b-hf"


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Vlm) -> PartDescription:
    """See `Describer`."""
    asked = question(mesh.category, task, labels(views, params.views))
    model = load_model(params.model, params.device, params.dtype)
    said = reply(model, asked, contact_sheet(views, params.views), params.new_tokens)
    return answer.read(said, mesh.name, task, "vlm")
