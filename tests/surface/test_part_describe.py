"""Stage part_describe through the runner: one request per prompt, and no key in any file."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest
import zstandard
from mcap.reader import make_reader

from afford.surface.score import Clip
from maps.settings import Settings
from runner import Graph, Runner, RunReport
from runner.index import Index
from schemas.files import FileTree
from stages.recording import object_record
from stages.surface import mask_score, negative_affordance_files, negative_affordance_projection, part_describe
from tests.helpers.chat_server import GOOD, KEY, VARIABLE, Answer, params, plant, says, serving
from tests.helpers.made_objects import looked
from tests.helpers.tiny_models import save_backbones

ROOT = Path(__file__).resolve().parents[2]
WORD = b"narwhal"
"""word of the good answer, to be found in every place where a key could be"""
ECHO = {"error": {"message": f"bad key {KEY}"}}
MCAP = b"\x89MCAP"


def whole(chosen: part_describe.Params, models: Path) -> Graph:
    """Build the graph from views to files and recording."""
    g, x, p = Graph(), looked(), Settings()
    mesh, views, found = g.leaf("mesh", x.mesh), g.leaf("views", x.views), g.leaf("candidates", x.candidates)
    told = g.add(part_describe.run, mesh=mesh, views=views, params=chosen)
    scorer = g.leaf("none", FileTree("none", ()))
    fit = g.add(mask_score.run, mesh=mesh, views=views, candidates=found, descriptions=told, scorer=scorer,
                params=mask_score.Params("clip", Clip(str(models))))  # fmt: skip
    where = g.add(negative_affordance_projection.run, mesh=mesh, views=views, candidates=found, descriptions=told, scores=fit,
                  params=p.surface.negative_affordance_projection)
    files = g.add(negative_affordance_files.run, mesh=mesh, descriptions=told, found=where, ctx=g.ctx,
                  params=negative_affordance_files.Params())
    record = g.add(object_record.run, views=views, candidates=found, descriptions=told, scores=fit, found=where, ctx=g.ctx,
                   params=object_record.Params())
    g.target("all", files, record)
    g.target("words", told)
    return g


def made(store: Path, graph: Graph, target: str, jobs: int) -> RunReport:
    return Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=jobs).run(graph, target)


def texts(folder: Path) -> dict[str, bytes]:
    """Read every file, with packed contents: chunks of recordings, frames of zstd."""
    return {str(path.relative_to(folder)): path.read_bytes() + b"".join(unpacked(path))
            for path in sorted(folder.rglob("*")) if path.is_file()}  # fmt: skip


def unpacked(path: Path) -> list[bytes]:
    data, magic, found = path.read_bytes(), b"\x28\xb5\x2f\xfd", []
    at = data.find(magic)
    while at >= 0:
        try:
            found.append(zstandard.ZstdDecompressor().decompressobj().decompress(data[at:]))
        except zstandard.ZstdError:
            found.append(b"")  # the magic number by chance
        at = data.find(magic, at + 1)
    if data.startswith(MCAP):
        with path.open("rb") as file:
            found += [message.data for _, _, message in make_reader(file).iter_messages()]
    return found


def forms(secret: str) -> list[bytes]:
    """Return possible encodings of a secret."""
    words = [secret, f"Bearer {secret}", secret.replace("/", r"\/")]
    return [form for word in words for form in (word.encode(), base64.b64encode(word.encode()), word.encode("utf-16-le"))]


def leaks(store: Path, *more: object) -> list[str]:
    """Return the files of the store, and the other texts, that contain the key."""
    everything = texts(store) | {f"more {n}": repr(value).encode() for n, value in enumerate(more)}
    return [name for name, data in everything.items() if any(form in data for form in forms(KEY))]


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Save a tiny CLIP; put the key into the environment."""
    plant(monkeypatch)
    return save_backbones(tmp_path / "models")


def test_answer_is_requested_once(models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that a cached answer needs neither server nor key."""
    with serving(lambda _: says(GOOD)) as server:
        graph = whole(params(server, tasks=("drive a screw", "hand over the screwdriver")), models)
        assert made(tmp_path / "store", graph, "words", jobs=0).ran == {"part_describe": 1}
        monkeypatch.delenv(VARIABLE)
        assert made(tmp_path / "store", graph, "words", jobs=0).cached == {"part_describe": 1}
    assert [asked.key for asked in server.asked] == [KEY, KEY]
    assert not leaks(tmp_path / "store")
    assert [name for name, data in texts(tmp_path / "store").items() if WORD in data]


@pytest.mark.parametrize("answer", [Answer(401, ECHO, (("X-Key", KEY),)), Answer(500, ECHO), Answer(200, raw=KEY.encode()),
                                    says(KEY)])  # fmt: skip
def test_failure_hides_the_key(answer: Answer, models: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Check the stored failure, the traceback and the output; the next run sends the request again."""
    with serving(lambda _: answer) as server:
        graph = whole(params(server, retries=0), models)
        reports = [made(tmp_path / "store", graph, "words", jobs=0) for _ in range(2)]
    assert all(report.failed == {"part_describe": 1} for report in reports) and len(server.asked) == 2
    assert {asked.key for asked in server.asked} == {KEY}
    assert len(Index(tmp_path / "store").failures()) == 1
    assert not leaks(tmp_path / "store", reports, capfd.readouterr())


def test_key_is_in_no_file(models: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Check store, traces, files, recording, report and output of worker processes.

    A word of the answer is found in the recording, so that a key would be found as well. Both an answer and a refusal are tested.
    """
    store = tmp_path / "store"
    with serving(lambda _: says(GOOD)) as server:
        good = made(store, whole(params(server), models), "all", jobs=1)
    with serving(lambda _: Answer(401, ECHO, (("X-Key", KEY),))) as refusing:
        bad = made(store, whole(params(refusing), models), "all", jobs=1)
    assert good.ok and bad.failed == {"part_describe": 1} and {asked.key for asked in server.asked + refusing.asked} == {KEY}
    assert not leaks(store, good, bad, capfd.readouterr())
    held = {name for name, data in texts(store).items() if WORD in data}
    recordings = {name for name in held if (store / name).read_bytes().startswith(MCAP)}
    assert recordings and not any(WORD in (store / name).read_bytes() for name in recordings) and len(held) >= 3
