"""The verb `backends`: the table of all registries, and the reasons why a backend is not usable here."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from commands import backends
from runner.fingerprint import fingerprint
from runner.selection import selector
from tests.helpers.command import call
from tests.helpers.stage_files import MODULES

ROOT = Path(__file__).resolve().parents[2]
LEARNED = {("mask_densify", "sam2"), ("mask_densify", "xmem"), ("object_completion", "sam2"), ("mask_propose", "sam"),
           ("mask_score", "clip"), ("part_describe", "vlm"), ("grasp_judge", "vlm"), ("hand_detect", "sam3")}  # fmt: skip


def found(*words: str | Path) -> dict[tuple[str, str], dict[str, object]]:
    shown = call("backends", "--json", *words)
    assert shown.code == 0, shown.words
    return {(row["stage"], row["backend"]): row for row in shown.json}


def test_registry_entries_are_listed_with_a_sentence() -> None:
    """Each has a description, and no two of a stage have the same."""
    rows = found()
    for stage, module in MODULES.items():
        for name in getattr(importlib.import_module(module), "BACKENDS", {}):
            assert len(str(rows[stage, name]["about"]).split()) > 2, (stage, name)
        shown = [row["about"] for (owner, _), row in rows.items() if owner == stage]
        assert len(set(shown)) == len(shown), stage


def test_backends_declare_their_weights() -> None:
    """Parameters of such a backend have a model, a device and a data type."""
    rows = found()
    assert {key for key, row in rows.items() if "weights" in str(row["needs"])} >= LEARNED
    for stage, name in LEARNED:
        own = getattr(importlib.import_module(MODULES[stage]).Params(), name)
        assert (own.model, own.device, own.dtype) == ("", "cpu", "float32")


def test_learned_backends_say_what_they_have_met() -> None:
    """Each that declares weights or a server, or whose code loads published weights: a level, a month, and what was seen."""
    page, rows = (ROOT / "docs" / "backends.md").read_text(encoding="utf-8"), found()
    learned = [one for one in backends.all_backends() if one.weights or one.server or loads_published(one)]
    learned += [one for one in backends.all_backends() if one.met and one not in learned]
    assert {(one.stage, one.name) for one in learned} >= LEARNED | {("afford.twohands.model.interface", "lite")}
    for one in learned:
        level, month, seen = one.met.partition(", 20")[0], *one.met.partition(", 20")[2].partition(": ")[::2]
        assert level in backends.LEVELS and re.fullmatch(r"\d\d-(0[1-9]|1[0-2])", month) and seen, (one.stage, one.name, one.met)
        assert rows[one.stage, one.name]["met"] == one.met and f"`{one.name}` | {one.about} " in page and f" {one.met} |" in page
    assert "has met published weights, 2026-" in call("backends", "hand_detect").words
    measured = "".join((ROOT / "benchmarks" / name).read_text(encoding="utf-8") for name in PAGES)
    figures = {figure for one in learned for figure in re.findall(r"([\d.,]+) (?:ms|s a|frames/s|px of)", one.met)}
    assert len(figures) > 4 and all(figure in measured for figure in figures), figures


PAGES = ("gpu.md", "inpaint.md", "hand_landmarks.md")
"""where the figures come from"""


READERS = {"afford.models.loading:load_cached", "afford.models.loading:load_pretrained", "afford.twohands.model.backbones:backbone",
           "afford.models.efficientnet_lite:read_encoder"}  # fmt: skip
"""functions that load weights of other projects"""


def loads_published(one: backends.Backend) -> bool:
    """Return True when the code behind a backend reaches one of READERS."""
    reached = fingerprint(backends._modules(), one.entry, {selector(one.registry): one.name}).definitions
    return not READERS.isdisjoint(reached)


def test_reasons_why_a_backend_is_not_usable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No weights named, an empty folder, no server, no key. The key itself is never shown."""
    empty, full = tmp_path / "empty", tmp_path / "full"
    empty.mkdir()
    full.mkdir()
    (full / "config.json").write_text("{}")
    (full / "model.safetensors").write_bytes(b"")
    key = ("mask_score", "clip")
    assert "--set mask_score.clip.model=FOLDER" in str(found("mask_score")[key]["why_not"])
    sets = ("mask_score", "--set", "mask_score.backend=clip", "--set")
    assert "no .json and .safetensors" in str(found(*sets, f"mask_score.clip.model={empty}")[key]["why_not"])
    assert "no such folder" in str(found(*sets, "mask_score.clip.model=/nowhere/at/all")[key]["why_not"])
    assert found(*sets, f"mask_score.clip.model={full}")[key]["usable"] is True
    asked = ("part_describe", "--set", "part_describe.endpoint.url=http://127.0.0.1:1/v1",
             "--set", "part_describe.endpoint.key_variable=SOME_KEY_HERE")  # fmt: skip
    monkeypatch.delenv("SOME_KEY_HERE", raising=False)
    assert found(*asked)["part_describe", "endpoint"]["why_not"] == "environment variable SOME_KEY_HERE is not set"
    monkeypatch.setenv("SOME_KEY_HERE", "sk-secret-123")
    assert found(*asked)["part_describe", "endpoint"]["usable"] is True
    assert "sk-secret" not in call("backends", *asked).words


