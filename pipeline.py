"""The map of afford: from video to a two-hand affordance data set, one line per stage.

Every line of `extract` adds one stage to the graph: a pure function of typed inputs and `Params`, cached under the digest of
its code, its parameters and the content of its inputs. Run `python pipeline.py --help` for the verbs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from afford.backends.describe.looks import PARTS
from afford.training.recipes import recipes
from runner import Graph
from schemas.affordance import Affordances, FrameLabels
from schemas.benchmark import MethodScores
from schemas.clip import Clip
from schemas.files import FileTree
from schemas.masks import CompleteObjects, Tracks
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec, ObjectViews
from schemas.negative import PartCandidates
from schemas.sample import Samples
from schemas.scene import RenderedClip, SceneSpec
from schemas.training import Recipe, Trained
from schemas.video import Frames, Inpainted
from stages import (
    ablation_report,
    affordance_intersect,
    baseline_cases,
    benchmark,
    benchmark_plan,
    benchmark_set,
    clip_footage,
    clip_record,
    dataset_pack,
    extraction_report,
    extraction_score,
    frame_decode,
    hand_inpaint,
    key_thin,
    mask_densify,
    mask_propose,
    mask_score,
    mesh_read,
    mesh_texture,
    model_train,
    narration_labelling,
    negative_affordance_files,
    negative_affordance_projection,
    negative_affordance_report,
    negative_affordance_score,
    object_build,
    object_completion,
    object_plan,
    object_record,
    part_describe,
    part_lessons,
    predict_cases,
    run_record,
    sample_assemble,
    scene_render,
    score_cases,
    scorer_train,
    source_read,
    stage_record,
    still_render,
    still_sample,
    train_plan,
    training_record,
    view_render,
)


@dataclass(frozen=True)
class Settings:
    """The parameters of every stage, by stage."""

    scene_render: scene_render.Params = scene_render.Params()
    source_read: source_read.Params = source_read.Params()
    frame_decode: frame_decode.Params = frame_decode.Params()
    mask_densify: mask_densify.Params = mask_densify.Params()
    hand_inpaint: hand_inpaint.Params = hand_inpaint.Params()
    object_completion: object_completion.Params = object_completion.Params()
    affordance_intersect: affordance_intersect.Params = affordance_intersect.Params()
    narration_labelling: narration_labelling.Params = narration_labelling.Params()
    sample_assemble: sample_assemble.Params = sample_assemble.Params()
    dataset_pack: dataset_pack.Params = dataset_pack.Params()
    key_thin: key_thin.Params = key_thin.Params()
    extraction_score: extraction_score.Params = extraction_score.Params()
    extraction_report: extraction_report.Params = extraction_report.Params()
    train_plan: train_plan.Params = train_plan.Params()
    still_render: still_render.Params = still_render.Params()
    still_sample: still_sample.Params = still_sample.Params()
    benchmark_plan: benchmark_plan.Params = benchmark_plan.Params()
    benchmark_set: benchmark_set.Params = benchmark_set.Params()
    model_train: model_train.Params = model_train.Params()
    predict_cases: predict_cases.Params = predict_cases.Params()
    baseline_cases: baseline_cases.Params = baseline_cases.Params()
    score_cases: score_cases.Params = score_cases.Params()
    benchmark: benchmark.Params = benchmark.Params()
    ablation_report: ablation_report.Params = ablation_report.Params()
    object_plan: object_plan.Params = object_plan.Params()
    object_build: object_build.Params = object_build.Params()
    mesh_read: mesh_read.Params = mesh_read.Params()
    mesh_texture: mesh_texture.Params = mesh_texture.Params()
    view_render: view_render.Params = view_render.Params()
    mask_propose: mask_propose.Params = mask_propose.Params()
    part_lessons: part_lessons.Params = part_lessons.Params()
    scorer_train: scorer_train.Params = scorer_train.Params()
    part_describe: part_describe.Params = part_describe.Params()
    mask_score: mask_score.Params = mask_score.Params()
    negative_affordance_projection: negative_affordance_projection.Params = negative_affordance_projection.Params()
    negative_affordance_score: negative_affordance_score.Params = negative_affordance_score.Params()
    negative_affordance_report: negative_affordance_report.Params = negative_affordance_report.Params()


class Origin(NamedTuple):
    """Where the videos come from: clips to render, or what is on disk (`truth` is an empty tree where there is none)."""

    name: str
    specs: tuple[SceneSpec, ...] = ()
    videos: tuple[RenderedClip, ...] = ()
    cases: FileTree | None = None
    predictions: tuple[FileTree, ...] = ()
    dataset: FileTree | None = None
    meshes: tuple[FileTree, ...] = ()


class Extracted(NamedTuple):
    """Handles of what the extraction stages make of one clip."""

    clip: Clip
    frames: Frames
    tracks: Tracks
    inpainted: Inpainted
    complete: CompleteObjects
    affordances: Affordances
    labels: FrameLabels

    def recorded(self) -> dict[str, stage_record.Recorded]:
        """What a recording shows, by stage."""
        return {
            "source_read": self.clip, "frame_decode": self.frames, "mask_densify": self.tracks,
            "hand_inpaint": self.inpainted, "object_completion": self.complete, "affordance_intersect": self.affordances,
            "narration_labelling": self.labels,
        }  # fmt: skip


def extract(g: Graph, video: RenderedClip, p: Settings) -> Extracted:
    """Video, sparse masks and narrations -> hands, objects and affordances on every frame."""
    files       = g.pick(video, lambda v: v.files)
    media       = g.pick(video, lambda v: v.media)
    clip        = g.each(g.add(source_read.run,     files=files,                                     params=p.source_read))
    footage     = g.add(clip_footage.run,           clip=clip,                                       params=clip_footage.Params())
    frames      = g.add(frame_decode.run,           media=media,     footage=footage,                params=p.frame_decode)
    tracks      = g.add(mask_densify.run,           clip=clip,       frames=frames,                  params=p.mask_densify)
    inpainted   = g.add(hand_inpaint.run,           frames=frames,   tracks=tracks,                  params=p.hand_inpaint)
    complete    = g.add(object_completion.run,      frames=frames,   tracks=tracks, inpainted=inpainted, params=p.object_completion)
    affordances = g.add(affordance_intersect.run,   tracks=tracks,   complete=complete,              params=p.affordance_intersect)
    labels      = g.add(narration_labelling.run,    clip=clip,       frames=frames,                  params=p.narration_labelling)
    return Extracted(clip, frames, tracks, inpainted, complete, affordances, labels)


def assemble(g: Graph, x: Extracted, p: Settings) -> Samples:
    """What was extracted from one clip -> its samples."""
    return g.add(sample_assemble.run, clip=x.clip, frames=x.frames, inpainted=x.inpainted, tracks=x.tracks,
                 complete=x.complete, affordances=x.affordances, labels=x.labels, params=p.sample_assemble)


def pack(g: Graph, samples: Samples, origin: Origin, p: Settings) -> FileTree:
    """The samples of all clips -> one data set."""
    return g.add(dataset_pack.run, samples=g.collect(samples), params=licensed(p.dataset_pack, origin), ctx=g.ctx)


def licensed(params: dataset_pack.Params, origin: Origin) -> dataset_pack.Params:
    """Clips that are rendered here are ours to license; of others the stage knows, or the user says."""
    return replace(params, license="apache-2.0") if origin.specs and not params.license else params


def score(g: Graph, video: RenderedClip, p: Settings) -> FileTree:
    """Clips with ground truth -> the quality report, with key frames as given (gap 15) and every second one (gap 30)."""
    x = extract(g, video, p)
    truth = g.pick(video, lambda v: v.truth)
    thin   = g.add(key_thin.run,     clip=x.clip,                                                    params=p.key_thin)
    sparse = g.named("mask_densify_gap30").add(mask_densify.run, clip=thin, frames=x.frames,         params=p.mask_densify)
    scores = g.add(extraction_score.run, truth=truth, clip=x.clip, frames=x.frames, tracks=x.tracks, tracks_sparse=sparse,
                   inpainted=x.inpainted, complete=x.complete, affordances=x.affordances, params=p.extraction_score)
    return g.add(extraction_report.run, scores=g.collect(scores), params=p.extraction_report, ctx=g.ctx)


def record(g: Graph, x: Extracted, samples: Samples) -> FileTree:
    """Every stage of a clip -> its own recording, then one recording of the clip that a viewer opens."""
    parts = tuple(
        g.named(f"record_{stage}").add(stage_record.run, value=value, frames=x.frames, params=stage_record.Params(stage), ctx=g.ctx)
        for stage, value in (*x.recorded().items(), ("sample_assemble", samples))
    )
    return g.add(clip_record.run, clip=x.clip, parts=parts, params=clip_record.Params(), ctx=g.ctx)


def record_run(g: Graph, stage: str, files: FileTree) -> FileTree:
    """What a run over all clips wrote for people -> its recording."""
    return g.named(f"record_{stage}").add(run_record.run, files=files, params=run_record.Params(stage), ctx=g.ctx)


def videos(g: Graph, origin: Origin, p: Settings) -> RenderedClip:
    """Every video with its files and its ground truth."""
    if origin.specs:
        return g.add(scene_render.run, spec=g.each(g.leaf("specs", origin.specs)), params=p.scene_render, ctx=g.ctx)
    return g.each(g.leaf("videos", origin.videos))


def dataset(g: Graph, origin: Origin, p: Settings) -> None:
    """the data set of a source, with a recording of every clip"""
    x = extract(g, videos(g, origin, p), p)
    samples = assemble(g, x, p)
    packed = pack(g, samples, origin, p)
    g.target("dataset", packed, record(g, x, samples), record_run(g, "dataset_pack", packed))


def recordings(g: Graph, origin: Origin, p: Settings) -> None:
    """a recording of every clip of a source"""
    x = extract(g, videos(g, origin, p), p)
    g.target("recordings", record(g, x, assemble(g, x, p)))


def scenes(g: Graph, origin: Origin, p: Settings) -> None:
    """rendered clips, as EPIC-format files with ground truth"""
    g.target("scenes", videos(g, origin, p))


def extraction_quality(g: Graph, origin: Origin, p: Settings) -> None:
    """scores of every extraction stage against ground truth"""
    report = score(g, videos(g, origin, p), p)
    g.target("extraction-report", report, record_run(g, "extraction_report", report))


def stills_to_train(g: Graph, p: Settings) -> FileTree:
    """Rendered stills -> the data set that models are trained on."""
    spec    = g.each(g.add(train_plan.run,                                                           params=p.train_plan))
    stills  = g.add(still_render.run,       spec=spec,       params=p.still_render, ctx=g.ctx)
    samples = g.add(still_sample.run,       stills=stills,                                           params=p.still_sample)
    params  = replace(p.dataset_pack, name="afford-stills", license="apache-2.0", made="rendered")
    return g.named("train_pack").add(dataset_pack.run, samples=g.collect(samples), params=params, ctx=g.ctx)


def stills_to_measure(g: Graph, p: Settings) -> FileTree:
    """Rendered stills of things and rooms that training never sees -> the synthetic benchmark, masks at 855 px width."""
    spec    = g.each(g.add(benchmark_plan.run,                                                       params=p.benchmark_plan))
    params  = replace(p.still_render, mask_scale=855 / p.still_render.width_px)
    stills  = g.named("benchmark_render").add(still_render.run, spec=spec, params=params, ctx=g.ctx)
    return g.add(benchmark_set.run,         stills=g.collect(stills),                 params=p.benchmark_set, ctx=g.ctx)


def lessons(g: Graph, origin: Origin, p: Settings) -> FileTree:
    """What a model learns from: the data set or the videos that the user gives, else rendered stills."""
    if origin.dataset:
        return g.leaf("dataset", origin.dataset)
    return mined(g, origin, p) if origin.videos else stills_to_train(g, p)


def mined(g: Graph, origin: Origin, p: Settings) -> FileTree:
    """Videos -> a data set whose labels the extraction took from them."""
    return pack(g, assemble(g, extract(g, videos(g, origin, p), p), p), origin, p)


def learn(g: Graph, dataset: FileTree, p: Settings) -> Trained:
    """A data set -> a trained two-hand model, with its curves."""
    return g.add(model_train.run,           dataset=dataset,                          params=p.model_train, ctx=g.ctx)


def ask(g: Graph, cases: FileTree, model: FileTree, p: Settings) -> dict[str, FileTree]:
    """What a trained model says of the cases, told the task, the task of another case, or none."""
    mine = p.predict_cases
    texts = (mine, replace(mine, name=f"{mine.name}_text_shuffled", text="shuffled"),
             replace(mine, name=f"{mine.name}_text_removed", text="removed"))
    return {told.name: g.named(f"predict_{told.text}").add(predict_cases.run, cases=cases, model=model, params=told, ctx=g.ctx)
            for told in texts}  # fmt: skip


def rule(g: Graph, cases: FileTree, dataset: FileTree, extracted: FileTree | None, p: Settings) -> dict[str, FileTree]:
    """What the baselines say of the cases; `extracted` is a data set of the benchmark's own videos, where there is one."""
    none = g.leaf("no_dataset", FileTree("none", ()))
    seen = {"whole_object": none, "object_box": none, "centre": none, "class_mean": dataset}
    seen |= {"extraction": g.leaf("extracted", extracted)} if extracted else {}
    return {name: g.named(f"baseline_{name}").add(baseline_cases.run, cases=cases, dataset=data, ctx=g.ctx,
                                                  params=replace(p.baseline_cases, backend=name))
            for name, data in seen.items()}  # fmt: skip


