"""Describer behind a server: prompt, refusals, and secrecy of the key in every message."""

from __future__ import annotations

import base64
import socket
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from afford.models import chat_endpoint
from afford.render.views.draw import LINE_PX, contact_sheet
from schemas.surface import PartDescription
from stages.surface import part_describe
from tests.helpers.blocks import changed
from tests.helpers.chat_server import GOOD, KEY, VARIABLE, Answer, Asked, ChatServer, params, plant, says, serving
from tests.helpers.made_objects import looked


@pytest.fixture(autouse=True)
def planted(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch)


def described(chosen: part_describe.Params) -> PartDescription:
    return part_describe.run(looked().mesh, looked().views, chosen).descriptions[0]


def refused(answer: Callable[[Asked], Answer], **more: Any) -> tuple[str, int]:
    """Return the error message and the number of requests."""
    with serving(answer) as server, pytest.raises(ValueError) as caught:
        described(params(server, **more))
    assert KEY not in repr(caught.value) and caught.value.__suppress_context__ | (caught.value.__context__ is None)
    return str(caught.value), len(server.asked)


# -- what is asked -----------------------------------------------------------------------------------------------------


def test_request_follows_the_protocol() -> None:
    """Check address, header, sampling, prompt and sheet of views, and that the answer becomes notes."""
    with serving(lambda _: says(GOOD)) as server:
        found = described(params(server, seed=7, new_tokens=55))
    [asked] = server.asked
    assert asked.path == "/v1/chat/completions" and asked.key == KEY
    assert {key: asked.body[key] for key in asked.body if key != "messages"} == {
        "model": "some-vlm", "temperature": 0, "seed": 7, "max_tokens": 55}  # fmt: skip
    [message] = asked.body["messages"]
    words, picture = message["content"]
    assert '"drive a screw"' in words["text"] and "front, back, left, right, top, bottom" in words["text"]
    sheet = seen(picture["image_url"]["url"])
    wanted = contact_sheet(looked().views, 6)
    assert sheet.shape == wanted.shape and np.abs(sheet.astype(int) - wanted).mean() < 4
    assert (found.category, found.backend) == ("screwdriver", "endpoint")
    notes = [(note.part, note.role, note.confidence) for note in found.notes]
    assert notes == [("shaft", "negative", 0.75), ("handle", "positive", 1.0)]


def seen(url: str) -> np.ndarray:
    """Decode the image of a data URL."""
    kind, _, data = url.partition(",")
    assert kind == "data:image/jpeg;base64"
    return cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR_RGB)


def test_tasks_are_separate_requests() -> None:
    """Check given tasks, and otherwise those of the lexicon for a known category."""
    with serving(lambda _: says(GOOD)) as server:
        part_describe.run(looked().mesh, looked().views, params(server, tasks=("a", "b", "c")))
        part_describe.run(looked().mesh, looked().views, params(server, tasks=()))
    texts = [asked.body["messages"][0]["content"][0]["text"] for asked in server.asked]
    tasks = ("a", "b", "c", "drive a screw", "hand over the screwdriver")
    assert len(texts) == 5 and all(f'The task: "{task}"' in text for task, text in zip(tasks, texts, strict=True))


