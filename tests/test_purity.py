"""Every stage is a pure function: run again elsewhere, later and under watch, it gives the same bytes and opens nothing else."""

from __future__ import annotations

import importlib
import inspect
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from afford.codecs import CODEC
from afford.dataset.files import tree as files_of
from afford.hands.assets import shadow_files
from afford.training.recipes import recipes
from afford.worker import use_kernel_cache
from maps.interactions import interactions
from maps.settings import Origin, Settings
from pipeline import build
from runner import Graph, Runner, RunReport
from runner.fingerprint import fingerprint
from runner.modules import Modules
from runner.store import Store, prepare_store
from runner.traces import Trace, Traces
from schemas.scene import SceneSpec
from stages import (
    ablation_report,
    action_read,
    dataset_pack,
    grasp_candidates,
    grasp_compare,
    grasp_compare_report,
    grasp_record,
    hand_model,
    hand_retarget,
    interaction_pack,
    interaction_record,
    mask_propose,
    mesh_read,
    mesh_texture,
    model_train,
    motion_read,
    motion_report,
    motion_synthesise,
    object_build,
    object_plan,
    object_solids,
    positive_affordance_projection,
    static_evaluate,
    static_read,
    view_render,
)
from tests import impure_stages, landlock, made_sequences
from tests.command import Made
from tests.impure_stages import CHEATS
from tests.made_hands import PINCER, shadow, written
from tests.made_interactions import iit_aff, umd, utkinect
from tests.made_looks import rod as bar
from tests.made_meshes import as_object, cup
from tests.made_motions import recorded, rod
from tests.made_objects import SMALL
from tests.made_samples import Scratch, clip
from tests.made_school import SCHOOL
from tests.made_sor3d import FEW
from tests.made_traces import episodes, hammer
from tests.mesh_files import box, tree
from tests.purity_probe import blobs
from tests.test_ablation_report import scores
from tests.test_grasp_compare import made_up, subject
from tests.tiny_asked import write_model
from tests.tiny_sor3d import write_model as write_sor3d

ROOT = Path(__file__).resolve().parent.parent
STAGES = sorted(path.stem for path in (ROOT / "stages").glob("[!_]*.py"))
SPEC = SceneSpec("P91_01", "carry", "kitchen", seed=3, frames=3, key_gap=2)
TRAINING = model_train.Params(steps=2, batch=2, warmup=1, validate_every=2, val_samples=2, height_px=32, width_px=64)
OTHER_ENVIRONMENT = {
    "HOME": "/nonexistent", "USER": "somebody", "TZ": "Pacific/Chatham", "LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0",
    "PYTHONCOERCECLOCALE": "0", "PYTHONHASHSEED": "4711", "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "40",
    "OPENBLAS_NUM_THREADS": "3", "SOURCE_DATE_EPOCH": "1", "MPLBACKEND": "svg"}  # fmt: skip
EARLY = {"arrow": ["pandas", "pyarrow.parquet"], "torch": ["torch.utils.data", "torch._dynamo"], "h5py": ["h5py"],
         "mujoco": ["mujoco"]}
"""what loads before the watch begins: built on datetime and its layout in C; asks for a temporary folder (dill, a cache for
compiled code that every optimiser of torch loads); asks `uname` for the kind of processor (h5py);
starts a process to look for a library of windows (mujoco)"""
MACHINE_KIND = ("OPENBLAS_CORETYPE",)
"""which vector units linear algebra is told to use: that is the kind of machine, for which alone bytes are promised"""
ELSEWHERE = {"scene_render": "rendered",
             **dict.fromkeys(("predict_cases", "baseline_cases", "score_cases", "benchmark"), "benchmarked"),
             **dict.fromkeys(("model_train", "training_record", "ablation_report"), "trained"),
             **dict.fromkeys(("view_render", "mask_propose"), "meshes"),
             **dict.fromkeys(("mesh_read", "mesh_texture"), "read_meshes"),
             **dict.fromkeys(("object_plan", "object_build", "object_solids"), "objects"), "hand_model": "hands",
             **dict.fromkeys(("motion_read", "motion_synthesise", "hand_retarget", "motion_report"), "motions"),
             **dict.fromkeys(("part_lessons", "scorer_train", "part_describe", "mask_score", "negative_affordance_projection",
                              "negative_affordance_files", "object_record", "negative_affordance_score",
                              "negative_affordance_report"),
                             "negatives"),
             "grasp_record": "grasps", **dict.fromkeys(("interaction_record", "static_evaluate"), "told"),
             **dict.fromkeys(("interaction_plan", "interaction_render", "interaction_read", "static_read", "action_read"),
                             "interacted"),
             **dict.fromkeys(("scene_flow", "scene_flow_score", "interaction_pack", "action_pack", "sor3d_evaluate",
                              "sor3d_report"), "afforded"),
             **dict.fromkeys(("grasp_candidates", "grasp_compare", "grasp_compare_report", "positive_affordance_projection"),
                             "from_masks"),
             **dict.fromkeys(("grasp_tasks", "grasp_tasks_predicted", "grasp_targets", "hand_imitation", "rl_grasp_refinement",
                              "grasp_student", "grasp_evaluate", "grasp_report", "imitation_evaluate", "grasp_two_tasks",
                              "grasp_judge"), "schooled"),
             **dict.fromkeys(("train_plan", "still_render", "still_sample", "benchmark_plan", "benchmark_set"), "stills")}
