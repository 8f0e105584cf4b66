"""Laws of the remote, the same behind S3, Azure and a folder: what travels arrives whole, and nothing else travels."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from blake3 import blake3

from runner import objects as objects_module
from runner import remote as remote_module
from runner.files import DamagedError
from runner.objects import PART_BYTES, Objects, RemoteError, open_objects, scrubbed
from runner.remote import Remote, RemoteWarning, blob_name, queued, travelling
from tests.helpers.object_servers import SERVERS, Server, serving

CHECK = b"0" * 32 + b" "
ROWS = (CHECK + b'["spec","s",{"function":"stages.a:run"}]\n' + CHECK + b'["artifact","d","mask",[["m.png","ab",3,0]],null]\n'
        + CHECK + b'["trace","k","d","s","a","c0",{},{},1,"code",0.1,0.1,3.0,1.0]\n')


@pytest.fixture(scope="module", params=SERVERS)
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(request.param, tmp_path_factory.mktemp(request.param)) as running:
        yield running


@pytest.fixture
def url(server: Server) -> str:
    return f"{server.url}/{uuid.uuid4().hex}"


def stored(local: Path, data: bytes) -> tuple[str, Path]:
    """A blob of a local store."""
    blob = blake3(data).hexdigest()
    path = local / blob_name(blob)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return blob, path


def remotes(url: str, tmp_path: Path, number: int = 2) -> list[Remote]:
    """Remotes of as many hosts, each with a local store of its own."""
    return [Remote.open(url, tmp_path / f"host{index}") for index in range(number)]


# -- objects -------------------------------------------------------------------------------------------------------


def test_conditional_creation_has_one_winner(url: str) -> None:
    """Six creators of ten names at once: each name has one winner, whose bytes stay."""
    won: list[tuple[str, int]] = []

    def create(number: int) -> None:
        mine = open_objects(url)
        won.extend((f"a/{name}", number) for name in range(10) if mine.create(f"a/{name}", b"%d" % number))

    threads = [threading.Thread(target=create, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    objects = open_objects(url)
    assert sorted(name for name, _ in won) == sorted(f"a/{name}" for name in range(10))
    assert all(objects.get(name) == b"%d" % number for name, number in won)


def test_objects_are_put_listed_and_deleted(url: str) -> None:
    """A missing object is None, absent from lists, and deleting it does nothing."""
    objects = open_objects(url)
    assert objects.list("x") == [] and objects.get("x/a") is None and not objects.has("x/a")
    objects.put("x/a", b"")
    objects.put("x/b/1", b"1")
    objects.put("xy", b"2")
    objects.put("x/b/1", b"3")
    assert objects.list("x") == ["a", "b/1"] and objects.get("x/a") == b"" and objects.get("x/b/1") == b"3" and objects.has("x/a")
    objects.delete(["x/a", "x/none", "x/b/1"])
    objects.delete(["x/a"])
    assert objects.list("x") == [] and objects.get("xy") == b"2"


@pytest.mark.parametrize("bad", ["ftp://host/x", "http://user:word@host/x", "s3:bucket://x"])
def test_unknown_schemes_are_refused(bad: str, tmp_path: Path) -> None:
    """The error lists the known ones."""
    with pytest.raises(ValueError, match="use s3://BUCKET/PREFIX") as error:
        Remote.open(bad, tmp_path)
    assert "word" not in str(error.value)


@pytest.mark.parametrize("bad", ["s3://AKID:hush-hush@bucket/x", "az://box/x?sv=1&sig=hush-hush", "s3://bucket/x#hush-hush",
                                 "s3://bucket:80/x", "gs://hush-hush@bucket"])  # fmt: skip
def test_urls_with_credentials_are_refused(bad: str, tmp_path: Path) -> None:
    """The error does not repeat them."""
    with pytest.raises(ValueError, match="read from the environment") as error:
        Remote.open(bad, tmp_path)
    assert "hush" not in str(error.value) and "AKID" not in str(error.value)


def test_folders_are_opened_by_path_and_by_url(tmp_path: Path) -> None:
    """A missing parent is an error: a shared folder may not be mounted."""
    assert open_objects(f"file://{tmp_path}/one%20two").url == str(tmp_path / "one two")
    with pytest.raises(ValueError, match="mount or create it first"):
        open_objects(str(tmp_path / "none" / "x"))
    with pytest.raises(ValueError, match="three slashes"):
        open_objects("file://host/x")


# -- blobs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0, 1, PART_BYTES, PART_BYTES + 1, 5 * PART_BYTES + 7])
def test_blobs_arrive_whole(url: str, tmp_path: Path, size: int) -> None:
    """Pushed by one host, pulled by another: verified, read-only, and no temporary file stays."""
    one, two = remotes(url, tmp_path)
    blob, path = stored(tmp_path / "host0", random.Random(size).randbytes(size))
    place = tmp_path / "host1" / blob_name(blob)
    assert not two.pull(blob, place) and not place.exists() and not two.has(blob)
    assert one.push(blob, path) and two.has(blob)
    assert two.pull(blob, place) and place.read_bytes() == path.read_bytes()
    assert place.stat().st_mode & 0o222 == 0 and os.listdir(place.parent) == [place.name]


@pytest.mark.parametrize("size", [100, PART_BYTES + 1])
def test_a_push_overwrites_nothing(url: str, tmp_path: Path, size: int) -> None:
    """An object that is there counts as pushed, and stays; `replace` writes it again; damaged files are not sent."""
    remote, objects = remotes(url, tmp_path, 1)[0], open_objects(url)
    blob, path = stored(tmp_path, bytes(size))
    objects.put(blob_name(blob), b"there")
    assert remote.push(blob, path) and objects.get(blob_name(blob)) == b"there"
    assert remote.push(blob, path, replace=True) and objects.get(blob_name(blob)) == bytes(size)
    other, path = stored(tmp_path, b"1" * size)
    path.write_bytes(b"1" * (size - 1) + b"2")
    with pytest.raises(DamagedError):
        remote.push(other, path)
    assert not remote.has(other)


@pytest.mark.parametrize("damage", ["first", "middle", "last", "shorter", "longer", "empty"])
def test_flipped_blobs_are_found_and_healed(url: str, tmp_path: Path, damage: str) -> None:
    """A damaged blob does not arrive; after the next push it does."""
    remote, objects = remotes(url, tmp_path, 1)[0], open_objects(url)
    data = random.Random(1).randbytes(1000)
    blob, path = stored(tmp_path, data)
    flips = {"first": bytes([data[0] ^ 1]) + data[1:], "middle": data[:500] + bytes([data[500] ^ 128]) + data[501:],
             "last": data[:-1] + bytes([data[-1] ^ 16]), "shorter": data[:-1], "longer": data + b"\0", "empty": b""}  # fmt: skip
    objects.put(blob_name(blob), flips[damage])
    with pytest.raises(DamagedError, match="does not match its digest"):
        remote.pull(blob, tmp_path / "place" / "x")
    assert os.listdir(tmp_path / "place") == []
    assert remote.push(blob, path) and remote.pull(blob, tmp_path / "place" / "x")
    assert (tmp_path / "place" / "x").read_bytes() == data


PEAK = """
import sys
from pathlib import Path
from runner.remote import Remote

