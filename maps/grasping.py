"""From objects and motions of people to a policy that grasps and keeps off what must not be touched, one line per stage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from afford.grasping.evaluate.recipes import NO_NEGATIVE, POSITIVE, POSITIVE_TRUTH, ROWS, STUDENT, STUDENTS, TEACHER, planned_runs
from afford.grasping.hand.assets import shadow_files
from maps import surface, twohands
from maps.common import parameters, record_run, recorded, reported, weights
from maps.settings import Origin, Settings
from maps.synthetic import stills_to_train
from runner import Graph
from schemas.episodes import ClipsFollowed, GraspEpisodes, GraspExam, GraspJudgement, TwoTasksShown
from schemas.files import FileTree
from schemas.grasp import LEVELS, GraspObject, GraspTask
from schemas.hand import GraspTarget, HandModel, HandMotion, ReferenceSet, Retargeted
from schemas.mesh import ObjectSpec
from schemas.training import Trained, TrainingLog
from stages.grasping import (
    grasp_evaluate,
    grasp_judge,
    grasp_report,
    grasp_student,
    grasp_targets,
    grasp_tasks,
    grasp_tasks_predicted,
    grasp_two_tasks,
    hand_imitation,
    hand_model,
    hand_retarget,
    imitation_evaluate,
    motion_files,
    motion_read,
    motion_report,
    motion_synthesise,
    object_solids,
    rl_grasp_refinement,
)
from stages.recording import grasp_record, motion_record, policy_record, positive_record
from stages.surface import part_describe, positive_affordance_projection
from stages.synthetic import object_build, object_plan

HELD = ("brush", "chisel", "flashlight", "knife", "pizza_cutter", "screwdriver", "spatula")
"""categories that policies learn on"""
NEVER = ("cleaver", "razor", "soldering_iron")
"""categories that they never see, of those with a handle that a hand can hold on a table"""
NEW, LESSONS = "unseen_object", "lessons"
"""level of new shapes; what policies learn on: the training level, and the same with heavy heads"""
EXAMINED = {TEACHER: LEVELS, NO_NEGATIVE: LEVELS, STUDENT: LEVELS, POSITIVE: LEVELS[:2], POSITIVE_TRUTH: LEVELS[:2]}
"""row -> levels; every other row only on what it learned on"""
CONDITIONS: dict[str, dict[str, Any]] = {"dropped": {"poses": "dropped"}, "pushed": {"push_n": 2.0}}
"""other ways to examine a teacher, on what it learned on: objects that fell at random; pushes in the air"""
SHAPES, SIZES, BALLAST = 6, (0.85, 1.15), 6.0
"""of each category to learn on; how much smaller and larger these are on the level of other sizes; how many times as dense what is
forbidden is in half of the lessons: steel on wood, so that hands also learn to hold a thing beside its centre of mass"""


class Shop(NamedTuple):
    """What is grasped, level by level."""

    body: GraspObject
    """each of the training level"""
    unseen: GraspObject
    """each of new shapes of the same categories"""
    tasks: dict[str, tuple[tuple[GraspTask, ...], ...]]
    """of LEVELS and LESSONS"""
    spec: dict[str, ObjectSpec]
    """each object of LESSONS and NEW"""
    each: dict[str, tuple[GraspTask, ...]]
    """the tasks of each object"""


def shop(g: Graph, p: Settings) -> Shop:
    """Procedural objects with their parts as tasks: to learn on, new shapes, other sizes, other categories."""
    wanted  = p.synthetic.object_plan.categories or (*HELD, *NEVER)
    known   = replace(p.synthetic.object_plan, categories=tuple(one for one in HELD if one in wanted), train_plain_every=0,
                      train_per_category=min(SHAPES, p.synthetic.object_plan.train_per_category))
    never   = replace(known, categories=tuple(one for one in NEVER if one in wanted))
    train   = solid(g, "known", replace(known, splits=("train",)), p)
    seen    = solid(g, "seen", replace(known, splits=("seen",)), p)
    unseen  = solid(g, "unseen", replace(never, splits=("unseen",)), p)
    sizes   = replace(p.grasping.grasp_tasks, scales=SIZES, level="unseen_size")
    heavy   = replace(p.grasping.grasp_tasks, ballast=(1.0, BALLAST))
    each    = {
        LESSONS: uses(g, "lesson", train, heavy),
        "train": uses(g, "known", train, p.grasping.grasp_tasks), "unseen_object": uses(g, "seen", seen, p.grasping.grasp_tasks),
        "unseen_size": uses(g, "size", train, sizes), "unseen_category": uses(g, "unseen", unseen, p.grasping.grasp_tasks)}
    return Shop(train[1], seen[1], {level: g.collect(tasks) for level, tasks in each.items()}, {LESSONS: train[0], NEW: seen[0]},
                each)


def solid(g: Graph, of: str, plan: object_plan.Params, p: Settings) -> tuple[ObjectSpec, GraspObject]:
    """Objects of some splits -> rigid bodies."""
    spec    = g.each(g.named(f"{of}_plan").add(object_plan.run,                                      params=plan))
    built   = g.named(f"{of}_build").add(object_build.run, spec=spec,         params=replace(p.synthetic.object_build, atlas_px=64))
    mesh, parts = g.pick(built, lambda b: b.mesh), g.pick(built, lambda b: b.parts)
    return spec, g.named(f"{of}_solids").add(object_solids.run, mesh=mesh, parts=parts,             params=p.grasping.object_solids)


def uses(g: Graph, of: str, made: tuple[ObjectSpec, GraspObject], params: grasp_tasks.Params) -> tuple[
        GraspTask, ...]:  # fmt: skip
    """Each rigid body -> what it may be grasped for."""
    return g.named(f"{of}_tasks").add(grasp_tasks.run, spec=made[0], body=made[1], params=params)


def naa(g: Graph, s: Shop, p: Settings) -> tuple[GraspTask, ...]:
    """Tasks of new shapes, told where a hand must not go as the chain of negative affordances predicts it."""
    x       = surface.look_at(g, "naa", s.spec[NEW], p.surface.view_render, p)
    found   = surface.judge(g, x, surface.teach(g, p).files(g), p, "naa_").found
    return g.named("naa_tasks").add(grasp_tasks_predicted.run, tasks=s.each[NEW], mesh=x.mesh, negatives=found,
                                    params=grasp_tasks_predicted.Params())


class Positive(NamedTuple):
    """Handles of tasks that are told where hands belong, and of the recording of it."""

    tasks: tuple[GraspTask, ...]
    recording: FileTree


def positive(g: Graph, s: Shop, p: Settings) -> Positive:
    """Tasks to learn on, told where hands belong as the two-hand model of `run train` predicts it."""
    model   = g.pick(twohands.train_model(g, stills_to_train(g, p), p), lambda t: t.files)
    x       = surface.look_at(g, "positive", s.spec[LESSONS], p.surface.view_render, p)
    told    = g.named("positive_describe").add(part_describe.run, mesh=x.mesh, views=x.views,        params=p.surface.part_describe,
                                                **weights(g, p, "part_describe"))
    found   = g.add(positive_affordance_projection.run, mesh=x.mesh, views=x.views, descriptions=told, model=model,
                    params=p.surface.positive_affordance_projection, ctx=g.ctx)
    tasks   = g.named("positive_tasks").add(grasp_tasks_predicted.run, tasks=s.each[LESSONS], mesh=x.mesh, positives=found,
                                            params=grasp_tasks_predicted.Params())
    mine    = parameters(positive_affordance_projection=p.surface.positive_affordance_projection)
    shown   = g.named("record_positive_affordance_projection").add(positive_record.run, views=x.views, found=found, ctx=g.ctx,
                                                                   params=positive_record.Params(mine))
    return Positive(tasks, recorded(g, shown, "positive_affordance_projection/{clip}"))


def hand(g: Graph, p: Settings) -> HandModel:
    """The installed Shadow Hand."""
    return g.add(hand_model.run,            files=g.leaf("shadow", shadow_files()),                  params=p.grasping.hand_model)


class People(NamedTuple):
    """Handles of how people grasp, and of the same in the joints of a robot hand."""

    targets: tuple[GraspTarget, ...]
    motion: HandMotion
    clip: Retargeted
    references: ReferenceSet


def people(g: Graph, hand: HandModel, body: GraspObject, p: Settings, of: str = "") -> People:
    """Objects -> where people could grasp them, and how they do, in the hand's own joints. `of`: of other clips than those that are
    learned from.
    """
    name    = (lambda stage: f"{of}_{stage}") if of else str
    places  = g.named(name("grasp_targets")).add(grasp_targets.run, body=body, hand=hand,           params=p.grasping.grasp_targets)
    target  = g.each(places)
    motion  = g.each(g.named(name("motion_synthesise")).add(
                motion_synthesise.run, target=target,                                          params=p.grasping.motion_synthesise))
    clip    = g.named(name("hand_retarget")).add(
                hand_retarget.run,  motion=motion, hand=hand,                                       params=p.grasping.hand_retarget)
    report  = g.named(name("motion_report")).add(
                motion_report.run, clips=g.collect(clip),                                           params=p.grasping.motion_report)
    return People(g.collect(target), motion, clip, report)


def record_motions(g: Graph, hand: HandModel, motion: HandMotion, clip: Retargeted, **stages: Any) -> FileTree:
    """Some motions and what became of them -> their recording; `stages` are the parameters of the stage that made or read them, and
    of hand_retarget.
    """
    stage   = next(iter(stages))
    made    = g.named(f"record_{stage}").add(motion_record.run, hand=hand, motions=g.collect(motion), clips=g.collect(clip),
                                             params=motion_record.Params(stage, parameters=parameters(**stages)), ctx=g.ctx)
    return recorded(g, made, stage)


def follow(g: Graph, s: School, p: Settings) -> list[ClipsFollowed]:
    """The prior beside clips that its training does not show: other places and other people, on its objects and on new shapes."""
    places, more = p.grasping.imitation_evaluate.places, p.grasping.imitation_evaluate.held_out
    other = p.with_stages(grasp_targets=replace(p.grasping.grasp_targets, places=places, seed=p.grasping.grasp_targets.seed + more),
                            motion_synthesise=replace(p.grasping.motion_synthesise, seed=p.grasping.motion_synthesise.seed + more))
    prior   = g.pick(s.prior, lambda t: t.files)
    out     = list[ClipsFollowed]()
    for level, body in (("train", s.shop.body), ("unseen_object", s.shop.unseen)):
        clips = people(g, s.hand, body, other, f"{level}_held_out").references
        out += [g.named(f"followed_{level}_{engine}").add(
                    imitation_evaluate.run, hand=s.hand, bodies=g.collect(body), references=clips, prior=prior,
                    params=replace(p.grasping.imitation_evaluate, level=level, engine=engine), ctx=g.ctx)
                for engine in p.grasping.grasp_report.engines]  # fmt: skip
    return out


class School(NamedTuple):
    """What policies learn from."""

    hand: HandModel
    shop: Shop
    references: ReferenceSet
    people: People
    prior: Trained
    teachers: dict[tuple[str, int], Trained]
    """by row and seed, for those who learn from them"""


def record_policy(g: Graph, s: School, stage: str, trained: Trained, params: Any) -> FileTree:
    """The curves of a policy's training, and episodes of it -> its recording."""
    log, files = g.pick(trained, lambda t: t.log), g.pick(trained, lambda t: t.files)
    mine    = parameters(**{stage: params})
    made    = g.named(f"record_{stage}").add(policy_record.run, hand=s.hand, tasks=s.shop.tasks[LESSONS], log=log, files=files,
                                             params=policy_record.Params(stage, parameters=mine), ctx=g.ctx)
    return recorded(g, made, stage)


