"""Describe the parts of an object with a vision-language model."""

from __future__ import annotations

from functools import partial

from afford.models.chat import Question, ask
from afford.render.views.draw import contact_sheet, sheet_labels
from afford.surface.describe import Served, Vlm
from afford.surface.describe.prompt import parse_answer, part_prompt
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartDescription

WEIGHTS = {"vlm": "a vision-language model with a chat template: folder of save_pretrained, or hub id as llava-hf/llava-1.5-7b-hf"}
SERVER = {"endpoint": "OpenAI-compatible: `url`, `model` as the server calls it, a key in the environment variable `key_variable` "
                      "or none"}  # fmt: skip
MET = {"vlm": "tiny random weights, 2026-11: a LLaVA of transformers with its processor",
       "endpoint": "server of the tests, 2026-11: answers, retries, redirects; no public server"}  # fmt: skip


def describe_by_model(mesh: ObjectMesh, views: ObjectViews, task: str, params: Vlm) -> PartDescription:
    """Describe the parts with a vision-language model on this machine (`Describer`)."""
    return _describe(mesh, views, task, params)


def describe_by_server(mesh: ObjectMesh, views: ObjectViews, task: str, params: Served) -> PartDescription:
    """Describe the parts with a vision-language model behind an OpenAI-compatible server (`Describer`)."""
    return _describe(mesh, views, task, params)


def _describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Vlm | Served) -> PartDescription:
    prompt = part_prompt(mesh.category, task, sheet_labels(views, params.views))
    return ask(Question(prompt, contact_sheet(views, params.views), partial(_parse, mesh.name, task)), params)


def _parse(name: str, task: str, text: str, backend: str) -> PartDescription:
    return parse_answer(text, name, task, backend)