"""stages that no target of the tiny source runs, and the fixture whose store holds a run of them"""
OTHER_STYLE = "figure.dpi: 33\nlines.linewidth: 9\nsavefig.facecolor: red\nimage.cmap: gray\n"


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a very short clip was rendered."""
    store = tmp_path_factory.mktemp("rendered")
    use_kernel_cache(ROOT, store)
    graph = build("scenes", Origin("tiny", specs=(SPEC,)), Settings())
    assert Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "scenes").ok
    return store


@pytest.fixture(scope="module")
def stills(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a few small stills were rendered, drawn from and written as a benchmark."""
    store = tmp_path_factory.mktemp("stills")
    use_kernel_cache(ROOT, store)
    few = {"rooms": 1, "layouts": 1, "views": 1, "tasks": 3}
    small = Settings(train_plan=replace(Settings.train_plan, val_rooms=0, **few),
                     benchmark_plan=replace(Settings.benchmark_plan, **few),
                     still_render=replace(Settings.still_render, width_px=228, height_px=128, supersample=1))
    for target in ("train-set", "benchmark-set"):
        graph = build(target, Origin("tiny"), small)
        report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, target)
        assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which an object of every unseen category was built, and cut into hulls."""
    store, graph = tmp_path_factory.mktemp("objects"), Graph()
    use_kernel_cache(ROOT, store)
    few = object_plan.Params(train_per_category=0, val_per_category=0, seen_per_category=0, unseen_per_category=1)
    spec = graph.each(graph.add(object_plan.run, params=few))
    built = graph.add(object_build.run, spec=spec, params=object_build.Params(max_faces=9000, atlas_px=64))
    mesh, parts = graph.pick(built, lambda built: built.mesh), graph.pick(built, lambda built: built.parts)
    solids = graph.add(object_solids.run, mesh=mesh, parts=parts, params=object_solids.Params(hulls=12, points=64))
    graph.target("objects", solids)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "objects")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def benchmarked(compared: tuple[Path, RunReport]) -> Path:
    """A store in which methods were compared."""
    store, report = compared
    assert report.ok, report.failures
    return with_fonts(store)


def with_fonts(store: Path) -> Path:
    """The store, with the list of fonts that matplotlib keeps in it."""
    (store / ".cache" / "matplotlib").mkdir(parents=True, exist_ok=True)
    listing = [sys.executable, "-c", "import matplotlib.font_manager"]
    subprocess.run(listing, env=os.environ | {"MPLCONFIGDIR": str(store / ".cache" / "matplotlib")}, check=True)
    return store


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a model was trained on a few shapes, and an ablation was tabled."""
    store = tmp_path_factory.mktemp("trained")
    clips = (clip("P01_01", 4, split="train"), clip("P01_02", 2, split="val"))
    data = dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(tmp_path_factory.mktemp("packed")))
    table = Graph()
    planned, scored = table.leaf("recipes", recipes(("full",), 1)), table.leaf("scores", (scores("full-0", 0.5),))
    params = ablation_report.Params()
    table.target("table", table.add(ablation_report.run, recipes=planned, scores=scored, params=params, ctx=table.ctx))
    training = build("train", Origin("tiny", dataset=data), Settings(model_train=TRAINING))
    for target, graph in (("train", training), ("table", table)):
        report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, target)
        assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a cup was looked at from all sides and cut into regions and windows."""
    store = tmp_path_factory.mktemp("meshes")
    use_kernel_cache(ROOT, store)
    graph = Graph()
    mesh = graph.leaf("mesh", as_object(cup()))
    looked = graph.add(view_render.run, mesh=mesh, params=view_render.Params(size_px=64))
    masks = [graph.named(backend).add(mask_propose.run, mesh=mesh, views=looked, params=mask_propose.Params(backend))
             for backend in ("regions", "grid")]  # fmt: skip
    graph.target("views", *masks)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "views")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def read_meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a grey box was read from its file, made simpler and textured."""
    store, folder = tmp_path_factory.mktemp("read_meshes"), tmp_path_factory.mktemp("files")
    use_kernel_cache(ROOT, store)
    box(4).export(folder / "box.stl")
    graph = Graph()
    read = graph.add(mesh_read.run, files=graph.leaf("files", tree(folder)), params=mesh_read.Params(max_faces=1500))
    mesh = graph.pick(read, lambda read: read.mesh)
    graph.target("textured", graph.add(mesh_texture.run, mesh=mesh, params=mesh_texture.Params(side_px=128)))
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "textured")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def hands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which the Shadow Hand was built, and a hand of a URDF."""
    store, folder, graph = tmp_path_factory.mktemp("hands"), tmp_path_factory.mktemp("pincer"), Graph()
    for name, files, params in (("shadow", shadow_files(), hand_model.Params()),
                                ("pincer", written(folder, PINCER), hand_model.Params(backend="urdf"))):
        graph.target(name, graph.named(f"hand_{name}").add(hand_model.run, files=graph.leaf(name, files), params=params))
        report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, name)
        assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which two motions were read and two made up, and the Shadow Hand was fitted to them."""
    store, folder, graph = tmp_path_factory.mktemp("motions"), tmp_path_factory.mktemp("recorded"), Graph()
    hand = graph.add(hand_model.run, files=graph.leaf("hand", shadow_files()), params=hand_model.Params())
    clips = {name: graph.named(f"read_{name}").add(motion_read.run, files=graph.leaf(name, files), params=motion_read.Params(name))
             for name, files in recorded(folder).items()}  # fmt: skip
    clips["made"] = graph.add(motion_synthesise.run, target=graph.leaf("rod", rod()), params=motion_synthesise.Params(clips=2))
    for name, found in clips.items():
        clip = graph.each(found)
        any_clip = hand_retarget.Params(min_s=0.0, max_error_m=1.0, max_palm_m_s=100.0, max_joint_rad_s=1e4, max_point_m_s=100.0)
        fitted = graph.named(f"fit_{name}").add(hand_retarget.run, motion=clip, hand=hand, params=any_clip)
        everything = graph.collect(fitted)
        graph.target(name, graph.named(f"report_{name}").add(motion_report.run, clips=everything, params=motion_report.Params()))
        report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, name)
        assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def grasps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which two grasps were recorded."""
    store, graph = tmp_path_factory.mktemp("grasps"), Graph()
    use_kernel_cache(ROOT, store)
    hand, tasks, found = graph.leaf("hand", shadow()), graph.leaf("tasks", (hammer(),)), graph.leaf("found", episodes())
    small = grasp_record.Params(width=64, height=48, supersample=1)
    graph.target("record", graph.add(grasp_record.run, hand=hand, tasks=(tasks,), episodes=found, params=small, ctx=graph.ctx))
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "record")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def schooled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a prior, a teacher and a student have hardly learned anything, on one screwdriver."""
    store = tmp_path_factory.mktemp("schooled")
    use_kernel_cache(ROOT, store)
    graph = build("grasp-full", Origin("tiny"), SCHOOL)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "grasp-full")
    assert report.ok, report.failures
    return with_fonts(store)


