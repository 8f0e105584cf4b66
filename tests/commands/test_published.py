"""What every target publishes, and where: names and places that people and scripts rely on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from commands.origin import origin
from commands.outputs import Publisher, collect_metrics, publish_outputs, stage_costs
from commands.session import open_runner
from maps.everything import CHAIN
from maps.settings import Origin, Settings
from pipeline import TARGETS, build
from runner import Graph, GraphError, RunReport
from runner.graph import Cost
from tests.helpers.made_files import artifact

REPORT = {"report": "reports/{source}"}
FILMS = {"films": "recordings/{source}/grasps", "prior": "models/{source}-prior", "teacher": "models/{source}-teacher"}
STATIC = ("static_sor3d", "static_boxes", "static_true_boxes")
GRASPING = ("motion_synthesise", "hand_imitation", "rl_grasp_refinement")
RECORDED: dict[str, tuple[str, ...]] = {
    "dataset": ("{clip}", "dataset_pack"), "train": ("model_train",), "benchmark": ("benchmark",), "ablation": ("ablation_report",),
    "hands": ("hands_train",), "negative-affordance": ("{clip}", "negative_affordance_report", "scorer_train"),
    "motions": ("motion_files", "motion_read"), "grasp": ("grasp_report", *GRASPING),
    "grasp-full": ("grasp_report", *GRASPING, "grasp_student"), "interactions": (),
    "sor3d": ("sor3d_train", "sor3d_report"), "sor3d-ablation": ("sor3d_report",),
    "static-sets": (*STATIC, "static_report", "boxes_train"), "extraction-report": ("extraction_report",),
    "recordings": ("{clip}",), "scenes": (), "train-set": ("train_pack",), "benchmark-set": ()}  # fmt: skip
"""target -> files of recordings/{source}"""
PLACES: dict[str, dict[str, str]] = {
    "dataset": {"dataset": "datasets/{source}"}, "train": {"model": "models/{source}"}, "benchmark": REPORT, "ablation": REPORT,
    "hands": {}, "negative-affordance": {**REPORT, "negative": "negative/{source}/{clip}"},
    "motions": {"report": "motions/{source}"}, "grasp": {**REPORT, **FILMS},
    "grasp-full": {**REPORT, **FILMS, "student": "models/{source}-student"}, "interactions": {},
    "sor3d": {**REPORT, "model": "models/{source}", "films": "recordings/{source}/interactions"}, "sor3d-ablation": REPORT,
    "static-sets": {name: f"reports/{{source}}/{name}" for name in (*STATIC, "static_report")}, "extraction-report": REPORT,
    "recordings": {}, "scenes": {"scenes": "scenes/{source}/{clip}/files"}, "train-set": {"dataset": "datasets/{source}"},
    "benchmark-set": {"benchmark": "benchmarks/{source}"}}  # fmt: skip
"""target -> output in the summary -> its place"""
FIGURES = {"benchmark": {"ms_per_image"}, "extraction-report": {"cpu_s_per_frame"}, "negative-affordance": {"cpu_s_per_object"},
           "grasp": {"control_steps_per_s", "mujoco.control_steps_per_s"},
           "grasp-full": {"control_steps_per_s", "mujoco.control_steps_per_s"}}  # fmt: skip
"""target -> figures of what stages cost"""
MEASURED = {**{name: {""} for name, places in PLACES.items() if "report" in places}, "static-sets": {f"{name}." for name in STATIC}}
"""target -> what stands before the figures of a report"""


def usual(target: str) -> Graph:
    """The graph of a target without a source."""
    return build(target, origin(target, None, Settings(), lambda path: "")[0], Settings())


def places(graph: Graph) -> set[tuple[str, str]]:
    return {(one.name, one.place) for one in graph.published}


@pytest.mark.parametrize("target", PLACES)
def test_a_target_publishes_what_it_always_has_and_where(target: str) -> None:
    """Outputs by name, recordings of clips and of the whole run."""
    wanted = {*PLACES[target].items(), *(("recordings", f"recordings/{{source}}/{name}.mcap") for name in RECORDED[target])}
    wanted |= {("scenes", "scenes/{source}/{clip}/truth")} if target == "scenes" else set()
    graph = usual(target)
    assert places(graph) == wanted
    assert {one.name for one in graph.costs} == FIGURES.get(target, set())
    assert {one.under for one in graph.measured} == MEASURED.get(target, set())
    made = {node.id for node in graph.upstream(graph.node_of(handle) for handle in graph.targets[target])}
    assert {one.node for one in graph.published} | {one.node for one in graph.measured} <= made


def test_every_target_is_in_the_table() -> None:
    assert {*PLACES, "all"} == TARGETS.keys()


# -- all of them together ----------------------------------------------------------------------------------------------


def computed(graph: Graph) -> set[Any]:
    """What a graph computes: every stage as function, parameters and what is computed before it."""
    seen: dict[int, Any] = {}
    for node in graph.nodes:
        seen[node.id] = (node.sort, repr(node.value), repr(node.params), tuple((name, seen[at]) for name, at in node.inputs))
    return {hash(seen[node.id]) for node in graph.stages()}


def test_all_has_every_stage_of_its_targets_once() -> None:
    """What several targets share is one node; no name is there twice; and no target makes anything else than it does alone."""
    together, alone = usual("all"), {name: usual(name) for name in CHAIN}
    names = [node.name for node in together.stages()]
    assert len(names) == len(set(names))
    assert len(computed(together)) == len(names) == len(set().union(*map(computed, alone.values())))
    assert computed(together) == set().union(*map(computed, alone.values()))
    assert sum(len(graph.stages()) for graph in alone.values()) > len(names)
    assert {(one.part, one.name, one.place) for one in together.published} == {
        (name, one.name, one.place) for name, graph in alone.items() for one in graph.published}


def test_parts_of_all_lie_where_their_targets_put_them() -> None:
    """Each has the name of what it is made of; names in the summary begin with the target."""
    place = origin("all", None, Settings(), lambda path: "")[0]
    assert {name: place.of(name).name for name in CHAIN} == {
        name: origin(name, None, Settings(), lambda path: "")[0].name for name in CHAIN}


# -- labels ------------------------------------------------------------------------------------------------------------


def test_a_label_computes_nothing() -> None:
    """A graph with labels has the nodes of one without; what is published is the value that was made."""
    g, h = Graph(), Graph()
    g.leaf("made", "word")
    made = h.leaf("made", "word")
    assert h.publish(made, "made/{source}", as_="made") is made and h.measure(made) is made
    h.cost("cpu_s", [made], (made, "words"))
    assert g.nodes == h.nodes and not g.published


def test_only_values_of_the_graph_are_published() -> None:
    with pytest.raises(GraphError, match="expected a handle of this graph, got str"):
        Graph().publish("word", "words", as_="word")


def test_every_kind_of_place(tmp_path: Path) -> None:
    """One folder, a folder for each clip, one file, a file for each clip; nothing where nothing was made."""
    runner, g = open_runner(tmp_path / "store", jobs=0), Graph()
    whole = artifact(runner, tmp_path / "whole", **{"metrics.json": '{"iou": 0.5}', "x": "x"})
    film = artifact(runner, tmp_path / "film", x="x")
    kinds = {"report": "reports/{source}", "negative": "negative/{source}/{clip}", "film": "films/{source}/all.mcap",
             "films": "films/{source}/{clip}.mcap", "none": "none/{source}"}  # fmt: skip
    handles = {name: g.publish(g.leaf(name, name), place, as_=name) for name, place in kinds.items()}
    g.measure(handles["report"], under="x.")
    report = RunReport("t", outputs={"report": [("", whole)], "negative": [("a/b", whole), ("a/c", whole)], "film": [("", film)],
                                     "films": [("a/b", film), ("a/c", film)]})  # fmt: skip
    to, store = Publisher(runner), tmp_path / "store"
    assert publish_outputs(to, g, report, Origin("mine"), True) == {
        "report": str(store / "reports" / "mine"), "negative": str(store / "negative" / "mine"),
        "film": str(store / "films" / "mine"), "films": str(store / "films" / "mine")}  # fmt: skip
    assert {path.name for path in (store / "films" / "mine").glob("*.mcap")} == {"all.mcap", "b.mcap", "c.mcap"}
    assert {path.name for path in (store / "negative" / "mine").iterdir()} == {"b", "c"}
    assert json.loads((store / "reports" / "mine" / "metrics.json").read_text()) == {"iou": 0.5}
    assert collect_metrics(to, g, report) == {"x.iou": 0.5}
    report.outputs["films"] = [("a/b", film)]
    publish_outputs(to, g, report, Origin("mine"), False)
    assert (store / "films" / "mine" / "c.mcap").exists()
    publish_outputs(to, g, report, Origin("mine"), True)
    assert not (store / "films" / "mine" / "c.mcap").exists() and (store / "films" / "mine" / "all.mcap").exists()


def test_costs_are_counted_in_what_was_measured() -> None:
    """Of the shards that were scored; each stage alone and all together; nothing where nothing was spent or measured."""
    report = RunReport("t", cpu_s={("read", "a"): 1.0, ("read", "b"): 2.0, ("look", "a"): 3.0, ("score", "a"): 9.0})
    cost = Cost("cpu_s", ("read", "look"), 0, "objects", "score", 1.0, each=True, rate=False)
    assert stage_costs(cost, report, {"objects": 2.0}) == {"cpu_s.read": 0.5, "cpu_s.look": 1.5, "cpu_s": 2.0}
    assert stage_costs(Cost("ms", ("read",), 0, "objects", None, 1000.0, False, False), report, {"objects": 2.0}) == {"ms": 1500.0}
    assert stage_costs(cost, RunReport("t"), {"objects": 2.0}) == stage_costs(cost, report, {}) == {}
