"""The local page: by HTTP, and in a real browser where Chromium is at hand."""

from __future__ import annotations

import base64
import http.client
import io
import json
import shutil
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from afford.codecs.kinds import digest as digest_of
from afford.common.image_files import jpeg
from afford.common.palette import HANDS
from afford.models import shipped
from afford.twohands.demo import server
from afford.twohands.demo.examples import Example, beside, examples
from afford.twohands.demo.server import Site
from afford.twohands.demo.service import MAX_SIDE_PX, PredictionService
from afford.twohands.model import model_folder
from afford.twohands.model.predictor import Predictor
from commands import demo as commands_demo
from commands.session import open_runner
from stages.extraction import dataset_pack
from tests.helpers import tiny_asked
from tests.helpers.command import call
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.tiny_asked import TASK, write_picture

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tiny_asked.write_model(tmp_path_factory.mktemp("store") / "models" / "small" / "model")
    model_folder.write_vocabulary(model_folder.vocabulary_of([(TASK, "pour", "kettle"), ("cut bread", "cut", "bread")]), folder)
    return folder


@pytest.fixture(scope="module")
def site(model: Path) -> Iterator[Site]:
    """A running page with one example."""
    asker = PredictionService(Predictor(model), model_folder.find_model(model))
    made = Site("127.0.0.1", 0, asker, asker.about(), [Example("cut bread", jpeg(tiny_asked.picture(120, 200)))])
    threading.Thread(target=made.serve_forever, daemon=True).start()
    with made:
        yield made
        made.shutdown()


class Reply:
    """Reply of the server."""

    def __init__(self, reply: http.client.HTTPResponse) -> None:
        self.status, self.headers, self.body = reply.status, reply.headers, reply.read()

    @property
    def json(self) -> Any:
        return json.loads(self.body)


def ask(site: Site, method: str, path: str, body: bytes | None = None, **headers: str) -> Reply:
    """One request; `Host__` and the like replace what http.client would send."""
    connection = http.client.HTTPConnection(urlsplit(site.url).netloc, timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers)
    if body is not None and "Content_Length" not in headers:
        headers["Content_Length"] = str(len(body))
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders(body)
    try:
        return Reply(connection.getresponse())
    finally:
        connection.close()


def png(rgb: np.ndarray) -> bytes:
    return cv2.imencode(".png", rgb[..., ::-1])[1].tobytes()


def predict(site: Site, data: bytes, task: str = TASK, hands: str = "both") -> Reply:
    return ask(site, "POST", f"/predict?{urlencode({'task': task, 'hands': hands})}", data)


# -- HTTP --------------------------------------------------------------------------------------------------------------


def test_the_page_its_parts_and_the_examples(site: Site) -> None:
    """Content types, a policy without external sources, and no external links."""
    kinds = {"/": "text/html", "/page.css": "text/css", "/page.js": "text/javascript", "/examples/0.jpg": "image/jpeg"}
    for path, kind in kinds.items():
        reply = ask(site, "GET", path)
        assert reply.status == 200 and reply.headers.get_content_type() == kind and reply.body
        assert "default-src 'none'" in reply.headers["Content-Security-Policy"]
        assert b"http://" not in reply.body and b"https://" not in reply.body
    assert ask(site, "GET", "/examples.json").json == [{"url": "/examples/0.jpg", "task": "cut bread"}]
    assert ask(site, "GET", "/model.json").json["name"] == "small" and ask(site, "HEAD", "/").body == b""


def test_an_answer_is_that_of_the_python_api(site: Site, model: Path) -> None:
    """Scores, taxonomy, and maps to half a step of 8 bits."""
    said = predict(site, png(tiny_asked.picture())).json
    expected = Predictor(model).predict(tiny_asked.picture(), TASK, "both")
    assert said["hands"] == ["left", "right"] and (said["width_px"], said["height_px"]) == (90, 60)
    assert list(said["taxonomy"]["probabilities"].values()) == pytest.approx(expected.taxonomy.tolist(), abs=1e-5)
    for n, side in enumerate(("left", "right")):
        assert [h["score"] for h in said[side]["hypotheses"]] == pytest.approx(expected.score[n].tolist(), abs=1e-5)
        for data, probability in zip(said["maps"][side], expected.probability[n], strict=True):
            found = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_UNCHANGED)
            assert np.abs(found / 255 - probability).max() <= 0.5 / 255 + 1e-6


