"""An object through the stages that look for where a hand must not go, with the backends and models that a test chooses."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from commands.settings import settings
from commands.weights import resolve_weights
from maps.common import weights
from maps.surface import ObjectHandles, add_affordance
from runner import Graph, Runner, RunReport
from schemas.files import FileTree
from stages.surface import mask_propose, negative_affordance_files, view_render
from tests.helpers.made_objects import VIEWS, looked

ROOT = Path(__file__).resolve().parents[2]


def run(store: Path, sets: Iterable[str]) -> tuple[Runner, RunReport]:
    """Mesh -> views -> masks -> descriptions -> scores -> surface -> files, on `--set` of these words."""
    runner, graph = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0), Graph()
    p = resolve_weights(settings(["mask_propose.regions.least_px=12", *sets], None), lambda path: runner.hash_file(path)[0])
    x = looked()
    mesh, parts = graph.leaf("mesh", x.mesh), graph.leaf("parts", x.parts)
    views = graph.add(view_render.run, mesh=mesh, params=VIEWS)
    masks = graph.add(mask_propose.run, mesh=mesh, views=views, params=p.surface.mask_propose, **weights(graph, p, "mask_propose"))
    found = add_affordance(graph, ObjectHandles(mesh, parts, views, masks), graph.leaf("scorer", FileTree("none", ())), p)
    files = graph.add(negative_affordance_files.run, mesh=mesh, descriptions=found.notes, found=found.found, ctx=graph.ctx,
                      params=negative_affordance_files.Params())  # fmt: skip
    graph.target("chain", files, found.fit, masks)
    return runner, runner.run(graph, "chain")


def content(report: RunReport, stage: str) -> str:
    """The digest of what a stage made."""
    return report.outputs[stage][0][1]


def flip_a_weight(file: Path, at: int = -2) -> None:
    """Another byte in a tensor at the end of a safetensors file: its exponent changes, its header does not."""
    data = bytearray(file.read_bytes())
    data[at] ^= 0x20
    file.write_bytes(bytes(data))