def school(g: Graph, p: Settings) -> School:
    """A hand, things to grasp, how people do it, and the frozen prior that has learned from them."""
    model, things = hand(g, p), shop(g, p)
    x       = people(g, model, things.body, p)
    prior   = g.add(hand_imitation.run,     hand=model, bodies=g.collect(things.body), targets=x.targets, references=x.references,
                    params=p.grasping.hand_imitation, ctx=g.ctx)
    return School(model, things, x.references, x, prior, {})


def teacher(row: str, seed: int, p: Settings) -> rl_grasp_refinement.Params:
    """Parameters of the `seed`th training of a row. What is set for all teachers is the first seed, and times the weight of a row's
    negative terms.
    """
    given   = p.grasping.rl_grasp_refinement
    first   = replace(given, name=f"{row}-{given.seed + seed}", seed=given.seed + seed)
    return replace(first, **{**ROWS[row], "lambda_n": ROWS[row]["lambda_n"] * given.lambda_n})


def student(row: str, seed: int, p: Settings) -> grasp_student.Params:
    """The same of a student; its own seeds begin with what is set."""
    first   = p.grasping.grasp_student.seed + seed
    return replace(p.grasping.grasp_student, name=f"{row}-{first}", seed=first)


def teach(g: Graph, s: School, row: str, seed: int, p: Settings) -> Trained:
    """A teacher of one row, on the prior where the row has one."""
    params  = teacher(row, seed, p)
    tasks   = s.shop.tasks[POSITIVE if row == POSITIVE else LESSONS]
    prior   = (g.pick(s.prior, lambda t: t.files),) if params.base == "prior" else g.leaf("no_prior", ())
    trained = g.named(f"{row}_{seed}").add(rl_grasp_refinement.run, hand=s.hand, tasks=tasks, prior=prior, params=params,
                                           ctx=g.ctx)
    s.teachers[row, seed] = trained
    return trained


