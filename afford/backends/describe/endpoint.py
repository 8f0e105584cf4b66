"""A vision-language model behind an OpenAI-compatible server as a describer."""

from __future__ import annotations

from typing import Any

from afford.backends.describe import answer
from afford.backends.describe.question import question
from afford.encode import jpeg
from afford.models.chat_endpoint import Endpoint, ask
from afford.views.contact import contact_sheet, labels
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.negative import PartDescription

QUALITY = 90


def describe(mesh: ObjectMesh, views: ObjectViews, task: str, params: Any) -> PartDescription:
    """Reads `url`, `model`, `key_variable`, `timeout_s`, `retries`, `pause_s`, `seed`, `new_tokens` and `views`."""
    server = Endpoint(params.url, params.model, params.key_variable, params.timeout_s, params.retries, params.pause_s, params.seed,
                      params.new_tokens)  # fmt: skip
    asked = question(mesh.category, task, labels(views, params.views))
    picture = jpeg(contact_sheet(views, params.views), QUALITY).tobytes()
    return answer.read(ask(server, asked, picture), mesh.name, task, "endpoint")