def compare(g: Graph, cases: FileTree, dataset: FileTree, model: FileTree, origin: Origin, p: Settings) -> FileTree:
    """A trained model, the baselines and the predictions of others on the same cases -> the report."""
    extracted = next((tree for tree in origin.predictions if tree.find("manifest.json")), None)
    masks = g.leaf("predictions", tuple(tree for tree in origin.predictions if tree is not extracted))
    said = ask(g, cases, model, p) | rule(g, cases, dataset, extracted, p)
    scores = [g.named(f"score_{name}").add(score_cases.run, cases=cases, predictions=tree, params=p.score_cases)
              for name, tree in said.items()]  # fmt: skip
    swapped = g.named("score_swapped").add(score_cases.run, cases=cases, predictions=said[p.predict_cases.name],
                                           params=replace(p.score_cases, swap=True))  # fmt: skip
    others = g.named("score_others").add(score_cases.run, cases=cases, predictions=g.each(masks), params=p.score_cases)
    return g.add(benchmark.run, scores=(*scores, swapped), others=g.collect(others),
                 params=replace(p.benchmark, predictions=()), ctx=g.ctx)  # fmt: skip


def train_set(g: Graph, origin: Origin, p: Settings) -> None:
    """rendered stills with exact labels, packed for training"""
    g.target("train-set", stills_to_train(g, p))