def examine(g: Graph, s: School, policy: FileTree, name: str, seed: int, levels: Sequence[str], p: Settings,
            **changes: Any) -> list[tuple[GraspExam, GraspEpisodes]]:  # fmt: skip
    """A policy on levels, in both engines; `changes` of what is asked."""
    return [(GraspExam(f"{name}-{seed}-{level}-{engine}", name, level, engine), g.named(f"{name}_{seed}_{level}_{engine}").add(
                grasp_evaluate.run, hand=s.hand, tasks=s.shop.tasks[level], policy=policy, references=s.references,
                params=replace(p.grasping.grasp_evaluate, policy=name, engine=engine, **changes), ctx=g.ctx))
            for level in levels for engine in p.grasping.grasp_report.engines]  # fmt: skip


@dataclass(frozen=True)
class Played:
    """What policies have done."""

    episodes: list[tuple[GraspExam, GraspEpisodes]]
    logs: list[TrainingLog]
    """of their trainings"""
    twice: list[TwoTasksShown]
    """one object, two tasks"""
    shown: list[FileTree]
    """policies that are put where people find them: the first teacher and the first student"""
    recordings: list[FileTree]
    """of the same"""


def rows(g: Graph, s: School, wanted: Iterable[tuple[str, int]], levels: Mapping[str, Sequence[str]], p: Settings,
         beside: Settings | None = None) -> Played:  # fmt: skip
    """Policies, trained and examined on `levels`, those that have none there on what they learned on; the teacher and the one
    without negative terms also on one object, two tasks, by `beside` where it is said. All that the slow engine plays comes before
    what the fast one does, so that the last tasks of a run are short and no core waits for another.
    """
    other, policies, logs = beside or p, list[tuple[str, int, FileTree]](), list[TrainingLog]()
    recordings = list[FileTree]()
    for row, seed in wanted:
        trained = learn(g, s, row, seed, p) if row in STUDENTS else teach(g, s, row, seed, p)
        policies.append((row, seed, g.pick(trained, lambda t: t.files)))
        logs.append(g.pick(trained, lambda t: t.log))
        if row in (TEACHER, STUDENT) and seed == 0:
            stage, params = ("grasp_student", student(row, 0, p)) if row == STUDENT else ("rl_grasp_refinement", teacher(row, 0, p))
            recordings.append(record_policy(g, s, stage, trained, params))
    shown = [g.publish(files, f"models/{{source}}-{row}", as_=row) for row, seed, files in policies
             if row in (TEACHER, STUDENT) and seed == 0]  # fmt: skip
    made = Played([], logs, [], shown, recordings)
    for engine in p.grasping.grasp_report.engines:
        for row, seed, policy in policies:
            made.episodes.extend(examine(g, s, policy, row, seed, levels.get(row, LEVELS[:1]), within(p, engine)))
            if row in (TEACHER, NO_NEGATIVE) and seed == 0 and engine in other.grasping.grasp_report.engines:
                made.twice.extend(twice(g, s, policy, row, seed, within(other, engine)))
    return made


