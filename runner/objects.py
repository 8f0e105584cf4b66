"""Objects behind a URL: S3-compatible storage, Azure Blob Storage, Google Cloud Storage, or a folder, through `obstore`.

    s3://bucket/prefix   az://container/prefix   gs://bucket/prefix   file:///folder or a path

Conditional creation is atomic everywhere: `If-None-Match` on object storage, a hard link in a folder, which also holds on a shared
one. Files are transferred in parts, so that memory stays bounded. Credentials are read from the environment alone (AWS_*, AZURE_*,
GOOGLE_*); a URL that carries some is refused, and no error text contains any.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote, quote_plus, unquote, urlsplit

from blake3 import blake3

from runner.files import DamagedError, unique

PART_BYTES, PARTS = 1 << 23, 4
"""size of one request, and requests of one file that are under way at once"""
CLIENT = {"connect_timeout": "3s", "timeout": "60s"}
RETRY = {"max_retries": 2, "retry_timeout": timedelta(seconds=20),
         "backoff": {"init_backoff": timedelta(milliseconds=200), "max_backoff": timedelta(seconds=2), "base": 2}}
"""an unreachable endpoint costs about ten seconds"""
CLASSES = {"s3": "S3Store", "az": "AzureStore", "gs": "GCSStore"}
KNOWN = "use s3://BUCKET/PREFIX, az://CONTAINER/PREFIX, gs://BUCKET/PREFIX, file:///FOLDER or a folder"
SECRET = re.compile(r"^(AWS|AZURE|AZURITE|GOOGLE)_.*(KEY|SECRET|TOKEN|SAS|PASSWORD|CREDENTIAL|SERVICE_ACCOUNT)", re.IGNORECASE)
"""names of environment variables whose values never appear in a message"""
REFUSED = re.compile(r"status code: 4(?!08|29)|builder error|scheme is not allowed|URL scheme", re.IGNORECASE)

NO_BUCKET = re.compile("<Code>(NoSuchBucket|ContainerNotFound)<")


class RemoteError(OSError):
    """Request that failed; `offline` is true when the endpoint did not answer, and false when it refused the request."""

    def __init__(self, message: str, offline: bool) -> None:
        super().__init__(message)
        self.offline = offline


class Objects:
    """Named objects under a URL; `open_objects` creates one."""

    def __init__(self, url: str, store: Any) -> None:
        self.url, self._store = url, store

    def __repr__(self) -> str:
        return f"Objects({self.url!r})"

    def create(self, name: str, data: bytes) -> bool:
        """Create an object; False, and nothing is written, when there is one of that name."""
        import obstore

        try:
            self._call(obstore.put, name, data, mode="create", use_multipart=False)
        except FileExistsError:
            return False
        return True

    def put(self, name: str, data: bytes) -> None:
        """Create or replace an object."""
        import obstore

        self._call(obstore.put, name, data, use_multipart=False)

    def get(self, name: str) -> bytes | None:
        """Content of an object; None when there is none of that name."""
        import obstore

        try:
            return self._call(lambda store, path: bytes(obstore.get(store, path).bytes()), name)
        except FileNotFoundError:
            return None

    def has(self, name: str) -> bool:
        """Return True when there is an object of that name."""
        import obstore

        try:
            self._call(obstore.head, name)
        except FileNotFoundError:
            return False
        return True

    def list(self, folder: str) -> list[str]:
        """Names of the objects under a folder, sorted, each without the folder."""
        import obstore

        def collect(store: Any, path: str) -> list[str]:
            return [item["path"] for chunk in obstore.list(store, path, chunk_size=1000) for item in chunk]

        return sorted(name.removeprefix(f"{folder}/") for name in self._call(collect, folder))

    def delete(self, names: Sequence[str]) -> None:
        """Delete objects; one that is gone already is ignored."""
        import obstore

        if len(names) > 1:
            with suppress(FileNotFoundError):
                self._call(lambda store, paths: obstore.delete(store, paths), names)
                return
        for name in names:
            with suppress(FileNotFoundError):
                self._call(obstore.delete, name)

    def download(self, name: str, place: Path) -> str | None:
        """Write an object to a new file, part by part; return its BLAKE3 digest, or None when there is no such object."""
        try:
            parts = self._call(_parts, name)
            hasher = blake3()
            with place.open("xb") as stream:
                while (part := self._call(lambda store, path: next(parts, None), name)) is not None:
                    hasher.update(part)
                    stream.write(part)
        except FileNotFoundError:
            place.unlink(missing_ok=True)
            return None
        except BaseException:
            place.unlink(missing_ok=True)
            raise
        return hasher.hexdigest()

    def upload(self, name: str, path: Path, digest: str, replace: bool = False) -> bool:
        """Store a file under a name; False when there is one already and `replace` is not set.

        DamagedError, and nothing is stored, when the file does not match its BLAKE3 digest. A file above PART_BYTES is sent in
        parts that become visible together. Such a request has no condition: two hosts that send one file at once both succeed,
        and since both have verified it, the bytes are the same.
        """
        import obstore

        if path.stat().st_size <= PART_BYTES:
            data = b"".join(_verified(path, digest))
            if replace:
                self.put(name, data)
                return True
            return self.create(name, data)
        if not replace and self.has(name):
            return False
        self._call(obstore.put, name, _verified(path, digest), use_multipart=True, chunk_size=PART_BYTES, max_concurrency=PARTS)
        return True

    def _call(self, function: Any, name: str | Sequence[str], *arguments: Any, **options: Any) -> Any:
        """Call a function of obstore.

        FileExistsError, FileNotFoundError, DamagedError, or RemoteError with a text without credentials.
        """
        from obstore.exceptions import AlreadyExistsError, BaseError, GenericError

        try:
            return function(self._store, name, *arguments, **options)
        except AlreadyExistsError:
            raise FileExistsError(name) from None
        except DamagedError:
            raise
        except (BaseError, OSError, ValueError) as error:
            text = str(error)
            if (function.__name__ == "put" and isinstance(error, FileNotFoundError)) or NO_BUCKET.search(text):
                raise RemoteError(f"the bucket or container of {self.url} does not exist; create it first", False) from None
            if isinstance(error, FileNotFoundError):
                raise FileNotFoundError(name) from None
            offline = isinstance(error, GenericError) and not REFUSED.search(text)
            raise RemoteError(f"{self.url}: {scrubbed(text)}", offline) from None


def open_objects(url: str) -> Objects:
    """Open a URL or a folder, which is created if its parent exists; no request is sent.

    ValueError for an unknown scheme, for a URL with credentials, and for missing or malformed settings in the environment.
    """
    from obstore import store as stores
    from obstore.exceptions import BaseError

    scheme, rest, _ = url.partition("://")
    if not rest:
        return _folder(Path(url), url)
    if scheme != "file" and scheme not in CLASSES:
        raise ValueError(f"unknown scheme {scheme[:20]!r} of the remote; {KNOWN}")
    found = urlsplit(url)
    if "@" in found.netloc or ":" in found.netloc or found.query or found.fragment:
        raise ValueError(f"the URL of the remote must hold no user, password, port, query or token: credentials and endpoints are "
                         f"read from the environment, see docs/remote.md; {KNOWN}")  # fmt: skip
    if scheme == "file":
        if found.netloc not in ("", "localhost"):
            raise ValueError(f"a file URL of the remote has three slashes, got a host; {KNOWN}")
        return _folder(Path(unquote(found.path)), url)
    if not found.netloc:
        raise ValueError(f"the URL of the remote names no bucket or container; {KNOWN}")
    prefix = found.path.strip("/")
    try:
        made = getattr(stores, CLASSES[scheme])(found.netloc, prefix=prefix or None, client_options=CLIENT | _plain_http(scheme),
                                                retry_config=RETRY)
    except (BaseError, ValueError, OSError) as error:
        raise ValueError(f"cannot open the remote {scheme}://{found.netloc}: {scrubbed(str(error))}") from None
    return Objects(f"{scheme}://{found.netloc}/{prefix}".rstrip("/"), made)


def _folder(path: Path, url: str) -> Objects:
    from obstore.store import LocalStore

    path = path.expanduser().absolute()
    if not path.parent.is_dir():
        raise ValueError(f"the folder {path.parent} of the remote does not exist; mount or create it first")
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise ValueError(f"cannot use {path} as the remote: {error.strerror}") from None
    return Objects(str(path), LocalStore(path))


def _plain_http(scheme: str) -> dict[str, bool]:
    """Option that allows HTTP without TLS: for an endpoint on this machine, or where the environment allows it."""
    names = {"s3": ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"),
             "az": ("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT", "AZURITE_BLOB_STORAGE_URL")}.get(scheme, ())
    allowed = any(os.environ.get(name, "").lower() in ("1", "true") for name in ("AWS_ALLOW_HTTP", "AZURE_ALLOW_HTTP"))
    local = any(urlsplit(os.environ.get(name, "")).hostname in ("127.0.0.1", "localhost", "::1") for name in names)
    return {"allow_http": True} if allowed or local else {}


def scrubbed(text: str) -> str:
    """First line of a message, without queries of URLs and without values of secret environment variables."""
    line = re.sub(r"\s*<\?xml.*|\?[^\s\"')]*", "", text.strip().partition("\n")[0])
    secrets = {value for name, value in os.environ.items() if SECRET.search(name) and len(value) >= 4}
    for secret in sorted(secrets, key=len, reverse=True):
        for form in (secret, quote(secret, safe=""), quote_plus(secret)):
            line = line.replace(form, "***")
    return line[:400]


def _verified(path: Path, digest: str) -> Iterator[bytes]:
    """Yield a file in parts; DamagedError before the last one when the file does not match its digest."""
    hasher, held = blake3(), None
    with path.open("rb") as stream:
        while part := stream.read(PART_BYTES):
            hasher.update(part)
            if held is not None:
                yield held
            held = part
    if hasher.hexdigest() != digest:
        raise DamagedError(f"{path} does not match its digest")
    if held is not None:
        yield held


def _parts(store: Any, name: str) -> Iterator[bytes]:
    """Parts of an object; the first request is sent at once."""
    import obstore

    found = obstore.get(store, name)
    size = found.meta["size"]
    if size <= PART_BYTES:
        return iter([bytes(found.bytes())])
    del found

    def ranges() -> Iterator[bytes]:
        for start in range(0, size, PART_BYTES * PARTS):
            starts = range(start, min(start + PART_BYTES * PARTS, size), PART_BYTES)
            ends = [min(at + PART_BYTES, size) for at in starts]
            yield from map(bytes, obstore.get_ranges(store, name, starts=list(starts), ends=ends, coalesce=0))

    return ranges()


def temporary(place: Path) -> Path:
    """Path of a new file beside another, under a name that is unique on all hosts."""
    place.parent.mkdir(parents=True, exist_ok=True)
    return place.with_name(unique(place.name))
