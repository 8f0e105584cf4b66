"""A whole comparison in a store: a tiny untrained model, every baseline and a folder of masks on the small benchmark."""

from __future__ import annotations

from pathlib import Path

from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.model_folder import save_model
from maps.settings import Origin, Settings
from maps.twohands import benchmark_report
from runner import Graph, Runner, RunReport
from schemas.files import FileTree
from stages.extraction import dataset_pack
from stages.twohands import benchmark
from tests.helpers.made_cases import as_tree, box, write_benchmark, write_mask
from tests.helpers.made_samples import Scratch, clip

ROOT = Path(__file__).resolve().parents[2]
TINY = ModelConfig(size_px=(32, 48), widths=(16, 16, 32), depth=1, decoder_depth=1, heads=2, text_buckets=64)


def inputs(folder: Path) -> tuple[FileTree, FileTree, FileTree, FileTree]:
    """Cases, a data set, a model, and the predictions of another method, as files."""
    cases = as_tree(write_benchmark(folder / "bench"))
    made = tuple(clip(f"P{n:02d}_01", 5, split=("train", "val")[n]) for n in range(2))
    data = dataset_pack.run(made, dataset_pack.Params(), Scratch(folder / "data"))
    save_model(build(TINY, 0), folder / "trained" / "model")
    write_mask(folder / "lisa" / "P01_01" / "0000140" / "aff_left.png", box(10, 10, 30, 30))
    return cases, data, as_tree(folder / "trained"), as_tree(folder / "lisa")


def graph(folder: Path) -> Graph:
    """The comparison, as the target makes it."""
    cases, data, model, other = inputs(folder)
    g = Graph()
    origin = Origin("tiny", predictions=(other,))
    settings = Settings.of(benchmark=benchmark.Params(resamples=50))
    leaves = (g.leaf("cases", cases), g.leaf("data", data), g.leaf("model", model))
    g.target("benchmark", benchmark_report(g, *leaves, origin, settings))
    return g


def run(folder: Path, store: Path) -> RunReport:
    """Make it."""
    return Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0).run(graph(folder), "benchmark")