def test_unknown_words_are_in_the_answer(site: Site) -> None:
    """The description of the model has the known words, or null."""
    assert ask(site, "GET", "/model.json").json["words"] == {"verbs": ["cut", "pour"], "things": ["bread", "kettle"]}
    assert predict(site, png(tiny_asked.picture())).json["unknown_words"] == []
    assert predict(site, png(tiny_asked.picture()), "pour the zorgblatt").json["unknown_words"] == ["zorgblatt"]


def test_large_pictures_come_back_at_the_pages_size(site: Site) -> None:
    """The longer side at most MAX_SIDE_PX, the shape kept."""
    said = predict(site, png(tiny_asked.picture(1500, 3000))).json
    assert (said["width_px"], said["height_px"]) == (MAX_SIDE_PX, MAX_SIDE_PX // 2)


@pytest.mark.parametrize(
    ("data", "task", "hands", "status", "hint"),
    [
        (b"just words", TASK, "auto", 415, "expected an image"),
        (b"", TASK, "auto", 415, "an empty file"),
        (png(tiny_asked.picture()), "  ", "auto", 400, "task: expected 1 to 200 characters"),
        (png(tiny_asked.picture()), "x" * 201, "auto", 400, "task: expected 1 to 200 characters, got 201"),
        (png(tiny_asked.picture()), TASK, "lft", 400, "expected one of auto, left, right, both, got 'lft'"),
        (png(np.zeros((5000, 5000, 3), np.uint8)), TASK, "auto", 413, "at most 24 megapixels, got 5000 x 5000"),
        (bytes(server.MAX_BODY_BYTES + 1), TASK, "auto", 413, "at most 16 MiB"),
    ],
    ids=["words", "empty", "no task", "long task", "hands", "pixels", "bytes"],
)
def test_bad_requests_get_one_sentence(
    data: bytes, task: str, hands: str, status: int, hint: str, site: Site
) -> None:
    """The error has a fitting status, and the next request is served."""
    refused = predict(site, data, task, hands)
    assert refused.status == status and hint in refused.json["error"] and "\n" not in refused.json["error"]
    assert predict(site, png(tiny_asked.picture())).status == 200


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", "/nothing", 404), ("POST", "/nothing", 404), ("GET", "/predict", 405), ("PUT", "/predict", 405), ("DELETE", "/", 405),
     ("GET", "/../../pyproject.toml", 404), ("GET", "/%2e%2e/server.py", 404), ("GET", "/server.py", 404),
     ("GET", "//page.css/..", 404), ("GET", "/examples/../page.js", 404), ("GET", "/examples/1.jpg", 404)],
)  # fmt: skip
def test_other_paths_and_methods_are_refused(method: str, path: str, status: int, site: Site) -> None:
    """No path leads to a file."""
    refused = ask(site, method, path, b"" if method == "POST" else None)
    assert refused.status == status and refused.json["error"]


def test_requests_without_a_true_length_are_refused(site: Site) -> None:
    """A missing length, or one that is not a number."""
    assert ask(site, "POST", "/predict?task=x").status == 411
    assert ask(site, "POST", "/predict?task=x", b"abc", Content_Length="-3").status == 400


def test_other_sites_cannot_use_it(site: Site) -> None:
    """Neither by their own page (Origin) nor by a name of theirs that points here (Host)."""
    host = urlsplit(site.url).netloc
    assert ask(site, "POST", "/predict?task=x", b"", Origin="https://elsewhere.example").status == 403
    assert ask(site, "GET", "/", Host="elsewhere.example").status == 403
    assert ask(site, "GET", "/", Host="localhost:1").status == 200
    assert ask(site, "POST", "/predict?task=x", png(tiny_asked.picture()), Origin=f"http://{host}").status == 200


def test_visitors_wait_for_each_other(site: Site) -> None:
    """Eight at once, each gets the same as alone."""
    data, found = png(tiny_asked.picture()), []
    visitors = [threading.Thread(target=lambda: found.append(predict(site, data).json["maps"])) for _ in range(8)]
    for visitor in visitors:
        visitor.start()
    for visitor in visitors:
        visitor.join()
    assert found == [predict(site, data).json["maps"]] * 8