def within(p: Settings, engine: str) -> Settings:
    """The same, in one engine alone."""
    return p.with_stages(grasp_report=replace(p.grasping.grasp_report, engines=(engine,)))


def learn(g: Graph, s: School, row: str, seed: int, p: Settings) -> Trained:
    """A student of its row's teacher of the same number."""
    return g.named(f"{row}_{seed}").add(grasp_student.run, hand=s.hand, tasks=s.shop.tasks[LESSONS],
                                        teacher=g.pick(s.teachers[STUDENTS[row], seed], lambda t: t.files),
                                        params=student(row, seed, p), ctx=g.ctx)


def twice(g: Graph, s: School, policy: FileTree, name: str, seed: int, p: Settings) -> list[TwoTasksShown]:
    """A policy before the same object with N_t at either end, in each engine."""
    return [g.named(f"{name}_{seed}_two_tasks_{engine}").add(
                grasp_two_tasks.run, hand=s.hand, bodies=g.collect(s.shop.body), policy=policy,
                params=replace(p.grasping.grasp_two_tasks, policy=name, engine=engine), ctx=g.ctx)
            for engine in p.grasping.grasp_report.engines]  # fmt: skip


def grasp(g: Graph, origin: Origin, p: Settings) -> None:
    """a hand that grasps as people do and keeps off what must not be touched: prior, teacher with and without, examinations"""
    s, beside = school(g, p), within(p, p.grasping.grasp_report.engines[-1])
    report(g, "grasp", s, rows(g, s, planned_runs((TEACHER, NO_NEGATIVE), 1), {TEACHER: LEVELS}, p, beside), (), p)


