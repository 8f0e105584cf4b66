"""Object storage on 127.0.0.1: an S3 server (moto), an Azure server (azurite, from npm), and a folder."""

from __future__ import annotations

import base64
import fcntl
import hashlib
import hmac
import os
import shutil
import socket
import subprocess
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email.utils import formatdate
from pathlib import Path

import pytest

AZURITE = "3.37.0"
ACCOUNT = "devstoreaccount1"
ACCOUNT_KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
"""the public account of every Azure emulator"""
SECRETS = ("AKIDOFTESTS", "secret/of+tests==")
"""credentials of the S3 server, which accepts any"""


@dataclass
class Server:
    """Object storage that runs: a URL to which a prefix is appended, and the environment under which it is used."""

    url: str
    environment: dict[str, str] = field(default_factory=dict)
    secrets: tuple[str, ...] = ()


SERVERS = ["folder", "s3", pytest.param("azure", marks=pytest.mark.npm)]
"""kinds of server, for the parameters of a fixture"""


@contextmanager
def serving(kind: str, place: Path) -> Iterator[Server]:
    """Run a server of a kind, with its settings in the environment."""
    made = {"folder": lambda: folder(place), "s3": s3_server, "azure": lambda: azure_server(place)}[kind]()
    with made as running, pytest.MonkeyPatch.context() as patch:
        for name, value in running.environment.items():
            patch.setenv(name, value)
        yield running


@contextmanager
def folder(path: Path) -> Iterator[Server]:
    """Serve a folder, which needs no server."""
    path.mkdir(parents=True, exist_ok=True)
    yield Server(str(path))


@contextmanager
def s3_server() -> Iterator[Server]:
    """Run moto's S3 server with one bucket; requests are served one after the other, as conditional writes need."""
    from moto.server import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import WSGIRequestHandler, make_server

    class Silent(WSGIRequestHandler):
        def log(self, *_: object) -> None:
            """Print nothing."""

    application, lock = DomainDispatcherApplication(create_backend_app), threading.Lock()

    def serve(environ, start_response):  # type: ignore[no-untyped-def]  # WSGI
        with lock:
            return list(application(environ, start_response))

    server = make_server("127.0.0.1", 0, serve, threaded=True, request_handler=Silent)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
    thread.start()
    endpoint = f"http://127.0.0.1:{server.server_port}"
    environment = {"AWS_ACCESS_KEY_ID": SECRETS[0], "AWS_SECRET_ACCESS_KEY": SECRETS[1], "AWS_REGION": "us-east-1",
                   "AWS_ENDPOINT_URL": endpoint}
    try:
        _send(f"{endpoint}/afford-tests", {})
        yield Server("s3://afford-tests", environment, SECRETS)
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextmanager
def azure_server(place: Path) -> Iterator[Server]:
    """Run azurite with one container; the test is skipped without node and npm."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("node or npm is missing")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [_azurite(), "--blobHost", "127.0.0.1", "--blobPort", str(port), "--location", place, "--silent",
               "--skipApiVersionCheck", "--disableTelemetry"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    endpoint = f"http://127.0.0.1:{port}/{ACCOUNT}"
    environment = {"AZURE_STORAGE_ACCOUNT_NAME": ACCOUNT, "AZURE_STORAGE_ACCOUNT_KEY": ACCOUNT_KEY,
                   "AZURE_STORAGE_ENDPOINT": endpoint}
    try:
        _wait_for(port, process)
        _create_container(endpoint)
        yield Server("az://afford-tests", environment, (ACCOUNT_KEY,))
    finally:
        process.terminate()
        process.wait()


def _azurite() -> Path:
    """Path of azurite's program, installed once for all checkouts."""
    place = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "afford-tests" / f"azurite-{AZURITE}"
    place.mkdir(parents=True, exist_ok=True)
    with (place / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        program = place / "node_modules" / ".bin" / "azurite-blob"
        if not program.exists():
            install = ["npm", "install", "--no-audit", "--no-fund", "--prefix", place, f"azurite@{AZURITE}"]
            if subprocess.run(install, capture_output=True, check=False).returncode:
                pytest.skip("npm cannot install azurite here")
    return program


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    for _ in range(600):
        assert process.poll() is None, "azurite ended"
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise AssertionError("azurite does not answer")


def _create_container(endpoint: str) -> None:
    date, version = formatdate(usegmt=True), "2021-08-06"
    text = "PUT" + "\n" * 12 + f"x-ms-date:{date}\nx-ms-version:{version}\n/{ACCOUNT}/{ACCOUNT}/afford-tests\nrestype:container"
    signature = base64.b64encode(hmac.new(base64.b64decode(ACCOUNT_KEY), text.encode(), hashlib.sha256).digest()).decode()
    _send(f"{endpoint}/afford-tests?restype=container",
          {"x-ms-date": date, "x-ms-version": version, "Authorization": f"SharedKey {ACCOUNT}:{signature}"})


def _send(url: str, headers: dict[str, str]) -> None:
    request = urllib.request.Request(url, method="PUT", headers=headers | {"Content-Length": "0"})
    with urllib.request.urlopen(request, timeout=30) as answer:
        assert answer.status in (200, 201)