@pytest.fixture(scope="module")
def negatives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a scorer was trained on one screwdriver and asked about another."""
    store = tmp_path_factory.mktemp("negatives")
    use_kernel_cache(ROOT, store)
    graph = build("negative-affordance", Origin("tiny"), SMALL)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "negative-affordance")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def from_masks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a rod was grasped in a look, a hammer in MuJoCo, and a tiny model was asked where."""
    store, folder, graph = tmp_path_factory.mktemp("from_masks"), tmp_path_factory.mktemp("tiny"), Graph()
    use_kernel_cache(ROOT, store)
    model = graph.leaf("model", files_of("tiny", write_model(folder / "model")))
    grasps = graph.add(grasp_candidates.run, scene=graph.leaf("look", bar(right=lambda place: place[..., 0] < 0.0)[0]),
                       params=grasp_candidates.Params(places=8))  # fmt: skip
    built, body, told = subject()
    mesh, parts = graph.leaf("mesh", built.mesh), graph.leaf("parts", built.parts)
    said = graph.leaf("told", replace(told, descriptions=told.descriptions[:1]))
    views = graph.add(view_render.run, mesh=mesh, params=view_render.Params(size_px=64, directions=32, share=0.0))
    positive = graph.add(positive_affordance_projection.run, mesh=mesh, views=views, descriptions=said, model=model, ctx=graph.ctx,
                         params=positive_affordance_projection.Params(points=8, mirror=False))  # fmt: skip
    hand = graph.add(hand_model.run, files=graph.leaf("hand", shadow_files()), params=hand_model.Params())
    tried = graph.add(grasp_compare.run, hand=hand, mesh=mesh, parts=parts, body=graph.leaf("body", body), descriptions=said,
                      model=model, params=grasp_compare.Params(("mujoco",), 1, places=8), ctx=graph.ctx)  # fmt: skip
    every = graph.leaf("comparisons", (made_up("a", [1.0, 0.0]), made_up("b", [1.0, 1.0])))
    table = graph.add(grasp_compare_report.run, comparisons=every, params=grasp_compare_report.Params(), ctx=graph.ctx)
    graph.target("from_masks", grasps, positive, tried, table)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "from_masks")
    assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a model of sequences that has learned nothing was asked about every frame of one, and about pictures."""
    store, folder = tmp_path_factory.mktemp("told"), tmp_path_factory.mktemp("sor3d")
    use_kernel_cache(ROOT, store)
    write_sor3d(folder / "model")
    (clip, flow), other = made_sequences.interaction(0, "val"), made_sequences.interaction(1, "val")[0]
    graph = Graph()
    model = graph.leaf("model", files_of("sor3d", folder))
    packed = graph.add(interaction_pack.run, clips=graph.leaf("clips", (clip,)), flows=graph.leaf("flows", (flow,)),
                       params=interaction_pack.Params(licence="cc0-1.0"), ctx=graph.ctx)  # fmt: skip
    recorded = graph.add(interaction_record.run, dataset=packed, model=model, params=interaction_record.Params(),
                         ctx=graph.ctx)  # fmt: skip
    scored = graph.add(static_evaluate.run, samples=graph.leaf("pictures", (clip, other)), model=model,
                       params=static_evaluate.Params(), ctx=graph.ctx)  # fmt: skip
    graph.target("told", recorded, scored)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "told")
    assert report.ok, report.failures
    return with_fonts(store)


@pytest.fixture(scope="module")
def interacted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which a sequence was rendered and read back, and pictures and actions were read from tiny roots."""
    store, folder = tmp_path_factory.mktemp("interacted"), tmp_path_factory.mktemp("roots")
    use_kernel_cache(ROOT, store)
    graph = Graph()
    few = Settings(interaction_plan=replace(Settings.interaction_plan, train=1, val=0),
                   interaction_render=replace(Settings.interaction_render, height_px=64, frames=3, supersample=1))
    interactions(graph, Origin("tiny"), few)
    pictures = [graph.named(f"read_{name}").add(static_read.run, files=graph.leaf(name, made), params=static_read.Params(name, 16))
                for name, made in (("umd", umd(folder / "umd")), ("iit-aff", iit_aff(folder / "iit")))]  # fmt: skip
    actions = graph.add(action_read.run, files=graph.leaf("actions", utkinect(folder / "utkinect")), params=action_read.Params(16))
    graph.target("read", *pictures, actions)
    for target in ("interactions", "read"):
        report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, target)
        assert report.ok, report.failures
    return store


