"""Published outputs of every target, with names and places that people and scripts rely on; partial outputs; costs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from commands.origin import origin
from commands.outputs import Publisher, collect_metrics, partial_outputs, publish_outputs, stage_costs
from commands.session import open_runner
from maps.everything import CHAIN
from maps.settings import Origin, Settings
from pipeline import TARGETS, build
from runner import Failure, Graph, GraphError, Runner, RunReport
from runner.graph import Cost
from tests.helpers.command import KEYS, Made
from tests.helpers.made_files import artifact, content
from tests.helpers.tiny_source import VIDEOS, media

REPORT = {"report": "reports/{source}"}
FILMS = {"films": "recordings/{source}/grasps", "prior": "models/{source}-prior", "teacher": "models/{source}-teacher"}
REFINED = {"refined": "models/{source}-bodies"}
"""policy for bodies, which is trained where none is shipped"""
STATIC = ("static_sor3d", "static_boxes", "static_true_boxes")
GRASPING = ("motion_synthesise", "hand_imitation", "rl_grasp_refinement")
RECORDED: dict[str, tuple[str, ...]] = {
    "dataset": ("{clip}", "dataset_pack"), "train": ("model_train",), "benchmark": ("benchmark",), "ablation": ("ablation_report",),
    "hands": ("hands_train",), "held": ("held_train",),
    "negative-affordance": ("{clip}", "negative_affordance_report", "scorer_train"),
    "motions": ("motion_files", "motion_read"), "grasp": ("grasp_report", *GRASPING),
    "grasp-full": ("grasp_report", *GRASPING, "grasp_student"), "grasp-play": (),
    "grasp-adapt": ("body_report",),
    "grasp-household": ("household_report",),
    "grasp-prior": ("prior_report", "motion_synthesise", "human_motion", "hand_imitation"), "interactions": (),
    "sor3d": ("sor3d_train", "sor3d_report"), "sor3d-ablation": ("sor3d_report",),
    "static-sets": (*STATIC, "static_report", "boxes_train"), "extraction-report": ("extraction_report",),
    "recordings": ("{clip}",), "scenes": (), "train-set": ("train_pack",), "benchmark-set": ()}  # fmt: skip
"""target -> files of recordings/{source}"""
PLACES: dict[str, dict[str, str]] = {
    "dataset": {"dataset": "datasets/{source}"}, "train": {"model": "models/{source}"}, "benchmark": REPORT, "ablation": REPORT,
    "hands": {}, "held": {}, "negative-affordance": {**REPORT, "negative": "negative/{source}/{clip}"},
    "motions": {"report": "motions/{source}"}, "grasp": {**REPORT, **FILMS},
    "grasp-full": {**REPORT, **FILMS, "student": "models/{source}-student"},
    "grasp-play": {"films": "recordings/{source}/grasps"},
    "grasp-adapt": {**REPORT, **REFINED, "adapted": "models/{source}/{clip}",
                    **{f"films_{number}": f"recordings/{{source}}/grasps-{number}" for number in (0, 1)}},
    "grasp-household": {**REPORT, **REFINED, "films_bullet": "recordings/{source}/{clip}",
                        "films_mujoco": "recordings/{source}/{clip}"},
    "grasp-prior": {**REPORT, "prior": "models/{source}-prior"},
    "interactions": {},
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
    """Graph of a target without a source."""
    return build(target, origin(target, None, Settings(), lambda path: "")[0], Settings())


def places(graph: Graph) -> set[tuple[str, str]]:
    return {(one.name, one.place) for one in graph.published}


@pytest.mark.parametrize("target", PLACES)
def test_a_target_publishes_the_listed_outputs(target: str) -> None:
    """Outputs by name, recordings of clips and of the whole run."""
    wanted = {*PLACES[target].items(), *(("recordings", f"recordings/{{source}}/{name}.mcap") for name in RECORDED[target])}
    wanted |= {("scenes", "scenes/{source}/{clip}/truth")} if target == "scenes" else set()
    graph = usual(target)
    assert places(graph) == wanted
    assert {one.name for one in graph.costs} == FIGURES.get(target, set())
    assert {one.under for one in graph.measured} == MEASURED.get(target, set())
    made = {node.id for node in graph.upstream(graph.node_of(handle) for handle in graph.targets[target])}
    assert {one.node for one in graph.published} | {one.node for one in graph.measured} <= made


def test_targets_are_in_the_table() -> None:
    assert {*PLACES, "all"} == TARGETS.keys()


# -- all of them together ----------------------------------------------------------------------------------------------


def computed(graph: Graph) -> set[Any]:
    """Content of a graph: every stage as function, parameters and inputs."""
    seen: dict[int, Any] = {}
    for node in graph.nodes:
        seen[node.id] = (node.sort, repr(node.value), repr(node.params), tuple((name, seen[at]) for name, at in node.inputs))
    return {hash(seen[node.id]) for node in graph.stages()}


def test_the_target_all_has_the_stages_of_its_targets_once() -> None:
    """Shared stages are one node, no name occurs twice, and each target computes the same as alone."""
    together, alone = usual("all"), {name: usual(name) for name in CHAIN}
    names = [node.name for node in together.stages()]
    assert len(names) == len(set(names))
    assert len(computed(together)) == len(names) == len(set().union(*map(computed, alone.values())))
    assert computed(together) == set().union(*map(computed, alone.values()))
    assert sum(len(graph.stages()) for graph in alone.values()) > len(names)
    assert {(one.part, one.name, one.place) for one in together.published} == {
        (name, one.name, one.place) for name, graph in alone.items() for one in graph.published}


def test_parts_of_all_lie_where_their_targets_put_them() -> None:
    """Each part has the name of its origin; names in the summary begin with the target."""
    place = origin("all", None, Settings(), lambda path: "")[0]
    assert {name: place.of(name).name for name in CHAIN} == {
        name: origin(name, None, Settings(), lambda path: "")[0].name for name in CHAIN}


# -- labels ------------------------------------------------------------------------------------------------------------


def test_a_label_computes_nothing() -> None:
    """A graph with labels has the nodes of one without; the published value is the computed one."""
    g, h = Graph(), Graph()
    g.leaf("made", "word")
    made = h.leaf("made", "word")
    assert h.publish(made, "made/{source}", as_="made") is made and h.measure(made) is made
    h.cost("cpu_s", [made], (made, "words"))
    assert g.nodes == h.nodes and not g.published


def test_values_outside_the_graph_cannot_be_published() -> None:
    with pytest.raises(GraphError, match="expected a handle of this graph, got str"):
        Graph().publish("word", "words", as_="word")


def test_kinds_of_places(tmp_path: Path) -> None:
    """One folder, a folder per clip, one file, a file per clip; nothing without an output."""
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
    """Counted over the scored shards, for each stage and all together; omitted where nothing was spent or measured."""
    report = RunReport("t", cpu_s={("read", "a"): 1.0, ("read", "b"): 2.0, ("look", "a"): 3.0, ("score", "a"): 9.0})
    cost = Cost("cpu_s", ("read", "look"), 0, "objects", "score", 1.0, each=True, rate=False)
    assert stage_costs(cost, report, {"objects": 2.0}) == {"cpu_s.read": 0.5, "cpu_s.look": 1.5, "cpu_s": 2.0}
    assert stage_costs(Cost("ms", ("read",), 0, "objects", None, 1000.0, False, False), report, {"objects": 2.0}) == {"ms": 1500.0}
    assert stage_costs(cost, RunReport("t"), {"objects": 2.0}) == stage_costs(cost, report, {}) == {}


WHOLE = json.dumps({"videos": 5, "splits": {"train": 287, "val": 69}})
FEWER = [{"videos": 4, "splits": {"train": 287, "val": 69}}, {"videos": 5, "splits": {"train": 287}}]


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    return made.copy(tmp_path)


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    return open_runner(tmp_path / "store", jobs=0)


@pytest.fixture
def whole(runner: Runner, tmp_path: Path) -> Path:
    """A published data set of five videos and two splits."""
    folder = runner.store.root / "datasets" / "set"
    digest = artifact(runner, tmp_path / "whole", **{"statistics.json": WHOLE})
    assert Publisher(runner).folder("dataset_pack", digest, folder) == str(folder)
    return folder


# -- from the command line ---------------------------------------------------------------------------------------------


def test_a_run_of_some_clips_leaves_the_whole_data_set(mine: Made) -> None:
    """The data set is published as partial, with a note; a complete run has no such note."""
    data = mine.store / "datasets" / mine.source.name
    part, before = data.with_name(f"{data.name}-part"), content(data)
    result = mine.run("dataset", "--clip", VIDEOS[0])
    assert result.code == 0 and content(data) == before
    assert result.json["outputs"]["dataset"] == str(part) and json.loads(content(part)["statistics.json"])["videos"] == 1
    assert len(result.json["notes"]) == 1 and result.json["notes"][0] in result.words and "made from" in result.words
    assert (mine.store / "recordings" / mine.source.name / "dataset_pack-part.mcap").exists()
    again = mine.run("dataset").json
    assert again.keys() == KEYS and again["outputs"]["dataset"] == str(data) and content(data) == before


def test_replace_publishes_a_partial_output_as_complete(mine: Made) -> None:
    """Publishing the same again then changes nothing."""
    data = mine.store / "datasets" / mine.source.name
    for more in (["--replace"], []):
        result = mine.run("dataset", "--clip", VIDEOS[0], *more).json
        assert result["outputs"]["dataset"] == str(data) and "notes" not in result
        assert json.loads(content(data)["statistics.json"])["videos"] == 1 and not data.with_name(f"{data.name}-part").exists()


def test_a_run_without_the_clips_that_failed_is_a_part(mine: Made) -> None:
    """Videos that the reader refuses count as well, also without a complete data set."""
    media(mine.source, VIDEOS[0]).write_bytes(b"")
    data = mine.store / "datasets" / mine.source.name
    for name in sorted(path for path in data.rglob("*") if path.is_file()):
        name.unlink()
    result = mine.run("dataset")
    assert result.code == 1 and result.json["outputs"]["dataset"] == f"{data}-part"
    assert "1 of the tasks behind it failed" in result.words


# -- what is a part ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fewer", FEWER, ids=["videos", "splits"])
def test_a_data_set_of_less_stands_beside_the_one_of_more(
    fewer: dict[str, object], runner: Runner, whole: Path, tmp_path: Path,
) -> None:
    """The data set with fewer videos is partial after any run; one of equal size replaces the old one."""
    digest = artifact(runner, tmp_path / "fewer", **{"statistics.json": json.dumps(fewer)})
    to = Publisher(runner)
    assert to.folder("dataset_pack", digest, whole) == f"{whole}-part" and content(whole) == {"statistics.json": WHOLE.encode()}
    assert len(to.notes) == 1 and "--replace" in to.notes[0]
    record = artifact(runner, tmp_path / "mcap", x="x")
    assert to.file("record_dataset_pack", record, whole / "x.mcap") == str(whole / "x-part.mcap")
    assert Publisher(runner, replace=True).folder("dataset_pack", digest, whole) == str(whole)
    back = artifact(runner, tmp_path / "back", **{"statistics.json": WHOLE + "\n"})
    assert Publisher(runner).folder("dataset_pack", back, whole) == str(whole)


@pytest.mark.parametrize("there", ["{", "[]", '{"videos": "many", "splits": 3}'])
def test_an_unreadable_output_is_replaced(there: str, runner: Runner, whole: Path, tmp_path: Path) -> None:
    """Its content is unknown, so no loss is known."""
    (whole / "statistics.json").unlink()
    (whole / "statistics.json").write_text(there)
    digest = artifact(runner, tmp_path / "fewer", **{"statistics.json": json.dumps(FEWER[0])})
    assert Publisher(runner).folder("dataset_pack", digest, whole) == str(whole)


def test_a_table_that_is_not_finished_grows_and_never_shrinks(runner: Runner, tmp_path: Path) -> None:
    """A run with a time limit."""
    reports = runner.store.root / "reports" / "table"
    few, more = (artifact(runner, tmp_path / str(n), **{"metrics.json": json.dumps(dict.fromkeys(map(str, range(n)), 0.5))})
                 for n in (1, 2))  # fmt: skip
    for digest, name in ((few, "table"), (more, "table"), (few, "table-part"), (more, "table")):
        assert Publisher(runner, unfinished=True).folder("sor3d_report", digest, reports) == str(reports.with_name(name))
    assert Publisher(runner).folder("sor3d_report", few, reports) == str(reports)


def test_columns_of_a_comparison_are_partial_together(runner: Runner, tmp_path: Path) -> None:
    """One column failed."""
    folder, stages = tmp_path / "set-compare", ("report_flow", "report_nearest")
    to = Publisher(runner, {"report_nearest": "1 of the tasks behind it failed"})
    assert to.together(stages, folder) == tmp_path / "set-compare-part" and "set-compare-part is partial" in to.notes[0]
    assert Publisher(runner, to.why, replace=True).together(stages, folder) == Publisher(runner).together(stages, folder) == folder


def test_failures_of_other_stages_do_not_make_an_output_partial() -> None:
    """A recording that could not be written removes no sample."""
    g = build("dataset", Origin("some"), Settings())
    for stage, is_part in (("frame_decode", True), ("dataset_pack", True), ("record_frame_decode", False)):
        report = RunReport("some", failures=[Failure(stage, "", "no")], outputs={"dataset_pack": []})
        assert bool(partial_outputs(g, report, (), 0)) is is_part
    report = RunReport("some", outputs={"dataset_pack": []})
    assert partial_outputs(g, report, ("P96_01",), 0) == {"dataset_pack": "made from P96_01 alone"}