def benchmark_stills(g: Graph, origin: Origin, p: Settings) -> None:
    """rendered stills of held-out things and rooms, in ActAffordance's folders"""
    g.target("benchmark-set", stills_to_measure(g, p))


def train(g: Graph, origin: Origin, p: Settings) -> None:
    """a two-hand affordance model, from rendered stills or from --source: a data set, or videos"""
    trained = learn(g, lessons(g, origin, p), p)
    files, log = g.pick(trained, lambda t: t.files), g.pick(trained, lambda t: t.log)
    params = training_record.Params()
    g.target("train", files, g.named("record_model_train").add(training_record.run, log=log, files=files, params=params, ctx=g.ctx))


def measure(g: Graph, origin: Origin, p: Settings) -> None:
    """the trained model, baselines and predictions of others on held-out stills, or on the cases of --source"""
    dataset = stills_to_train(g, p)
    cases   = g.leaf("cases", origin.cases) if origin.cases else stills_to_measure(g, p)
    model   = g.pick(learn(g, dataset, p), lambda t: t.files)
    report  = compare(g, cases, dataset, model, origin, p)
    g.target("benchmark", report, record_run(g, "benchmark", report))


def ablate(g: Graph, origin: Origin, p: Settings) -> None:
    """what each part of the model is worth: rows of trainings over several seeds, on held-out stills"""
    planned = recipes(p.ablation_report.rows, p.ablation_report.seeds)
    cases   = stills_to_measure(g, p)
    by_data = {name: tuple(recipe for recipe in planned if recipe.data == name) for name in ("stills", "extracted")}
    learned = {"stills": stills_to_train, "extracted": lambda g, p: mined(g, origin, p)}
    scores  = [retrain(g, cases, learned[name](g, p), mine, p) for name, mine in by_data.items() if mine]
    others  = {"others": scores[1]} if scores[1:] else {}
    report  = g.add(ablation_report.run, recipes=g.leaf("planned", planned), scores=scores[0], params=p.ablation_report, ctx=g.ctx,
                    **others)
    g.target("ablation", report, record_run(g, "ablation_report", report))