def alone(g: Graph, s: School, p: Settings) -> list[tuple[GraspExam, GraspEpisodes]]:
    """The prior without any teacher, on what they learn on."""
    return examine(g, s, g.pick(s.prior, lambda t: t.files), "prior", 0, LEVELS[:1], p)


def grasp_full(g: Graph, origin: Origin, p: Settings) -> None:
    """all rows of the tables of grasping, over several seeds; with --minutes, what is finished by then; go on at will"""
    s, predicted, others = school(g, p), {}, list[Any]()
    if POSITIVE in p.grasping.grasp_report.rows:
        drawn, shown = positive(g, s.shop, p)
        s.shop.tasks[POSITIVE], predicted["positives"] = g.collect(drawn), g.collect(drawn, partial=True)
        others.append(g.collect(shown, partial=True))
    played = rows(g, s, planned_runs(p.grasping.grasp_report.rows, p.grasping.grasp_report.seeds), EXAMINED, p)
    if (TEACHER, 0) in s.teachers:
        policy = g.pick(s.teachers[TEACHER, 0], lambda t: t.files)
        for name, changes in CONDITIONS.items():
            played.episodes.extend(examine(g, s, policy, f"{TEACHER}_{name}", 0, LEVELS[:1], p, **changes))
        if p.grasping.grasp_report.naa:
            found = naa(g, s.shop, p)
            told  = s._replace(shop=s.shop._replace(tasks={NEW: g.collect(found)}))
            predicted["predicted"] = g.collect(found, partial=True)
            played.episodes.extend(examine(g, told, policy, f"{TEACHER}_naa", 0, (NEW,), p))
    played.episodes.extend(alone(g, s, p))
    report(g, "grasp-full", s, played, follow(g, s, p), p, others, **predicted)


