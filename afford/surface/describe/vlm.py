"""A local vision-language model as a describer."""

from __future__ import annotations

from afford.models.chat_model import generate, load_model
from afford.render.views.draw import contact_sheet, sheet_labels
from afford.surface.describe import Vlm, prompt
from afford.surface.describe.prompt import part_prompt
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription

WEIGHTS = "a vision-language model with a chat template: folder of save_pretrained, or hub id as llava-hf/llava-1.5-7b-hf"


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Vlm) -> PartDescription:
    """See `Describer`."""
    asked = part_prompt(mesh.category, task, sheet_labels(views, params.views))
    model = load_model(params.model, params.device, params.dtype)
    said = generate(model, asked, contact_sheet(views, params.views), params.new_tokens)
    return prompt.parse_answer(said, mesh.name, task, "vlm")
