"""A model that is shown a grasp: what it is asked, what its answers become."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from afford.grasping.judge import COLUMNS, LINE_PX, contact_sheet, parse_score, prompt
from afford.models import chat_model
from afford.models.chat import Chat
from maps.settings import Origin, Settings
from pipeline import build
from schemas.episodes import GraspJudgement
from stages.grasping import grasp_judge
from tests.helpers.blocks import changed
from tests.helpers.chat_server import KEY, VARIABLE, plant, says, serving
from tests.helpers.made_hands import shadow
from tests.helpers.made_traces import episodes, hammer
from tests.helpers.tiny_models import save_chat, save_parrot

SMALL: dict[str, Any] = {"frames": 5, "width": 64, "height": 48}


def judged(backend: str = "vlm", **params: Any) -> GraspJudgement:
    return grasp_judge.run(shadow(), ((hammer(),),), episodes(), changed(grasp_judge.Params(backend), **params))


@pytest.mark.parametrize("named", [{"model": "some-vlm"}, {"url": "http://127.0.0.1:8000/v1"}])
def test_judge_is_in_the_graph_if_a_model_is_named(named: dict[str, str]) -> None:
    """The stage is in no graph if neither model nor server is named, and the report has no judgement."""
    asked = Settings.of(grasp_judge=changed(grasp_judge.Params("endpoint" if "url" in named else "vlm"), **named))
    for p, there in ((Settings(), False), (asked, True)):
        nodes = {node.name: node for node in build("grasp", Origin("x"), p).stages()}
        assert ("grasp_judge" in nodes) is there and "judged" in dict(nodes["grasp_report"].inputs)


def test_a_server_is_shown_each_episode_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two episodes, two sheets of five frames in the protocol's words, two scores."""
    plant(monkeypatch)
    marks = iter(('{"score": 7}', 'Well. ```json\n{"score": 3.5}\n```'))
    with serving(lambda _: says(next(marks))) as server:
        found = judged(backend="endpoint", url=server.url, model="some-vlm", key_variable=VARIABLE, pause_s=0.0, **SMALL)
    assert found.score.tolist() == [7.0, 3.5] and (found.backend, found.model) == ("endpoint", "some-vlm")
    for asked in server.asked:
        words, picture = asked.body["messages"][0]["content"]
        assert words["text"] == prompt(5) and asked.key == KEY
        data = base64.b64decode(picture["image_url"]["url"].partition(",")[2])
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (2 * (48 + LINE_PX), COLUMNS * 64, 3)


@pytest.mark.parametrize("text", ["I cannot say.", '{"score": "8"}', '{"score": true}', '{"score": 0}', '{"score": 11}',
                                  '{"score": null}', '{"mark": 8}', '{"score": 8} or {"score": 9}',
                                  '{"score": NaN}', "8"])  # fmt: skip
def test_answer_without_a_score_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(ValueError, match=r"a/00: answer of backend 'vlm': expected one JSON object with a score from 1 to 10"):
        parse_score("a/00", text, "vlm")


def test_a_local_model_is_shown_each_episode(tmp_path: Path) -> None:
    """One that says the same of every sheet."""
    folder = save_parrot(tmp_path / "parrot", prompt(5), '{"score": 7}')
    assert judged(model=str(folder), new_tokens=16, **SMALL).score.tolist() == [7.0, 7.0]
    chat_model._load_cached.cache_clear()


def test_a_local_model_must_answer(tmp_path: Path) -> None:
    """A tiny random one says nothing that is a mark; none is named."""
    with pytest.raises(ValueError, match="needs a model: set `model`"):
        judged(**SMALL)
    folder = save_chat(tmp_path / "random")
    with pytest.raises(ValueError, match="answer of backend 'vlm': expected one JSON object"):
        judged(backend="vlm", model=str(folder), new_tokens=4, **SMALL)


def test_frames_stand_in_rows_under_their_times() -> None:
    """Frames are unchanged; the rest of the last row is blank."""
    frames = np.random.default_rng(0).integers(0, 255, (6, 10, 30, 3), dtype=np.uint8)
    found = contact_sheet(frames, np.arange(6) / 10)
    assert found.shape == (2 * (10 + LINE_PX), 30 * COLUMNS, 3)
    assert np.array_equal(found[LINE_PX : LINE_PX + 10, 30:60], frames[1]) and np.array_equal(found[-10:, 30:60], frames[5])


def test_other_tasks_and_addresses_with_more_in_them_are_refused() -> None:
    """A part of an address that may hold a key is not shown."""
    with pytest.raises(ValueError, match="no task is named"):
        grasp_judge.run(shadow(), (), episodes(), grasp_judge.Params(vlm=Chat("x")))
    for wrong in ({"url": "https://user:secret1@host/v1"}, {"key_variable": "sk-secret1"}, {"frames": 0}):
        with pytest.raises(ValueError, match="expected") as caught:
            changed(grasp_judge.Params("endpoint"), **wrong)
        assert "secret1" not in str(caught.value)
