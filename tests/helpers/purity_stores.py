"""Stores in which every stage has run on something tiny, for those that no target of the tiny source runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from afford.common.files import tree as files_of
from afford.common.video.frames import write_video
from afford.extraction.landmarks.files import landmark_files
from afford.extraction.sources.discover import discover
from afford.extraction.sources.narrations import default_narration
from afford.grasping.hand.assets import shadow_files
from afford.grasping.judge import prompt
from afford.grasping.motion.skeleton import aperture
from commands.origin import origin
from maps.rgbd import interactions
from maps.settings import Origin, Settings
from maps.twohands import recipes
from pipeline import build
from runner import Graph, Runner
from schemas.scene import SceneSpec
from schemas.video import Clip
from stages.extraction import clip_footage, dataset_pack, hand_detect, hand_landmarks, held_train, source_read
from stages.grasping import (
    grasp_candidates,
    grasp_compare,
    grasp_compare_report,
    grasp_judge,
    hand_model,
    hand_motion,
    hand_retarget,
    keypoint_files,
    motion_files,
    motion_read,
    motion_report,
    motion_synthesise,
    object_solids,
)
from stages.recording import grasp_record, interaction_record, motion_record, positive_record
from stages.rgbd import action_read, boxes_train, interaction_pack, static_evaluate, static_read, static_report
from stages.surface import mask_propose, mesh_read, mesh_texture, positive_affordance_projection, view_render
from stages.synthetic import object_build, object_plan
from stages.twohands import ablation_report, model_train
from tests.grasping.test_grasp_compare import comparison, subject
from tests.helpers import made_sequences
from tests.helpers.blocks import changed
from tests.helpers.fonts import with_fonts
from tests.helpers.made_finder import FINDER, made_up
from tests.helpers.made_hands import PINCER, shadow, written
from tests.helpers.made_interactions import iit_aff, umd, utkinect
from tests.helpers.made_landmarks import MadeHand, made_video, path
from tests.helpers.made_looks import rod as bar
from tests.helpers.made_meshes import as_object, cup
from tests.helpers.made_motions import own_motion, recorded, rod, trajectory
from tests.helpers.made_motions import tree as recorded_files
from tests.helpers.made_objects import SMALL
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.made_school import SCHOOL
from tests.helpers.made_sor3d import FEW
from tests.helpers.made_traces import episodes, hammer
from tests.helpers.mesh_files import box, tree
from tests.helpers.tiny_asked import write_model
from tests.helpers.tiny_models import save_parrot
from tests.helpers.tiny_root import digest
from tests.helpers.tiny_sor3d import write_model as write_sor3d
from tests.helpers.toy_clip import toy
from tests.twohands.test_ablation_report import scores

ROOT = Path(__file__).resolve().parents[2]
SPEC = SceneSpec("P91_01", "carry", "kitchen", seed=3, frames=3, key_gap=2)
TRAINING = model_train.Params(steps=2, batch=2, warmup=1, validate_every=2, val_samples=2, height_px=32, width_px=64)
Maker = Callable[[Path, Path], None]
"""fills a store; the second folder is its own, to keep files in"""


def run(store: Path, target: str, graph: Graph) -> None:
    """Make a target; it must go well."""
    report = Runner(store, ROOT, "afford.codecs:CODEC", "afford.common.worker:prepare", jobs=0).run(graph, target)
    assert report.ok, report.failures


def rendered(store: Path, folder: Path) -> None:
    """A very short clip was rendered."""
    run(store, "scenes", build("scenes", Origin("tiny", specs=(SPEC,)), Settings()))


def stills(store: Path, folder: Path) -> None:
    """A few small stills were rendered, drawn from and written as a benchmark."""
    few = {"rooms": 1, "layouts": 1, "views": 1, "tasks": 3}
    small = Settings.of(train_plan=replace(Settings.synthetic.train_plan, val_rooms=0, **few),
                        shift_plan=replace(Settings.synthetic.shift_plan, rooms=1),
                        benchmark_plan=replace(Settings.synthetic.benchmark_plan, **few),
                        still_render=replace(Settings.synthetic.still_render, width_px=228, height_px=128, supersample=1),
                        object_build=replace(Settings.synthetic.object_build, edge_m=0.02, atlas_px=64),
                        tool_plan=replace(Settings.synthetic.tool_plan, categories=("screwdriver",), per_category=1, val_every=0),
                        tool_render=replace(Settings.synthetic.tool_render, views=1, width_px=228, height_px=128, supersample=1))
    for target in ("train-set", "benchmark-set"):
        run(store, target, build(target, Origin("tiny"), small))


def trained(store: Path, folder: Path) -> None:
    """A model was trained on a few shapes, and an ablation was tabled."""
    clips = (clip("P01_01", 4, split="train"), clip("P01_02", 2, split="val"))
    data = dataset_pack.run(clips, dataset_pack.Params(sheet_samples=1), Scratch(folder))
    run(store, "train", build("train", Origin("tiny", dataset=data), Settings.of(model_train=TRAINING)))
    table = Graph()
    planned, scored = table.leaf("recipes", recipes(("full",), 1)), table.leaf("scores", (scores("full-0", 0.5),))
    params = ablation_report.Params()
    table.target("table", table.add(ablation_report.run, recipes=planned, scores=scored, params=params, ctx=table.ctx))
    run(store, "table", table)


def objects(store: Path, folder: Path) -> None:
    """An object of each of two categories was built, and cut into hulls."""
    graph = Graph()
    few = object_plan.Params(train_per_category=0, val_per_category=0, seen_per_category=0, unseen_per_category=1,
                             categories=("razor", "soldering_iron"))  # fmt: skip
    spec = graph.each(graph.add(object_plan.run, params=few))
    built = graph.add(object_build.run, spec=spec, params=object_build.Params(max_faces=9000, atlas_px=64))
    mesh, parts = graph.pick(built, lambda built: built.mesh), graph.pick(built, lambda built: built.parts)
    solids = graph.add(object_solids.run, mesh=mesh, parts=parts, params=object_solids.Params(hulls=12, points=64))
    graph.target("objects", solids)
    run(store, "objects", graph)


def meshes(store: Path, folder: Path) -> None:
    """A cup was looked at from all sides and cut into regions and windows."""
    graph = Graph()
    mesh = graph.leaf("mesh", as_object(cup()))
    looked = graph.add(view_render.run, mesh=mesh, params=view_render.Params(size_px=64))
    masks = [graph.named(backend).add(mask_propose.run, mesh=mesh, views=looked, params=mask_propose.Params(backend))
             for backend in ("regions", "grid")]  # fmt: skip
    graph.target("views", *masks)
    run(store, "views", graph)


def read_meshes(store: Path, folder: Path) -> None:
    """A grey box was read from its file, made simpler and textured."""
    box(4).export(folder / "box.stl")
    graph = Graph()
    read = graph.add(mesh_read.run, files=graph.leaf("files", tree(folder)), params=mesh_read.Params(max_faces=1500))
    mesh = graph.pick(read, lambda read: read.mesh)
    graph.target("textured", graph.add(mesh_texture.run, mesh=mesh, params=changed(mesh_texture.Params(), side_px=128)))
    run(store, "textured", graph)


def negatives(store: Path, folder: Path) -> None:
    """A scorer was trained on one screwdriver and asked about another."""
    run(store, "negative-affordance", build("negative-affordance", Origin("tiny"), SMALL))


def found(store: Path, folder: Path) -> None:
    """A finder of hands has hardly learned anything, and looked for hands in a video without masks."""
    write_video(folder / "film.mp4", toy(7).frames.rgb, 18)
    place, _ = origin("recordings", folder, FINDER, digest)
    run(store, "recordings", build("recordings", place, FINDER))


def holding(store: Path, folder: Path) -> None:
    """A network of held objects was trained for two steps."""
    networks = landmark_files(digest)
    if networks is not None:
        graph = Graph()
        lessons = tuple(made_up(split, split, 8, (96, 160)) for split in ("train", "val"))
        few = held_train.Params(steps=2, batch=2, size_px=32, warmup=1, validate_every=2, judged=8)
        leaves = {"lessons": graph.leaf("lessons", lessons), "networks": graph.leaf("networks", networks)}
        graph.target("held", graph.add(held_train.run, **leaves, params=few, ctx=graph.ctx))
        run(store, "held", graph)


def filmed(store: Path, folder: Path) -> None:
    """Landmarks were looked for in a video, and motion was taken from drawn hands."""
    graph = Graph()
    networks = landmark_files(digest)
    if networks is not None:
        write_video(folder / "film.mp4", toy(4).frames.rgb, 18)
        source = discover(folder, digest).videos[0]
        (clip,) = source_read.run(source, source_read.Params())
        footage = clip_footage.run(clip, clip_footage.Params())
        leaves = {"media": graph.leaf("media", source), "footage": graph.leaf("footage", footage)}
        graph.target("looked", graph.add(hand_landmarks.run, **leaves, params=hand_landmarks.Params(),
                                         weights=graph.leaf("networks", networks)))  # fmt: skip
        run(store, "looked", graph)
    graph = Graph()
    frames, landmarks = made_video([MadeHand(path((210, 130), (270, 120), 20))])
    plain = Clip("made", "made", "made", "", ("made.mp4",), "video", 10.0, False, 1, 20, (), (default_narration(1, 20),), ())
    seen = hand_detect.run(plain, frames, hand_detect.Params(), landmarks)
    taken = graph.add(hand_motion.run, hands=graph.leaf("hands", seen.hands), clip=graph.leaf("clip", seen.clip),
                      params=hand_motion.Params())  # fmt: skip
    motions, remarks = graph.pick(taken, lambda taken: taken.motions), graph.pick(taken, lambda taken: taken.remarks)
    graph.target("kept", graph.add(keypoint_files.run, motions=motions, remarks=(remarks,),
                                   params=keypoint_files.Params(), ctx=graph.ctx))  # fmt: skip
    run(store, "kept", graph)


def hands(store: Path, folder: Path) -> None:
    """The Shadow Hand was built, and a hand of a URDF."""
    graph = Graph()
    for name, files, params in (("shadow", shadow_files(), hand_model.Params()),
                                ("pincer", written(folder, PINCER), hand_model.Params(backend="urdf"))):
        graph.target(name, graph.named(f"hand_{name}").add(hand_model.run, files=graph.leaf(name, files), params=params))
        run(store, name, graph)


def motions(store: Path, folder: Path) -> None:
    """Two motions were read and two made up, and the Shadow Hand was fitted to them."""
    graph = Graph()
    hand = graph.add(hand_model.run, files=graph.leaf("hand", shadow_files()), params=hand_model.Params())
    clips = {name: graph.named(f"read_{name}").add(motion_read.run, files=graph.leaf(name, files), params=motion_read.Params(name))
             for name, files in recorded(folder).items()}  # fmt: skip
    clips["made"] = graph.add(motion_synthesise.run, target=graph.leaf("rod", rod()), params=motion_synthesise.Params(clips=2))
    any_clip = hand_retarget.Params(min_s=0.0, max_error_m=1.0, max_palm_m_s=100.0, max_joint_rad_s=1e4, max_point_m_s=100.0)
    for name, found in clips.items():
        fitted = graph.named(f"fit_{name}").add(hand_retarget.run, motion=graph.each(found), hand=hand, params=any_clip)
        everything = graph.collect(fitted)
        references = graph.named(f"report_{name}").add(motion_report.run, clips=everything, params=motion_report.Params())
        params = motion_files.Params()
        film = motion_record.Params(f"motion_{name}", clips=1, pictures_hz=2.0, width=64, height=48)
        shown = graph.named(f"record_{name}").add(motion_record.run, hand=hand, motions=graph.collect(graph.each(found)),
                                                  clips=everything, params=film, ctx=graph.ctx)  # fmt: skip
        files = graph.named(f"files_{name}").add(motion_files.run, references=references, params=params, ctx=graph.ctx)
        graph.target(name, shown, files)
        run(store, name, graph)


def schooled(store: Path, folder: Path) -> None:
    """A prior, a teacher and a student have hardly learned anything, on one screwdriver."""
    run(store, "grasp-full", build("grasp-full", Origin("tiny"), SCHOOL))


def recorded_prior(store: Path, folder: Path) -> None:
    """A prior has hardly learned anything, from made clips and one recording."""
    p = SCHOOL.with_stages(clip_proof=replace(SCHOOL.grasping.clip_proof, proofs=0))
    motion = own_motion(shadow(), trajectory(shadow(), 40, seed=1))
    points = motion.keypoints_m
    points = points * (0.045 / float(aperture(points[-1:])[0]))  # as open as a tool is thick
    phase = np.repeat(["reach", "close", "hold"], [len(points) - 11, 10, 1])
    np.savez(folder / "own.npz", keypoints=points, fps=60.0, hand="right", unit="m", phase=phase)
    run(store, "grasp-prior", build("grasp-prior", Origin("motion", motions=recorded_files(folder / "own.npz")), p))


def grasped_meshes(store: Path, folder: Path) -> None:
    """A teacher that has hardly learned anything was tried on a box, and hardly adapted to it."""
    p = SCHOOL.with_stages(
        body_evaluate=replace(SCHOOL.grasping.body_evaluate, episodes=1, at_once=1, iterations=20),
        body_choose=replace(SCHOOL.grasping.body_choose, options=2, finalists=1, episodes=1, engines=("mujoco",), iterations=20),
        body_adapt=replace(SCHOOL.grasping.body_adapt, worlds=2, bullet=0, generations=1, rounds=1, updates=2, iterations=20),
        body_report=replace(SCHOOL.grasping.body_report, engines=("mujoco",), policies=("teacher",)),
        mesh_texture=replace(SCHOOL.surface.mesh_texture, procedural=replace(SCHOOL.surface.mesh_texture.procedural, side_px=64)))
    at = folder / "stick"
    at.mkdir()
    trimesh.creation.box((0.2, 0.025, 0.02)).export(at / "stick.obj")
    run(store, "grasp-adapt", build("grasp-adapt", Origin("stick-adapted", meshes=(tree(at),)), p))


def household(store: Path, folder: Path) -> None:
    """A teacher that has hardly learned anything was tried on a can."""
    p = SCHOOL.with_stages(
        body_evaluate=replace(SCHOOL.grasping.body_evaluate, episodes=1, at_once=1, iterations=20),
        body_report=replace(SCHOOL.grasping.body_report, engines=("mujoco",)),
        household_plan=replace(SCHOOL.synthetic.household_plan, categories=("can",), per_category=1, train_per_category=1),
        body_refinement=replace(SCHOOL.grasping.body_refinement, updates=1, epochs=1, iterations=20, family_worlds=0),
        household_build=replace(SCHOOL.synthetic.household_build, edge_m=0.02),
        household_tasks=replace(SCHOOL.grasping.household_tasks, uses=1, poses=("upright",), points=300, hulls=4),
        household_shown=replace(SCHOOL.grasping.household_shown, shown=1))  # fmt: skip
    run(store, "grasp-household", build("grasp-household", Origin("tiny"), p))


def taught(store: Path, folder: Path) -> None:
    """A store in which all about grasping was learned and tried, so that what several of its makers need is made once."""
    for fill in (schooled, recorded_prior, grasped_meshes, household):
        fill(store, folder)
    with_fonts(store)


def grasps(store: Path, folder: Path) -> None:
    """Two grasps were recorded."""
    graph = Graph()
    hand, tasks, found = graph.leaf("hand", shadow()), graph.leaf("tasks", (hammer(),)), graph.leaf("found", episodes())
    small = grasp_record.Params(width=64, height=48, supersample=1)
    graph.target("record", graph.add(grasp_record.run, hand=hand, tasks=(tasks,), episodes=found, params=small, ctx=graph.ctx))
    run(store, "record", graph)


def judged(store: Path, folder: Path) -> None:
    """Two grasps were shown to a tiny model."""
    graph, model = Graph(), save_parrot(folder / "parrot", prompt(2), '{"score": 7}')
    params = changed(grasp_judge.Params(frames=2, width=64, height=48), model=str(model), new_tokens=16)
    hand, tasks, found = graph.leaf("hand", shadow()), graph.leaf("tasks", (hammer(),)), graph.leaf("found", episodes())
    graph.target("judged", graph.add(grasp_judge.run, hand=hand, tasks=(tasks,), episodes=found, params=params))
    run(store, "judged", graph)


def from_masks(store: Path, folder: Path) -> None:
    """A rod was grasped in a look, a hammer in MuJoCo, and a tiny model was asked where."""
    graph = Graph()
    model = graph.leaf("model", files_of("tiny", write_model(folder / "model")))
    grasps = graph.add(grasp_candidates.run, scene=graph.leaf("look", bar(right=lambda place: place[..., 0] < 0.0)[0]),
                       params=grasp_candidates.Params(places=8))  # fmt: skip
    built, body, descriptions = subject()
    mesh, parts = graph.leaf("mesh", built.mesh), graph.leaf("parts", built.parts)
    first = graph.leaf("first", replace(descriptions, descriptions=descriptions.descriptions[:1]))
    views = graph.add(view_render.run, mesh=mesh, params=view_render.Params(size_px=64, directions=32, share=0.0))
    positive = graph.add(positive_affordance_projection.run, mesh=mesh, views=views, descriptions=first, model=model, ctx=graph.ctx,
                         params=positive_affordance_projection.Params(points=8, mirror=False))  # fmt: skip
    seen = graph.add(positive_record.run, views=views, found=positive, params=positive_record.Params(), ctx=graph.ctx)
    hand = graph.add(hand_model.run, files=graph.leaf("hand", shadow_files()), params=hand_model.Params())
    tried = graph.add(grasp_compare.run, hand=hand, mesh=mesh, parts=parts, body=graph.leaf("body", body), descriptions=first,
                      model=model, params=grasp_compare.Params(("mujoco",), 1, places=8), ctx=graph.ctx)  # fmt: skip
    every = graph.leaf("comparisons", (comparison("a", [1.0, 0.0]), comparison("b", [1.0, 1.0])))
    table = graph.add(grasp_compare_report.run, comparisons=every, params=grasp_compare_report.Params(), ctx=graph.ctx)
    graph.target("from_masks", grasps, seen, tried, table)
    run(store, "from_masks", graph)


def interacted(store: Path, folder: Path) -> None:
    """A sequence was rendered and read back, and pictures and actions were read from tiny roots."""
    graph = Graph()
    few = Settings.of(interaction_plan=replace(Settings.synthetic.interaction_plan, train=1, val=0),
                      interaction_render=replace(Settings.synthetic.interaction_render, height_px=64, frames=3, supersample=1))
    interactions(graph, Origin("tiny"), few)
    pictures = [graph.named(f"read_{name}").add(static_read.run, files=graph.leaf(name, made), params=static_read.Params(name, 16))
                for name, made in (("umd", umd(folder / "umd")), ("iit-aff", iit_aff(folder / "iit")))]  # fmt: skip
    actions = graph.add(action_read.run, files=graph.leaf("actions", utkinect(folder / "utkinect")), params=action_read.Params(16))
    graph.target("read", *pictures, actions)
    for target in ("interactions", "read"):
        run(store, target, graph)


def afforded(store: Path, folder: Path) -> None:
    """Rows of SOR3D-AFF's ablation have hardly learned anything, one of them on an encoder that saw actions."""
    place = Origin("tiny", actions=utkinect(folder / "utkinect", 8))
    run(store, "sor3d-ablation", build("sor3d-ablation", place, FEW))
    with_fonts(store)