def test_server_without_a_key_receives_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the environment does not matter."""
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    with serving(lambda _: says(GOOD)) as server:
        described(params(server, key_variable=""))
    assert "Authorization" not in server.asked[0].headers


@pytest.mark.parametrize(("count", "rows", "columns"), [(1, 1, 1), (2, 1, 2), (4, 2, 3), (6, 2, 3), (99, 2, 3)])
def test_views_are_on_one_sheet(count: int, rows: int, columns: int) -> None:
    """Check three views in a row, each under its name."""
    views = looked().views
    assert len(views.views) == 6
    sheet, (tall, wide) = contact_sheet(views, count), views.rgb.shape[1:3]
    assert sheet.shape == (rows * (tall + LINE_PX), columns * wide, 3)
    assert np.array_equal(sheet[LINE_PX : LINE_PX + tall, :wide], views.rgb[0])
    assert sheet[:LINE_PX, :wide].min() < 100


# -- what it refuses ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("status", "sentence", "tries"), [
    (401, f"refused the key in environment variable {VARIABLE}", 1), (403, "refused the key", 1), (302, "sends us elsewhere", 1),
    (404, "no model 'some-vlm'", 1), (400, "answered 400: no such thing; mend", 1), (429, "answered 429 after 3 tries", 3),
    (500, "answered 500 after 3 tries: no such thing", 3), (503, "answered 503 after 3 tries", 3),
])  # fmt: skip
def test_refusal_is_one_sentence(status: int, sentence: str, tries: int) -> None:
    """Check address and message of the server, retries of temporary errors, and that redirects are not followed."""
    answer = Answer(status, {"error": {"message": "no such\nthing"}}, (("Location", "/elsewhere"),))
    said, asked = refused(lambda _: answer, retries=2)
    assert sentence in said and "/v1: " in said and asked == tries


@pytest.mark.parametrize("status", [400, 401, 404, 429, 500, 302])
@pytest.mark.parametrize("echo", ["{}", '{{"error": {{"message": "bad key {}"}}}}', '{{"error": {{"message": "{}"}}}}'])
def test_key_in_a_refusal_is_not_quoted(status: int, echo: str) -> None:
    """Check body, headers and reason, plain or escaped."""
    for key in (KEY, KEY.replace("/", r"\/")):
        answer = Answer(status, None, (("X-Key", KEY),), echo.format(key).encode())
        said, _ = refused(lambda _, answer=answer: answer, retries=0)  # type: ignore[misc]
        assert "planted" not in said


@pytest.mark.parametrize("text", [KEY, f"Here you are, {KEY}: {GOOD}", GOOD.replace("narwhal", KEY), GOOD.replace("positive", KEY),
                                  GOOD.replace("narwhal", KEY.replace("/", r"\/")),
                                  GOOD.replace("positive", KEY.replace("s", r"\u0073"))])  # fmt: skip
def test_answer_with_the_key_is_refused(text: str) -> None:
    """Check that the answer is neither stored nor shown."""
    said, _ = refused(lambda _: says(text))
    assert f"repeats the key of {VARIABLE}" in said and "planted" not in said


@pytest.mark.parametrize("answer", [
    Answer(200, {}), Answer(200, []), Answer(200, {"choices": []}), says(None), says(["x"]), Answer(200, raw=b"<html>"),
    Answer(200, raw=b"\xff"), Answer(200, raw=b"[" * 10000),
])  # fmt: skip
def test_invalid_replies_are_refused(answer: Answer) -> None:
    """Check that the error names the expected field."""
    said, asked = refused(lambda _: answer)
    assert "expected choices[0].message.content with text" in said and asked == 1


def test_answer_must_be_valid() -> None:
    """Check the message of the parser (test_describe_prompt.py)."""
    assert "expected one JSON object with category and parts, got 0 in 'No.'" in refused(lambda _: says("No."))[0]


def test_busy_servers_are_retried() -> None:
    """Check retries until an answer."""
    busy = [Answer(429, None, (("Retry-After", "0"),)), Answer(503)]
    with serving(lambda _: busy.pop() if busy else says(GOOD)) as server:
        assert described(params(server)).category == "screwdriver"
    assert len(server.asked) == 3


def test_unreachable_and_silent_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check a closed port, and a server that sends no byte."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/v1"
        with pytest.raises(ValueError, match=r"cannot be asked: no answer within 0\.2 s"):
            described(params(ChatServer(url), timeout_s=0.2, retries=0))
    with pytest.raises(ValueError, match=r"cannot be asked: .*refused.*is the server running.*\(2 tries\)"):
        described(params(ChatServer(url), retries=1))
    monkeypatch.setenv("no_proxy", "*")
    with pytest.raises(ValueError, match="would travel in the open"):
        described(params(ChatServer("http://gpu.example/v1")))


@pytest.mark.parametrize(("value", "sentence"), [
    ("", "got nothing; export it"), ("short", "got something else"), (f"{KEY}\nX-More: 1", "got something else"),
    (f"{KEY} ", "got something else"),
])  # fmt: skip
def test_invalid_keys_are_not_sent(value: str, sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the error names the variable and hides its value."""
    monkeypatch.setenv(VARIABLE, value)
    said, asked = refused(lambda _: says(GOOD))
    assert f"environment variable {VARIABLE}" in said and sentence in said and asked == 0
    assert not value or value not in said


def test_keys_need_https_or_localhost() -> None:
    """Check that plain http is accepted for this machine only."""
    for url in ("https://api.example/v1", "http://localhost:1/v1", "http://[::1]:1/v1"):
        assert chat_endpoint.read_key(VARIABLE, url) == KEY
    for url in ("http://api.example/v1", "http://localhost.example/v1"):
        with pytest.raises(ValueError, match="in the open"):
            chat_endpoint.read_key(VARIABLE, url)


@pytest.mark.parametrize("wrong", [
    {"key_variable": KEY}, {"key_variable": "lower"}, {"url": f"http://me:{KEY}@host/v1"}, {"url": f"https://host/v1?key={KEY}"},
    {"url": "host/v1"}, {"views": 0}, {"retries": -1},
])  # fmt: skip
def test_parameters_with_a_key_are_refused(wrong: dict[str, Any]) -> None:
    """Check that the error comes before any output and hides the value."""
    with pytest.raises(ValueError, match="expected") as caught:
        changed(part_describe.Params(backend="endpoint"), **wrong)
    assert KEY not in str(caught.value)


def test_model_and_server_are_required() -> None:
    """Check the error for a missing name."""
    for missing in ({"model": ""}, {"url": ""}):
        with pytest.raises(ValueError, match="needs a server: set `model`, and `url`"):
            described(params(ChatServer("http://127.0.0.1:1/v1"), **missing))