def test_a_model_that_fails_is_not_hidden(model: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """500 for the visitor, the traceback for the terminal."""

    def broken(data: bytes, task: str, hands: str) -> dict[str, Any]:
        raise RuntimeError("out of paper")

    with Site("127.0.0.1", 0, broken, {}, []) as site:
        threading.Thread(target=site.serve_forever, daemon=True).start()
        refused = predict(site, b"")
        seen, ends = "", time.monotonic() + 10  # the thread of the visitor prints after it has answered
        while "out of paper" not in seen and time.monotonic() < ends:
            time.sleep(0.01)
            seen += capfd.readouterr().err
        site.shutdown()
    assert refused.status == 500 and "terminal" in refused.json["error"] and "out of paper" in seen


# -- examples and the verb ---------------------------------------------------------------------------------------------


def test_examples_are_stills_of_a_rendered_set(tmp_path: Path) -> None:
    """One of each room first, without the black bar of the layout, tasks once; no set, no examples."""
    assert examples(tmp_path) == []
    for room, frame, task in (("a", "1", "cut bread"), ("a", "2", "open jar"), ("b", "1", "cut bread"), ("c", "1", "lift pan")):
        folder = tmp_path / "set" / "masks" / room / frame
        write_picture(folder / "inpainting.png", np.pad(tiny_asked.picture(180, 320) // 2 + 60, ((140, 0), (0, 0), (0, 0))))
        (folder / "annotation.json").write_text(json.dumps({"narration": task}))
    found = examples(tmp_path)
    assert [one.task for one in found] == ["cut bread", "lift pan", "open jar"]
    assert cv2.imdecode(np.frombuffer(found[0].jpeg, np.uint8), cv2.IMREAD_COLOR).shape == (180, 320, 3)


def test_examples_after_a_training_are_held_out_samples(model: Path, tmp_path: Path) -> None:
    """Validation samples of the data set in the model's card, if the store has it; each task once."""
    clips = tuple(clip(f"P01_0{n}", 8, split=split, height=180, width=320) for n, split in enumerate(("train", "val", "val")))
    packed = dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(tmp_path / "packed"))
    store, folder = tmp_path / "store", tmp_path / "store" / "models" / "small"
    digest = digest_of(packed)
    open_runner(store, 0).store.put_leaf(packed)
    shutil.copytree(model, folder / "model")
    console = Console(file=io.StringIO(), width=400)
    assert commands_demo._examples(model_folder.find_model(folder), store, console) == []
    assert "holds neither stills of `run benchmark-set` nor pictures" in console.file.getvalue()  # type: ignore[attr-defined]
    (folder / "card.md").write_text(f"`stills`, content digest `{digest}`, divided by `given`")
    found = commands_demo._examples(model_folder.find_model(folder), store, console)
    rows = [row for path in packed.files if path.name.startswith("data/val-") for row in pq.read_table(path.path).to_pylist()]
    assert sorted(one.task for one in found) == sorted({row["narration"] for row in rows}) and len(found) == 4
    assert cv2.imdecode(np.frombuffer(found[0].jpeg, np.uint8), cv2.IMREAD_COLOR).shape == (180, 320, 3)


def test_pictures_beside_a_model_are_its_examples(tmp_path: Path) -> None:
    """Tasks are the names of the files; other files are no examples."""
    assert beside(tmp_path) == []
    (tmp_path / "examples").mkdir()
    for name in ("pour-tea-from-kettle.jpg", "cut-bread.jpg", "notes.txt"):
        (tmp_path / "examples" / name).write_bytes(name.encode())
    wanted = [("cut bread", b"cut-bread.jpg"), ("pour tea from kettle", b"pour-tea-from-kettle.jpg")]
    assert beside(tmp_path) == [Example(*one) for one in wanted]


def test_the_verb_refuses_what_it_cannot_serve(site: Site, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No model, or an address that is taken: exit 2, one sentence."""
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "weights")
    none = call("demo", "--store", tmp_path)
    assert none.code == 2 and "run `make train` or give --model DIR" in none.err
    taken = call("demo", "--model", model, "--port", str(site.server_address[1]), "--store", tmp_path)
    assert taken.code == 2 and "the address must be one that is free" in taken.err
    for port in ("99999", "-1"):
        wrong = call("demo", "--model", model, "--port", port, "--store", tmp_path)
        assert wrong.code == 2 and f"--port {port}: expected a port from 0 (any free port) to 65535" in wrong.words
    alien = call("demo", "--model", model, "--host", "192.0.2.1", "--port", "0", "--store", tmp_path)
    assert alien.code == 2 and "--host 192.0.2.1 --port 0: the address must be one of this machine" in alien.words


def test_the_demo_command_serves_until_interrupted(model: Path, tmp_path: Path) -> None:
    """The terminal shows the address, an interrupt ends the command with 0, and a damaged set costs only the examples."""
    broken = tmp_path / "benchmarks" / "set" / "masks" / "room" / "1"
    broken.mkdir(parents=True)
    (broken / "inpainting.png").write_bytes(b"no image")
    (broken / "annotation.json").write_text(json.dumps({"narration": "cut bread"}))
    command = [sys.executable, "pipeline.py", "demo", "--model", model, "--store", tmp_path, "--port", "0"]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as started:
        assert started.stderr is not None
        said = [next(line for line in started.stderr if word in line) for word in ("no examples", "http://")]
        reply = urllib.request.urlopen(said[1].split()[0], timeout=30)
        assert "inpainting.png: expected an image" in said[0]
        assert reply.status == 200 and b"Where does each hand go?" in reply.read()
        started.send_signal(signal.SIGINT)
        try:
            assert started.wait(30) == 0 and "stopped" in started.stderr.read()
        finally:
            started.kill()


def test_loopback_addresses() -> None:
    """Names and addresses of this machine are loopback, others are not."""
    assert all(server.is_loopback(name) for name in ("127.0.0.1", "localhost", "::1", "127.8.8.8"))
    assert not any(server.is_loopback(name) for name in ("0.0.0.0", "::", "192.168.1.2", "example.org"))


# -- in a browser ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["light", "dark"])
def page(site: Site, request: pytest.FixtureRequest) -> Iterator[Any]:
    """The page in headless Chromium, in both colour schemes; an error of its script fails the test."""
    sync_api = pytest.importorskip("playwright.sync_api")
    chromium = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None)
    if chromium is None:
        pytest.skip("Chromium is missing")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        opened = browser.new_page(color_scheme=request.param, viewport={"width": 1280, "height": 900})
        wrong: list[str] = []
        opened.on("pageerror", lambda error: wrong.append(str(error)))
        opened.on("console", lambda said: wrong.append(said.text) if "Content Security Policy" in said.text else None)
        yield opened
        browser.close()
    assert not wrong


FILL = 105
"""opacity of a region in page.js, of 255"""


def canvas(page: Any) -> np.ndarray:
    """(n, 3) RGB of the pixels that are drawn."""
    url = page.evaluate("document.getElementById('canvas').toDataURL()")
    data = np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR_RGB).reshape(-1, 3).astype(int)


def painted(before: np.ndarray, after: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(n,) bool: which pixels have the tint that a region of this colour gives them."""
    tint = before + (np.array(colour) - before) * FILL / 255
    return (np.abs(after - tint).max(1) <= 2) & (np.abs(after - before).max(1) > 2)


@pytest.mark.browser
def test_a_picture_and_a_task_give_both_hands_regions(page: Any, site: Site, model: Path, tmp_path: Path) -> None:
    """The picture is drawn, then both regions in their colours.

    Toggles, regions and the threshold change the drawing; another file is refused in one sentence and changes nothing.
    """
    page.goto(site.url)
    page.set_input_files("#file", write_picture(tmp_path / "kettle.png"))
    page.wait_for_selector("main[data-state=ready]")
    plain, expected = canvas(page), Predictor(model).predict(tiny_asked.picture(), TASK, "both")
    assert plain.std() > 10

    page.check("input[value=both]", force=True)
    page.fill("#task", TASK)
    page.keyboard.press("Enter")
    page.wait_for_selector("main[data-state=done]")
    both = canvas(page)
    for side, other in (("left", "right"), ("right", "left")):
        page.uncheck(f"#show-{other}")
        alone = canvas(page)
        assert painted(plain, alone, HANDS[side]).mean() == pytest.approx(expected.mask(side).mean(), abs=0.08)
        assert not np.array_equal(alone, both)
        page.check(f"#show-{other}")
    assert np.array_equal(canvas(page), both)
    slider = page.locator("#threshold")
    slider.evaluate("(slider) => { slider.value = 0.95; slider.dispatchEvent(new Event('input')); }")
    assert np.array_equal(canvas(page), plain) and "none at this threshold" in page.inner_text("#area-left")
    slider.evaluate("(slider) => { slider.value = 0.01; slider.dispatchEvent(new Event('input')); }")
    assert "100.0 %" in page.inner_text("#area-left")

    assert page.locator(".bars dt").count() == 4 and page.locator(".ways input").count() == 6
    page.locator("input[name=way-right]").nth(2).check()
    chosen = [page.locator(f"input[name=way-{side}]:checked").get_attribute("value") for side in ("left", "right")]
    assert chosen[0] == chosen[1] and "ms of CPU" in page.inner_text("#time")

    with page.expect_download() as saved:
        page.click("#save-left")
    mask = cv2.imread(str(saved.value.path()), cv2.IMREAD_COLOR)
    share = float(page.inner_text("#area-left").split()[0]) / 100
    assert saved.value.suggested_filename == "kettle_left.png" and mask.shape == tiny_asked.picture().shape
    assert set(np.unique(mask)) <= {0, 255} and (mask > 0).mean() == pytest.approx(share, abs=0.02)

    page.fill("#task", "pour zorgblatt")
    page.keyboard.press("Enter")
    page.wait_for_selector("#unknown:visible")
    assert "“zorgblatt”" in page.inner_text("#unknown")
    page.click("#words summary")
    assert page.inner_text("#things") == "bread, kettle" and page.inner_text("#verbs") == "cut, pour"

    (tmp_path / "notes.txt").write_text("not a picture")
    before = canvas(page)
    page.set_input_files("#file", tmp_path / "notes.txt")
    page.wait_for_selector("#error:visible")
    assert page.inner_text("#error").startswith("notes.txt: expected an image") and np.array_equal(canvas(page), before)


@pytest.mark.browser
def test_the_largest_number_leaves_its_bar_free(page: Any, site: Site, tmp_path: Path) -> None:
    """100 % in bold, on one line, beside the bar."""
    page.goto(site.url)
    page.set_input_files("#file", write_picture(tmp_path / "kettle.png"))
    page.check("input[value=both]", force=True)
    page.fill("#task", TASK)
    page.keyboard.press("Enter")
    page.wait_for_selector("main[data-state=done]")
    found = page.evaluate("""() => [...document.querySelectorAll('.number')].map((node) => {
      node.textContent = percent(1);
      node.style.fontWeight = 600;
      const range = document.createRange();
      range.selectNodeContents(node);
      const text = range.getBoundingClientRect(), bar = node.parentElement.querySelector('.bar').getBoundingClientRect();
      const own = node.previousElementSibling.getBoundingClientRect();
      return [range.getClientRects().length, text.left - own.right, bar.width];
    })""")
    assert len(found) == 10 and all(lines == 1 and free >= 2 and wide > 40 for lines, free, wide in found)


@pytest.mark.browser
def test_an_example_is_a_question_and_errors_of_the_server_are_shown(page: Any, site: Site) -> None:
    """One press of a key on an example asks; without words nothing is asked; narrow windows lose nothing."""
    page.goto(site.url)
    page.locator("#examples button").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("main[data-state=done]")
    assert page.input_value("#task") == "cut bread"
    assert page.get_attribute("#canvas", "aria-label").startswith("The picture with regions")
    page.fill("#task", " ")
    page.click("#go")
    page.wait_for_selector("#error:visible")
    assert "Say what is to be done" in page.inner_text("#error")
    page.evaluate("document.getElementById('task').removeAttribute('maxlength')")
    page.fill("#task", "x" * 201)
    with page.expect_response("**/predict*") as reply:
        page.click("#go")
    page.locator("#error", has_text="200 characters").wait_for()
    assert reply.value.status == 400
    page.set_viewport_size({"width": 380, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