def retrain(g: Graph, cases: FileTree, dataset: FileTree, planned: tuple[Recipe, ...], p: Settings) -> tuple[MethodScores, ...]:
    """Every recipe trained on one data set, asked about the cases and scored."""
    of      = "" if planned[0].data == "stills" else f"{planned[0].data}_"
    steps   = p.ablation_report.steps or p.model_train.steps
    recipe  = g.each(g.leaf(f"{of}recipes", planned))
    trained = g.named(f"{of}model_train").add(model_train.run, dataset=dataset, recipe=recipe, ctx=g.ctx,
                                              params=replace(p.model_train, steps=steps))
    said    = g.named(f"{of}predict_cases").add(predict_cases.run, cases=cases, model=g.pick(trained, lambda t: t.files),
                                                params=replace(p.predict_cases, name=""), ctx=g.ctx)
    scores  = g.named(f"{of}score_cases").add(score_cases.run, cases=cases, predictions=said, params=p.score_cases)
    return g.collect(scores)


class Looked(NamedTuple):
    """Handles of an object that was looked at from all sides."""

    mesh: ObjectMesh
    parts: MeshParts
    views: ObjectViews
    candidates: PartCandidates


def look(g: Graph, of: str, plan: object_plan.Params, seen: view_render.Params, p: Settings) -> tuple[ObjectSpec, Looked]:
    """Procedural objects of some splits -> their views and candidates."""
    spec    = g.each(g.named(f"{of}_plan").add(object_plan.run,                                      params=plan))
    built   = g.named(f"{of}_build").add(object_build.run, spec=spec,                                params=p.object_build)
    mesh, parts = g.pick(built, lambda b: b.mesh), g.pick(built, lambda b: b.parts)
    views   = g.named(f"{of}_views").add(view_render.run,  mesh=mesh,                                params=seen)
    masks   = g.named(f"{of}_masks").add(mask_propose.run, mesh=mesh, views=views,                   params=p.mask_propose)
    return spec, Looked(mesh, parts, views, masks)