def peak():
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) // 1024

url, local, blob, path, place = sys.argv[1:]
remote = Remote.open(url, Path(local))
remote.connect()
before = peak()
assert remote.push(blob, Path(path)) and remote.pull(blob, Path(place))
print(peak() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_memory_is_bounded(tmp_path: Path) -> None:
    """A file of 25 parts is pushed and pulled in less memory than half of it."""
    blob, path = stored(tmp_path, random.Random(2).randbytes(PART_BYTES) * 25)
    words = [tmp_path / "remote", tmp_path, blob, path, tmp_path / "place" / "x"]
    done = subprocess.run([sys.executable, "-c", PEAK, *map(str, words)], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 25 * PART_BYTES / 2**21


# -- traces --------------------------------------------------------------------------------------------------------


def test_segments_travel_once(url: str, tmp_path: Path) -> None:
    """Each row reaches every other host once, and does not return to its own; names never collide."""
    one, two = remotes(url, tmp_path)
    assert one.publish((), ROWS) and one.publish((), ROWS.replace(b'"k"', b'"l"')) and two.publish((), ROWS.replace(b'"k"', b'"m"'))
    assert len(set(one.segments())) == 3 and one.segments() == two.segments()
    for remote, keys in ((one, [b'"m"']), (two, [b'"k"', b'"l"'])):
        arrived = list(remote.new_segments())
        assert len(arrived) == len(keys) and all(any(key in rows for _, rows in arrived) for key in keys)
        assert all(remote.pull_segment(name) == rows for name, rows in arrived)
        remote.note(name for name, _ in arrived)
        assert list(remote.new_segments()) == []
    assert len(list(Remote.open(url, tmp_path / "third").new_segments())) == 3


def test_private_rows_stay(url: str, tmp_path: Path) -> None:
    """Uses, drops, failures, files outside the store, torn and damaged lines stay."""
    private = [b'["use","a","c0","k",1.0]', b'["drop","a","d",1.0]', b'["failure","k","a","c0","no","/home/me",1.0]',
               b'["artifact","e","mask",[["m.png","ab",3,0,"/home/me/m.png",[1,2,3,4]]],null]', b'["forget","k"]', b"{torn", b"3"]
    rows = b"".join(CHECK + row + b"\n" for row in private) + ROWS + CHECK + b'["trace"'
    one, two = remotes(url, tmp_path)
    assert travelling(rows) == ROWS and one.publish((), rows)
    assert [arrived for _, arrived in two.new_segments()] == [ROWS]
    assert one.publish((), rows.replace(ROWS, b"")) and len(two.segments()) == 1


def test_segments_of_a_run_are_merged(url: str, tmp_path: Path) -> None:
    """Into one with the same rows; segments of other runs stay."""
    one, two = remotes(url, tmp_path)
    rows = [ROWS.replace(b'"k"', b'"%d"' % number) for number in range(6)]
    assert all(one.publish((), row) for row in rows) and two.publish((), ROWS)
    one.merge()
    two.merge()
    assert len(two.segments()) == 2
    assert [arrived for _, arrived in two.new_segments()] == [b"".join(rows)] and len(list(one.new_segments())) == 1


# -- offline -------------------------------------------------------------------------------------------------------


@pytest.fixture
def unreachable(monkeypatch: pytest.MonkeyPatch) -> str:
    """A URL whose endpoint refuses connections."""
    for name, value in {"AWS_ACCESS_KEY_ID": "AKIDX", "AWS_SECRET_ACCESS_KEY": "hush-hush", "AWS_REGION": "us-east-1",
                        "AWS_ENDPOINT_URL": "http://127.0.0.1:9"}.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(objects_module, "RETRY", {"max_retries": 0})
    return "s3://bucket/x"


def test_offline_is_one_warning(unreachable: str, tmp_path: Path) -> None:
    """Reads find nothing, pushes are queued, and the warning names the URL but no credential."""
    remote = Remote.open(unreachable, tmp_path)
    blob, path = stored(tmp_path, b"data")
    with pytest.warns(RemoteWarning, match="s3://bucket/x") as caught:
        assert not remote.connect() and not remote.online
        assert not remote.pull(blob, tmp_path / "x") and not remote.has(blob) and not remote.push(blob, path)
        assert remote.segments() == [] and list(remote.new_segments()) == []
        assert not remote.publish([blob], ROWS) and remote.flush() == 1
    assert len(caught) == 1 and "hush" not in str(caught[0].message) and "AKIDX" not in str(caught[0].message)
    assert len(queued(tmp_path)) == 1 and not (tmp_path / "x").exists()


def test_queued_results_are_pushed_by_the_next_run(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blobs and rows arrive; entries for another URL stay; a damaged entry is reported and removed."""
    one, two = remotes(url, tmp_path)
    blob, _ = stored(tmp_path / "host0", b"data")
    monkeypatch.setattr(one, "_retry_at", float("inf"))
    assert not one.publish([blob, "00" * 32], ROWS) and not one.publish([], ROWS)
    second = next(path for path in queued(tmp_path / "host0") if blob.encode() not in path.read_bytes())
    second.write_bytes(second.read_bytes()[:-3])
    other = Remote.open(str(tmp_path / "elsewhere"), tmp_path / "host0")
    monkeypatch.setattr(other, "_retry_at", float("inf"))
    other.publish([blob], ROWS)
    said: list[str] = []
    assert Remote.open(url, tmp_path / "host0", said.append).flush() == 0
    assert len(said) == 1 and "damaged" in said[0] and len(queued(tmp_path / "host0")) == 1
    assert two.pull(blob, tmp_path / "host1" / "x") and [rows for _, rows in two.new_segments()] == [ROWS]


def test_the_remote_is_tried_again(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Requests are sent again after some time without them."""
    remote = remotes(url, tmp_path, 1)[0]
    monkeypatch.setattr(remote_module, "RETRY_AFTER_S", 0.0)

    def fail(_: str) -> list[str]:
        raise RemoteError("no answer", offline=True)

    with monkeypatch.context() as patch, pytest.warns(RemoteWarning) as caught:
        patch.setattr(remote.objects, "list", fail)
        assert remote.segments() == [] and remote.segments() == []
    assert len(caught) == 1
    assert remote.publish((), ROWS) and len(remote.segments()) == 1


# -- configuration and credentials ---------------------------------------------------------------------------------


def test_a_missing_bucket_is_an_error(server: Server, tmp_path: Path) -> None:
    """The run stops, since waiting does not help."""
    if not server.environment:
        pytest.skip("a folder is created")
    scheme = server.url.partition("://")[0]
    remote = Remote.open(f"{scheme}://there-is-none/x", tmp_path)
    with pytest.raises(RemoteError, match=r"there-is-none.*create it first"):
        remote.connect()
    with pytest.raises(RemoteError, match="create it first"):
        remote.objects.put("a", b"")


def test_wrong_credentials_are_an_error(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run stops, since waiting does not help."""
    if not server.url.startswith("az:"):
        pytest.skip("accepts any credentials")
    monkeypatch.setenv("AZURE_STORAGE_ACCOUNT_KEY", "d3Jvbmcga2V5")
    with pytest.raises(RemoteError) as error:
        Remote.open(server.url, tmp_path).connect()
    assert not error.value.offline and "d3Jvbmcga2V5" not in str(error.value)


def test_credentials_appear_nowhere(server: Server, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Texts of a remote and of its errors, objects and the local store contain none."""
    remote = remotes(url, tmp_path, 1)[0]
    blob, _ = stored(tmp_path / "host0", b"data")
    assert remote.publish([blob], ROWS)
    texts = [repr(remote), str(remote), repr(remote.objects), repr(vars(remote.objects)["url"])]
    monkeypatch.setattr(remote, "_retry_at", float("inf"))
    remote.publish([blob], ROWS)
    for path in (tmp_path / "host0").rglob("*"):
        texts.append(path.read_bytes().decode(errors="replace") if path.is_file() else "")
    objects = open_objects(url)
    texts += [(objects.get(name) or b"").decode(errors="replace") for name in (blob_name(blob), *objects.list("traces"))]
    for name in [name for name in server.environment if "ENDPOINT" in name]:
        monkeypatch.setenv(name, "http://127.0.0.1:9/x")
    monkeypatch.setattr(objects_module, "RETRY", {"max_retries": 0})
    if server.environment:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            Remote.open(url, tmp_path).connect()
        texts += [str(warning.message) for warning in caught]
        assert caught
    assert not [secret for secret in server.secrets for text in texts if secret in text]


def test_messages_are_scrubbed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values of secret variables, also quoted, queries of URLs, and everything after the first line."""
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "a/b+c=d")
    monkeypatch.setenv("AZURE_STORAGE_SAS_TOKEN", "sv=1&sig=hush")
    text = scrubbed("GET http://x/y?sv=1&sig=hush key a/b+c=d or a%2Fb%2Bc%3Dd failed\nmore: hush")
    assert text == "GET http://x/y key *** or *** failed"


def test_downloads_leave_nothing_behind(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A request that fails in the middle leaves no partial file."""
    objects = open_objects(url)
    data = bytes(PART_BYTES + 1)
    objects.put("a", data)
    call = Objects._call
    calls = iter([True, False])

    def broken(self: Objects, function: object, name: str, *arguments: object, **options: object) -> object:
        if next(calls):
            return call(self, function, name, *arguments, **options)
        raise RemoteError("broken", offline=True)

    monkeypatch.setattr(Objects, "_call", broken)
    with pytest.raises(RemoteError):
        objects.download("a", tmp_path / "x")
    assert os.listdir(tmp_path) == []
