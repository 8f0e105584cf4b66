"""Recordings are whole by the readers of others: mcap's in Python and JavaScript, and Rerun's."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from afford.recording.moments import moments
from tests.helpers.made_recordings import H, W, recorded


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recording"))


def test_the_reference_reader_agrees(recording: Path) -> None:
    """mcap's own reader, with CRC validation, reads as many messages as the statistics say, and pictures of one size."""
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == reader.get_summary().statistics.message_count
        assert reader.get_header().library == "afford"
    assert next(iter(moments(recording, ["/frame_decode/image"]))).picture("/frame_decode/image").shape == (H, W, 3)


def test_rerun_accepts_it(recording: Path) -> None:
    """`rerun mcap check` exits 0."""
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("no rerun beside this python")
    done = subprocess.run([rerun, "mcap", "check", recording], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


READ_JS = """
const fs = require("fs"), { McapStreamReader, McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support"), { FileHandleReadable } = require("@mcap/nodejs");
(async () => {
  const decompressHandlers = await loadDecompressHandlers(), path = process.argv[2];
  const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  stream.append(fs.readFileSync(path));
  let streamed = 0, indexed = 0, schemas = new Set();
  for (let r; (r = stream.nextRecord()); ) {
    if (r.type === "Message") streamed++;
    if (r.type === "Schema") schemas.add(r.name);
  }
  if (!stream.done()) throw new Error("not finished");
  const reader = await McapIndexedReader.Initialize(
    { readable: new FileHandleReadable(await fs.promises.open(path)), decompressHandlers });
  for await (const m of reader.readMessages({ validateCrcs: true })) indexed++;
  const stated = Number(reader.statistics.messageCount);
  console.log(JSON.stringify({ streamed, indexed, stated, schemas: [...schemas] }));
})().catch((e) => { console.error(String(e)); process.exit(1); });
"""


@pytest.mark.npm
def test_the_javascript_reader_agrees(recording: Path, tmp_path: Path) -> None:
    """@mcap/core, streamed and indexed, with CRC validation: the same count; a flipped bit makes it fail."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("node or npm is missing")
    packages = ["@mcap/core@2.2.2", "@mcap/support@1.1.0", "@mcap/nodejs@1.0.2"]
    install = ["npm", "install", "--no-audit", "--no-fund", *packages]
    got = subprocess.run(install, cwd=tmp_path, capture_output=True, check=False)
    if got.returncode:
        pytest.skip("npm cannot install @mcap/core here")
    (tmp_path / "read.js").write_text(READ_JS)
    done = subprocess.run(["node", "read.js", recording], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["streamed"] == found["indexed"] == found["stated"] > 100 and "foxglove.CompressedImage" in found["schemas"]
    damaged = bytearray(recording.read_bytes())
    damaged[len(damaged) // 3] ^= 4
    (tmp_path / "bad.mcap").write_bytes(damaged)
    assert subprocess.run(["node", "read.js", "bad.mcap"], cwd=tmp_path, capture_output=True, check=False).returncode == 1