def sequences(store: Path, folder: Path) -> None:
    """A model of sequences that has learned nothing was asked about every frame of one, and about pictures."""
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
    table = graph.add(static_report.run, reports=(scored,), params=static_report.Params(), ctx=graph.ctx)
    graph.target("sequences", recorded, table)
    run(store, "sequences", graph)
    with_fonts(store)


def boxed(store: Path, folder: Path) -> None:
    """A detector of single pictures has hardly learned anything."""
    graph = Graph()
    clips, flows = zip(*(made_sequences.interaction(n, split) for n, split in enumerate(("train", "train", "val"))), strict=True)
    packed = graph.add(interaction_pack.run, clips=graph.leaf("clips", clips), flows=graph.leaf("flows", flows),
                       params=interaction_pack.Params(licence="cc0-1.0"), ctx=graph.ctx)  # fmt: skip
    few = boxes_train.Params(steps=2, warmup=1, validate_every=2, batch=2, height_px=made_sequences.SIZE, val_samples=1)
    graph.target("boxed", graph.add(boxes_train.run, dataset=packed, params=few, ctx=graph.ctx))
    run(store, "boxed", graph)


MAKERS: dict[Maker, tuple[str, ...]] = {
    rendered: ("scene_render",),
    stills: ("train_plan", "shift_plan", "still_render", "still_sample", "tool_plan", "tool_render", "benchmark_plan",
             "benchmark_set"),
    trained: ("model_train", "training_record", "ablation_report"),
    objects: ("object_plan", "object_build", "object_solids"),
    meshes: ("view_render", "mask_propose"),
    read_meshes: ("mesh_read", "mesh_texture"),
    negatives: ("part_lessons", "scorer_train", "part_describe", "mask_score", "negative_affordance_projection",
                "negative_affordance_files", "object_record", "scorer_record", "negative_affordance_score",
                "negative_affordance_report"),
    holding: ("held_train",),
    found: ("hand_plan", "hand_lessons", "hands_train", "hand_detect"),
    filmed: ("hand_landmarks", "hand_motion", "keypoint_files"),
    hands: ("hand_model",),
    motions: ("motion_read", "motion_synthesise", "hand_retarget", "motion_report", "motion_files", "motion_record"),
    taught: ("grasp_tasks", "grasp_tasks_predicted", "grasp_targets", "hand_imitation", "rl_grasp_refinement", "grasp_student",
             "grasp_evaluate", "grasp_report", "imitation_evaluate", "grasp_two_tasks", "policy_record",
             "recordings_read", "human_motion", "clip_proof", "prior_report",
             "part_segment", "body_tasks", "body_list", "body_evaluate", "body_episodes", "body_report", "body_adapt",
             "body_choose",
             "body_refinement",
             "household_plan", "household_build", "household_tasks", "household_shown", "household_report"),
    judged: ("grasp_judge",),
    grasps: ("grasp_record",),
    from_masks: ("grasp_candidates", "grasp_compare", "grasp_compare_report", "positive_affordance_projection",
                 "positive_record"),
    interacted: ("interaction_plan", "interaction_render", "interaction_read", "static_read", "action_read"),
    afforded: ("scene_flow", "scene_flow_score", "interaction_pack", "action_pack", "sor3d_pretrain", "sor3d_train",
               "sor3d_evaluate", "sor3d_report"),
    boxed: ("boxes_train",),
    sequences: ("interaction_record", "static_evaluate", "static_report"),
}  # fmt: skip
"""what fills a store, and the stages of which it holds a run"""
ELSEWHERE = {stage: maker for maker, stages in MAKERS.items() for stage in stages}