@pytest.fixture(scope="module")
def afforded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which rows of SOR3D-AFF's ablation have hardly learned anything, one of them on an encoder that saw actions."""
    store, folder = tmp_path_factory.mktemp("afforded"), tmp_path_factory.mktemp("actions")
    use_kernel_cache(ROOT, store)
    graph = build("sor3d-ablation", Origin("tiny", actions=utkinect(folder / "utkinect", 8)), FEW)
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.worker:prepare").run(graph, "sor3d-ablation")
    assert report.ok, report.failures
    return with_fonts(store)


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_is_pure(stage: str, made: Made, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """With another working directory, environment, clock, hash seed and random state, and read-only inputs, it gives the
    bytes that it gave before, opens no undeclared file, starts no process, opens no connection and prints nothing."""
    store = request.getfixturevalue(ELSEWHERE[stage]) if stage in ELSEWHERE else made.store
    traces = one_of_each(Traces(store).all(), f"stages.{stage}:run")
    assert traces, f"no run of stages/{stage}.py to repeat: add it to a target of the tiny source"
    answers = replay(list(map(task, traces)), sources(traces), store, tmp_path)
    for trace, answer in zip(traces, answers, strict=True):
        assert not answer["problems"], "\n".join([trace.stage, *answer["problems"]])
        before = blobs(Store(store, CODEC), trace.output)
        other = [name for (name, blob), (_, again) in zip(before, answer["blobs"], strict=False) if blob != again]
        assert answer["output"] == trace.output, f"{trace.stage} of shard {trace.shard!r}: another output, differs in {other}"
        assert answer["blobs"] == before, f"{trace.stage}: the same value in other bytes, {other}"


def one_of_each(traces: Iterable[Trace], function: str) -> list[Trace]:
    """One run of every node of the graph that calls the function."""
    mine = sorted((trace for trace in traces if trace.function == function), key=lambda trace: trace.shard)
    return list({trace.stage: trace for trace in mine}.values())


def test_what_is_impure_is_caught(made: Made, tmp_path: Path) -> None:
    """Every way of cheating gives another output or is seen. (What libraries open by themselves is seen with Landlock only.)"""
    store = Store(tmp_path / "store", CODEC)
    prepare_store(store.root)
    trace = next(trace for trace in Traces(made.store).all() if trace.stage == "key_thin")
    clip = Store(made.store, CODEC).load(trace.inputs["clip"])
    given = {"clip": store.put_leaf(clip)}
    functions = [f"tests.impure_stages:{cheat.__name__}" for cheat in CHEATS]
    tasks = [task(replace(trace, function=function, inputs=given)) | {"params": {}} for function in functions]
    before = [store.put_leaf(cheat(deepcopy(clip), impure_stages.Params())) for cheat in CHEATS]
    answers = replay(tasks, [impure_stages.__file__], store.root, tmp_path)
    unseen = [cheat.__name__ for cheat, answer, output in zip(CHEATS, answers, before, strict=True)
              if not answer["problems"] and answer["output"] == output]
    assert unseen == ([] if landlock.available() else ["file_behind_python"])


def replay(tasks: list[dict[str, Any]], allowed: list[str], store: Path, folder: Path) -> list[dict[str, Any]]:
    """Run tasks again in one fresh process, which may open the files of the project that are `allowed`."""
    work, elsewhere = folder / "work", folder / "elsewhere"
    work.mkdir()
    elsewhere.mkdir()
    (elsewhere / "matplotlibrc").write_text(OTHER_STYLE)
    job = {"root": str(ROOT), "store": str(store), "work": str(work), "sources": allowed, "tasks": tasks,
           "first": [name for word, names in EARLY.items() if any(task[word] for task in tasks) for name in names]}
    (folder / "job.json").write_text(json.dumps(job))
    command = [sys.executable, str(ROOT / "tests" / "purity_probe.py"), str(folder / "job.json")]
    kernels = use_kernel_cache(ROOT, store)
    kernels.mkdir(parents=True, exist_ok=True)
    fonts = store / ".cache" / "matplotlib"
    kind = {name: os.environ[name] for name in MACHINE_KIND if name in os.environ}
    environment = OTHER_ENVIRONMENT | kind | {"NUMBA_CACHE_DIR": str(kernels), "MPLCONFIGDIR": str(fonts)}
    done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    answers: list[dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
    return answers


def task(trace: Trace) -> dict[str, Any]:
    """What the probe must know of a run."""
    module, _, name = trace.function.partition(":")
    wants_ctx = "ctx" in inspect.signature(getattr(importlib.import_module(module), name)).parameters
    return {"function": trace.function, "params": trace.params["fields"], "inputs": trace.inputs, "threads": trace.threads,
            "wants_ctx": wants_ctx, "arrow": "pyarrow" in trace.libraries, "torch": "torch" in trace.libraries,
            "h5py": "h5py" in trace.libraries, "mujoco": "mujoco" in trace.libraries}


def sources(traces: list[Trace]) -> list[str]:
    """The files of the project that the fingerprint of a stage is taken over, and those of the worker's hook."""
    modules = Modules(ROOT)
    found = [fingerprint(modules, trace.function, trace.params["fields"]).files for trace in traces]
    return sorted({*(path for paths in found for path in paths), *fingerprint(modules, "afford.worker:prepare", {}).files})