def given(g: Graph, origin: Origin, p: Settings) -> Looked:
    """The user's meshes -> their views and candidates; their parts where label files name them."""
    files   = g.each(g.leaf("meshes", origin.meshes))
    read    = g.add(mesh_read.run,          files=files,                   params=replace(p.mesh_read, categories=tuple(PARTS)))
    mesh    = g.add(mesh_texture.run,       mesh=g.pick(read, lambda r: r.mesh),                     params=p.mesh_texture)
    views   = g.named("object_views").add(view_render.run,  mesh=mesh,                               params=p.view_render)
    masks   = g.named("object_masks").add(mask_propose.run, mesh=mesh, views=views,                  params=p.mask_propose)
    return Looked(mesh, g.pick(read, lambda r: r.parts), views, masks)


def teach(g: Graph, p: Settings) -> FileTree:
    """Objects of the trained categories -> a scorer of parts."""
    spec, x = look(g, "lesson", replace(p.object_plan, splits=("train", "val")),
                   replace(p.view_render, size_px=256, most=10, directions=128), p)
    lessons = g.add(part_lessons.run,       spec=spec, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates,
                    params=p.part_lessons)
    trained = g.add(scorer_train.run,       lessons=g.collect(lessons),               params=p.scorer_train, ctx=g.ctx)
    return g.pick(trained, lambda t: t.files)