def test_packages_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reason says how to install them."""
    monkeypatch.setattr(backends.importlib.util, "find_spec", lambda name: None if name == "transformers" else name)
    why = str(found("mask_densify")["mask_densify", "sam2"]["why_not"])
    assert why.startswith("not installed: transformers; make setup")
    assert found("mask_densify")["mask_densify", "nearest"]["usable"] is True


def test_an_unknown_stage_is_refused() -> None:
    shown = call("backends", "mask_densfy")
    assert shown.code == 2 and "did you mean 'mask_densify'?" in shown.err


def test_the_table_imports_nothing_heavy() -> None:
    """Descriptions are read from source files."""
    code = ("import sys\nfrom pipeline import main\nmain(['backends', 'mask_densify'])\n"
            "print([name for name in ('torch', 'transformers', 'cv2', 'numba') if name in sys.modules])")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_the_page_shows_the_table_that_the_command_writes(tmp_path: Path) -> None:
    """`backends --out` writes docs/backends.md, and refuses a page without markers."""
    page = tmp_path / "backends.md"
    page.write_text((ROOT / "docs" / "backends.md").read_text(encoding="utf-8"), encoding="utf-8")
    assert call("backends", "--out", page).code == 0
    written = (ROOT / "docs" / "backends.md").read_text()
    assert page.read_text() == written, "run `python pipeline.py backends --out docs/backends.md`"
    page.write_text("# no marks\n")
    assert call("backends", "--out", page).code == 2 and page.read_text() == "# no marks\n"


def test_sentences_end_where_they_end() -> None:
    assert backends._sentence("One thing. Two\nthings.\n\nThree.") == "One thing."
    assert backends._sentence("One\nthing") == "One thing."
    assert backends._sentence("UMD (Myers et al. 2015), e.g. cups. More.") == "UMD (Myers et al. 2015), e.g. cups."
    assert backends._sentence("Medical. More.") == "Medical."


def test_parameters_of_the_table_exist() -> None:
    """STAGE.PARAMETER is a field of the Params of a stage; other rows name a registry. No choice is listed twice."""
    for row in found().values():
        stage, _, field = str(row["parameter"]).partition(".")
        if ":" in str(row["parameter"]):
            module, _, registry = str(row["parameter"]).partition(":")
            assert row["backend"] in getattr(importlib.import_module(module), registry)
        else:
            assert field in importlib.import_module(MODULES[stage]).Params.__dataclass_fields__
    assert not [stage for stage, _ in found() if stage == "afford.training.job"]