def asked(g: Graph, s: School, episodes: GraspEpisodes, p: Settings) -> tuple[GraspJudgement, ...]:
    """What a vision-language model thinks of them, where one is named."""
    if not grasp_judge.is_named(p.grasping.grasp_judge):
        return g.leaf("nobody_asked", ())
    return (g.add(grasp_judge.run,       hand=s.hand, tasks=s.shop.tasks["train"], episodes=episodes, params=p.grasping.grasp_judge,
                  **weights(g, p, "grasp_judge")),)  # fmt: skip


def report(g: Graph, target: str, s: School, played: Played, followed: Iterable[ClipsFollowed], p: Settings,
           others: Iterable[Any] = (), **predicted: tuple[tuple[GraspTask, ...], ...]) -> None:  # fmt: skip
    """Tables and curves; a recording, a film and a sheet of the first policy; recordings of motions and trainings, and `others`
    that are made beside them. They are made of what is finished.
    """
    planned, episodes = zip(*played.episodes, strict=True)
    pairs   = g.finished("pairs", [g.pick(one, lambda t: t.pairs) for one in played.twice])
    sheets  = g.finished("sheets", [g.pick(one, lambda t: t.sheet) for one in played.twice[:1]])
    logs    = g.finished("logs", [g.pick(s.prior, lambda t: t.log), *played.logs])
    first   = episodes[0]
    judged  = asked(g, s, first, p)
    page    = g.add(grasp_report.run,       episodes=g.finished("episodes", episodes), logs=logs, pairs=pairs, sheets=sheets,
                    followed=g.finished("followed", followed), judged=judged, params=p.grasping.grasp_report, ctx=g.ctx,
                    planned=g.leaf("planned", planned), **predicted)
    shown   = g.add(grasp_record.run,       hand=s.hand, tasks=s.shop.tasks["train"], episodes=first,
                    params=p.grasping.grasp_record, ctx=g.ctx)
    g.publish(shown, "recordings/{source}/grasps", as_="films")
    prior   = g.publish(g.pick(s.prior, lambda t: t.files), "models/{source}-prior", as_="prior")
    rates(g, reported(g, page), played.episodes)
    moving  = record_motions(g, s.hand, s.people.motion, s.people.clip, motion_synthesise=p.grasping.motion_synthesise,
                             hand_retarget=p.grasping.hand_retarget)
    learned = [record_policy(g, s, "hand_imitation", s.prior, p.grasping.hand_imitation), *played.recordings]
    g.target(target, page, shown, prior, g.finished("policies", played.shown), record_run(g, "grasp_report", page), moving,
             g.finished("recordings", learned), *others)


def rates(g: Graph, page: FileTree, episodes: Iterable[tuple[GraspExam, GraspEpisodes]]) -> None:
    """Control steps a CPU second of examinations: physics, observations, policies, figures; PyBullet's has no prefix."""
    for engine, prefix in (("bullet", ""), ("mujoco", "mujoco.")):
        g.cost(f"{prefix}control_steps_per_s", [made for exam, made in episodes if exam.engine == engine],
               (page, f"control_steps.{engine}"), rate=True)


def motions(g: Graph, origin: Origin, p: Settings) -> None:
    """recorded motion of hands in the joints of a robot hand, and what was dropped, and why"""
    model   = hand(g, p)
    files   = origin.motions or FileTree(origin.name, ())
    motion  = g.each(g.first(g.add(motion_read.run, files=g.leaf("motions", files), params=p.grasping.motion_read)))
    clip    = g.named("motion_retarget").add(
                hand_retarget.run,          motion=motion,   hand=model,                          params=p.grasping.motion_retarget)
    found   = g.add(motion_report.run,      clips=g.collect(clip),                                  params=p.grasping.motion_report)
    made    = g.add(motion_files.run,       references=found,        params=motion_files.Params(origin.name), ctx=g.ctx)
    g.measure(g.publish(made, "motions/{source}", as_="report"))
    moving  = record_motions(g, model, motion, clip, motion_read=p.grasping.motion_read, hand_retarget=p.grasping.motion_retarget)
    g.target("motions", made, record_run(g, "motion_files", made), moving)