def negative_affordance(g: Graph, origin: Origin, p: Settings) -> None:
    """where a hand must not go on objects, or on the meshes of --source, for their tasks, scored where their parts are known"""
    scorer  = teach(g, p)
    known: dict[str, ObjectSpec] = {}
    if origin.meshes:
        x = given(g, origin, p)
    else:
        known["spec"], x = look(g, "object", replace(p.object_plan, splits=("seen", "unseen")), p.view_render, p)
    told    = g.add(part_describe.run,      mesh=x.mesh, views=x.views,                              params=p.part_describe)
    fit     = g.add(mask_score.run,         mesh=x.mesh, views=x.views, candidates=x.candidates, descriptions=told, scorer=scorer,
                    params=p.mask_score)
    found   = g.add(negative_affordance_projection.run, mesh=x.mesh, views=x.views, candidates=x.candidates, descriptions=told,
                    scores=fit, params=p.negative_affordance_projection)
    windows = g.named("object_windows").add(mask_propose.run, mesh=x.mesh, views=x.views,
                                            params=replace(p.mask_propose, backend="grid"))
    fits    = g.named("window_score").add(mask_score.run, mesh=x.mesh, views=x.views, candidates=windows, descriptions=told,
                                          scorer=scorer, params=p.mask_score)
    scores  = g.add(negative_affordance_score.run, mesh=x.mesh, parts=x.parts, views=x.views, candidates=x.candidates,
                    descriptions=told, scores=fit, windows=windows, window_scores=fits, found=found, **known,
                    params=replace(p.negative_affordance_score, threshold=p.negative_affordance_projection.threshold))
    files   = g.add(negative_affordance_files.run, mesh=x.mesh, descriptions=told, found=found, ctx=g.ctx,
                    params=negative_affordance_files.Params())
    record  = g.add(object_record.run,      views=x.views, candidates=x.candidates, descriptions=told, scores=fit, found=found,
                    params=object_record.Params(), ctx=g.ctx)
    report  = g.add(negative_affordance_report.run, scores=g.collect(scores), params=p.negative_affordance_report, ctx=g.ctx)
    g.target("negative-affordance", files, record, report, record_run(g, "negative_affordance_report", report))


TARGETS = {"dataset": dataset, "recordings": recordings, "scenes": scenes, "extraction-report": extraction_quality,
           "train-set": train_set, "benchmark-set": benchmark_stills, "train": train, "benchmark": measure,
           "ablation": ablate, "negative-affordance": negative_affordance}


def build(target: str, origin: Origin, p: Settings) -> Graph:
    """The graph of one target of `TARGETS`."""
    g = Graph()
    TARGETS[target](g, origin, p)
    return g


if __name__ == "__main__":
    from commands.cli import main

    raise SystemExit(main())
