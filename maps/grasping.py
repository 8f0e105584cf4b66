"""Graph of the grasping system: objects and human motion -> prior, teachers, students -> evaluations and the report.

Targets: `grasp` (a teacher with and without negative rewards), `grasp-full` (all rows of the tables), `grasp-play` (a film of the
shipped teacher). Recorded motion is in maps/motions.py, meshes of the user in maps/own_meshes.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from afford.grasping.evaluate.recipes import (
    CARRIED,
    NO_NEGATIVE,
    POSITIVE,
    POSITIVE_TRUTH,
    ROWS,
    STUDENT,
    STUDENTS,
    TEACHER,
    planned_runs,
)
from afford.grasping.hand.assets import shadow_files
from maps import surface, twohands
from maps.common import parameters, record_run, recorded, reported, shipped, weights
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
    motion_report,
    motion_synthesise,
    object_solids,
    rl_grasp_refinement,
)
from stages.recording import grasp_record, motion_record, policy_record, positive_record
from stages.surface import part_describe, positive_affordance_projection
from stages.synthetic import object_build, object_plan

HELD = ("brush", "chisel", "flashlight", "knife", "pizza_cutter", "screwdriver", "spatula")
"""categories of the training objects"""
NEVER = ("cleaver", "razor", "soldering_iron")
"""unseen categories, of those with a handle that a hand can hold on a table"""
TRAINING, NEW_SHAPES = "training", "unseen_object"
"""tasks to train on (level `train`, and the same with heavy negative parts); level of new shapes of the training categories"""
LEVELS_OF_ROW = {TEACHER: LEVELS, NO_NEGATIVE: LEVELS, STUDENT: LEVELS, POSITIVE: LEVELS[:2], POSITIVE_TRUTH: LEVELS[:2]}
"""row -> levels it is evaluated on; every other row is evaluated on level `train` only"""
CONDITIONS: dict[str, dict[str, Any]] = {"dropped": {"poses": "dropped"}, "pushed": {"push_n": 2.0}}
"""further evaluations of a teacher on level `train`: objects dropped at random; pushes on the raised object"""
SHOWN, EPISODES_SHOWN = ("knife", "screwdriver", "spatula"), 9
"""tools of `grasp-play`, and its episodes"""
SHAPES, SIZES, BALLAST = 6, (0.85, 1.15), 6.0
"""shapes of each training category; scales of level `unseen_size`; density of negative parts relative to the others in half of the
training tasks (steel on wood), so that policies also learn to hold an object beside its centre of mass"""


# Objects and tasks


class Objects(NamedTuple):
    """Objects and their grasp tasks."""

    train: GraspObject
    """each training object"""
    new_shapes: GraspObject
    """each object of new shapes of the training categories"""
    tasks: dict[str, tuple[tuple[GraspTask, ...], ...]]
    """tasks of each of LEVELS, and of TRAINING"""
    spec: dict[str, ObjectSpec]
    """each object of TRAINING and NEW_SHAPES"""
    tasks_of_object: dict[str, tuple[GraspTask, ...]]
    """tasks of each object, by level"""


def grasp_objects(g: Graph, p: Settings) -> Objects:
    """Build procedural objects and their tasks: to train on, new shapes, other sizes, other categories."""
    categories = p.synthetic.object_plan.categories or (*HELD, *NEVER)
    known = replace(p.synthetic.object_plan, categories=tuple(one for one in HELD if one in categories), train_plain_every=0,
                    train_per_category=min(SHAPES, p.synthetic.object_plan.train_per_category))  # fmt: skip
    never = replace(known, categories=tuple(one for one in NEVER if one in categories))
    train = rigid_bodies(g, "known", replace(known, splits=("train",)), p)
    seen = rigid_bodies(g, "seen", replace(known, splits=("seen",)), p)
    unseen = rigid_bodies(g, "unseen", replace(never, splits=("unseen",)), p)
    usual = p.grasping.grasp_tasks
    tasks = {
        TRAINING: object_tasks(g, "lesson", train, replace(usual, ballast=(1.0, BALLAST))),
        "train": object_tasks(g, "known", train, usual),
        "unseen_object": object_tasks(g, "seen", seen, usual),
        "unseen_size": object_tasks(g, "size", train, replace(usual, scales=SIZES, level="unseen_size")),
        "unseen_category": object_tasks(g, "unseen", unseen, usual),
    }
    collected = {level: g.collect(some) for level, some in tasks.items()}
    return Objects(train[1], seen[1], collected, {TRAINING: train[0], NEW_SHAPES: seen[0]}, tasks)


def rigid_bodies(g: Graph, name: str, plan: object_plan.Params, p: Settings) -> tuple[ObjectSpec, GraspObject]:
    """Plan and build objects, and turn them into rigid bodies."""
    spec = g.each(g.named(f"{name}_plan").add(object_plan.run, params=plan))
    built = g.named(f"{name}_build").add(object_build.run, spec=spec, params=replace(p.synthetic.object_build, atlas_px=64))
    mesh, parts = g.pick(built, lambda b: b.mesh), g.pick(built, lambda b: b.parts)
    return spec, g.named(f"{name}_solids").add(object_solids.run, mesh=mesh, parts=parts, params=p.grasping.object_solids)


def object_tasks(g: Graph, name: str, made: tuple[ObjectSpec, GraspObject], params: grasp_tasks.Params) -> tuple[GraspTask, ...]:
    """Derive the grasp tasks of each rigid body."""
    return g.named(f"{name}_tasks").add(grasp_tasks.run, spec=made[0], body=made[1], params=params)


def negative_tasks(g: Graph, objects: Objects, p: Settings) -> tuple[GraspTask, ...]:
    """Replace N_t of the tasks of new shapes by predicted negative affordances."""
    x = surface.add_views(g, "naa", objects.spec[NEW_SHAPES], p.surface.view_render, p)
    found = surface.add_affordance(g, x, surface.train_scorer(g, p).files(g), p, "naa_").found
    return g.named("naa_tasks").add(grasp_tasks_predicted.run, tasks=objects.tasks_of_object[NEW_SHAPES], mesh=x.mesh,
                                    negatives=found, params=grasp_tasks_predicted.Params())  # fmt: skip


def positive_tasks(g: Graph, objects: Objects, p: Settings) -> tuple[tuple[GraspTask, ...], FileTree]:
    """Replace A_t of the training tasks by regions that the two-hand model of `run train` predicts; the tasks and a recording."""
    model = g.pick(twohands.train_model(g, stills_to_train(g, p), p), lambda t: t.files)
    x = surface.add_views(g, "positive", objects.spec[TRAINING], p.surface.view_render, p)
    descriptions = g.named("positive_describe").add(part_describe.run, mesh=x.mesh, views=x.views, params=p.surface.part_describe,
                                                    **weights(g, p, "part_describe"))  # fmt: skip
    params = p.surface.positive_affordance_projection
    found = g.add(positive_affordance_projection.run, mesh=x.mesh, views=x.views, descriptions=descriptions, model=model,
                  params=params, ctx=g.ctx)  # fmt: skip
    tasks = g.named("positive_tasks").add(grasp_tasks_predicted.run, tasks=objects.tasks_of_object[TRAINING], mesh=x.mesh,
                                          positives=found, params=grasp_tasks_predicted.Params())  # fmt: skip
    shown = g.named("record_positive_affordance_projection").add(
        positive_record.run, views=x.views, found=found, ctx=g.ctx,
        params=positive_record.Params(parameters(positive_affordance_projection=params)))  # fmt: skip
    return tasks, recorded(g, shown, "positive_affordance_projection/{clip}")


# Robot hand and human motion


def robot_hand(g: Graph, p: Settings) -> HandModel:
    """Build the installed Shadow Hand."""
    return g.add(hand_model.run, files=g.leaf("shadow", shadow_files()), params=p.grasping.hand_model)


class HumanMotion(NamedTuple):
    """Human grasps of objects, and the same in the joints of the robot hand."""

    targets: tuple[GraspTarget, ...]
    motion: HandMotion
    clip: Retargeted
    references: ReferenceSet


def human_motion(g: Graph, hand: HandModel, body: GraspObject, p: Settings, prefix: str = "") -> HumanMotion:
    """Synthesise human grasps of objects and retarget them to the robot hand; `prefix` of the names of the stages."""
    places = g.named(f"{prefix}grasp_targets").add(grasp_targets.run, body=body, hand=hand, params=p.grasping.grasp_targets)
    target = g.each(places)
    motion = g.each(g.named(f"{prefix}motion_synthesise").add(
        motion_synthesise.run, target=target, params=p.grasping.motion_synthesise))  # fmt: skip
    clip = g.named(f"{prefix}hand_retarget").add(hand_retarget.run, motion=motion, hand=hand, params=p.grasping.hand_retarget)
    report = g.named(f"{prefix}motion_report").add(motion_report.run, clips=g.collect(clip), params=p.grasping.motion_report)
    return HumanMotion(g.collect(target), motion, clip, report)


def record_motions(g: Graph, hand: HandModel, motion: HandMotion, clip: Retargeted, **stages: Any) -> FileTree:
    """Record motions and their retargeting.

    `stages` are the parameters of the stage that made or read the motions, and of hand_retarget.
    """
    stage = next(iter(stages))
    params = motion_record.Params(stage, parameters=parameters(**stages))
    made = g.named(f"record_{stage}").add(motion_record.run, hand=hand, motions=g.collect(motion), clips=g.collect(clip),
                                          params=params, ctx=g.ctx)  # fmt: skip
    return recorded(g, made, stage)


# Training


class Setup(NamedTuple):
    """Inputs of all trainings and evaluations, and the teachers trained so far."""

    hand: HandModel
    objects: Objects
    people: HumanMotion
    prior: Trained
    teachers: dict[tuple[str, int], Trained]
    """teacher of each (row, seed), for the students that learn from it"""
    trains_prior: bool = True
    """false where a trained prior is given (human_motion.prior)"""


def setup(g: Graph, p: Settings) -> Setup:
    """Build hand, objects and human motion, and train the frozen prior on them, unless one is given."""
    hand, objects = robot_hand(g, p), grasp_objects(g, p)
    people = human_motion(g, hand, objects.train, p)
    files = dict(p.weights).get("prior")
    if p.grasping.human_motion.prior and files:
        given = g.leaf("prior", Trained(files, TrainingLog("prior", (), 0, 0)))
        return Setup(hand, objects, people, given, {}, trains_prior=False)
    prior = g.add(hand_imitation.run, hand=hand, bodies=g.collect(objects.train), targets=people.targets,
                  references=people.references, params=p.grasping.hand_imitation, ctx=g.ctx)  # fmt: skip
    return Setup(hand, objects, people, prior, {})


def teacher_params(row: str, seed: int, p: Settings) -> rl_grasp_refinement.Params:
    """Parameters of training number `seed` of a teacher row.

    The configured seed is that of the first training; the configured lambda_n scales that of the row.
    """
    given = p.grasping.rl_grasp_refinement
    first = replace(given, name=f"{row}-{given.seed + seed}", seed=given.seed + seed)
    return replace(first, **{**ROWS[row], "lambda_n": ROWS[row]["lambda_n"] * given.lambda_n})


def student_params(row: str, seed: int, p: Settings) -> grasp_student.Params:
    """Parameters of training number `seed` of a student row; the configured seed is that of the first training."""
    number = p.grasping.grasp_student.seed + seed
    return replace(p.grasping.grasp_student, name=f"{row}-{number}", seed=number)


def train_teacher(g: Graph, s: Setup, row: str, seed: int, p: Settings) -> Trained:
    """Train a teacher of a row, over the prior where the row has one."""
    params = teacher_params(row, seed, p)
    tasks = s.objects.tasks[POSITIVE if row == POSITIVE else TRAINING]
    prior = (g.pick(s.prior, lambda t: t.files),) if params.base == "prior" else g.leaf("no_prior", ())
    trained = g.named(f"{row}_{seed}").add(rl_grasp_refinement.run, hand=s.hand, tasks=tasks, prior=prior, params=params, ctx=g.ctx)
    s.teachers[row, seed] = trained
    return trained


def train_student(g: Graph, s: Setup, row: str, seed: int, p: Settings) -> Trained:
    """Train a student from the teacher of its row with the same number."""
    teacher = g.pick(s.teachers[STUDENTS[row], seed], lambda t: t.files)
    return g.named(f"{row}_{seed}").add(grasp_student.run, hand=s.hand, tasks=s.objects.tasks[TRAINING], teacher=teacher,
                                        params=student_params(row, seed, p), ctx=g.ctx)  # fmt: skip


def record_policy(g: Graph, s: Setup, stage: str, trained: Trained, params: Any, p: Settings) -> FileTree:
    """Record the training curves of a policy, and episodes of it."""
    log, files = g.pick(trained, lambda t: t.log), g.pick(trained, lambda t: t.files)
    made = g.named(f"record_{stage}").add(
        policy_record.run, hand=s.hand, tasks=s.objects.tasks[TRAINING], log=log, files=files,
        params=replace(p.grasping.policy_record, stage=stage, parameters=parameters(**{stage: params})), ctx=g.ctx)  # fmt: skip
    return recorded(g, made, stage)


# Evaluation


def evaluate(g: Graph, s: Setup, policy: FileTree, name: str, seed: int, levels: Sequence[str], p: Settings,
             **changes: Any) -> list[tuple[GraspExam, GraspEpisodes]]:  # fmt: skip
    """Evaluate a policy on levels in every engine; `changes` of the parameters of grasp_evaluate."""
    return [(GraspExam(f"{name}-{seed}-{level}-{engine}", name, level, engine), g.named(f"{name}_{seed}_{level}_{engine}").add(
                grasp_evaluate.run, hand=s.hand, tasks=s.objects.tasks[level], policy=policy, references=s.people.references,
                params=replace(p.grasping.grasp_evaluate, policy=name, engine=engine, **changes), ctx=g.ctx))
            for level in levels for engine in p.grasping.grasp_report.engines]  # fmt: skip


def evaluate_two_tasks(g: Graph, s: Setup, policy: FileTree, name: str, seed: int, p: Settings) -> list[TwoTasksShown]:
    """Evaluate a policy on the same object with N_t at either end, in every engine."""
    return [g.named(f"{name}_{seed}_two_tasks_{engine}").add(
                grasp_two_tasks.run, hand=s.hand, bodies=g.collect(s.objects.train), policy=policy,
                params=replace(p.grasping.grasp_two_tasks, policy=name, engine=engine), ctx=g.ctx)
            for engine in p.grasping.grasp_report.engines]  # fmt: skip


def evaluate_prior(g: Graph, s: Setup, p: Settings) -> list[ClipsFollowed]:
    """Evaluate how the prior tracks held-out clips: other places and motions, of its training objects and of new shapes."""
    places, more = p.grasping.imitation_evaluate.places, p.grasping.imitation_evaluate.held_out
    held_out = p.with_stages(
        grasp_targets=replace(p.grasping.grasp_targets, places=places, seed=p.grasping.grasp_targets.seed + more),
        motion_synthesise=replace(p.grasping.motion_synthesise, seed=p.grasping.motion_synthesise.seed + more))  # fmt: skip
    prior = g.pick(s.prior, lambda t: t.files)
    out = list[ClipsFollowed]()
    for level, body in (("train", s.objects.train), ("unseen_object", s.objects.new_shapes)):
        clips = human_motion(g, s.hand, body, held_out, f"{level}_held_out_").references
        out += [g.named(f"followed_{level}_{engine}").add(
                    imitation_evaluate.run, hand=s.hand, bodies=g.collect(body), references=clips, prior=prior,
                    params=replace(p.grasping.imitation_evaluate, level=level, engine=engine), ctx=g.ctx)
                for engine in p.grasping.grasp_report.engines]  # fmt: skip
    return out


def judgements(g: Graph, s: Setup, episodes: GraspEpisodes, p: Settings) -> tuple[GraspJudgement, ...]:
    """Judge episodes by a vision-language model; nothing where no model is named."""
    if not grasp_judge.is_named(p.grasping.grasp_judge):
        return g.leaf("no_judgements", ())
    return (g.add(grasp_judge.run, hand=s.hand, tasks=s.objects.tasks["train"], episodes=episodes, params=p.grasping.grasp_judge,
                  **weights(g, p, "grasp_judge")),)  # fmt: skip


@dataclass(frozen=True)
class Results:
    """Evaluations, curves and published files of the trained policies."""

    episodes: list[tuple[GraspExam, GraspEpisodes]]
    logs: list[TrainingLog]
    """curves of the trainings"""
    two_tasks: list[TwoTasksShown]
    published: list[FileTree]
    """files of the first teacher and of the first student"""
    recordings: list[FileTree]
    """recordings of these two"""


def train_rows(g: Graph, s: Setup, runs: Iterable[tuple[str, int]], levels: Mapping[str, Sequence[str]], p: Settings,
               two_tasks: Settings | None = None) -> Results:  # fmt: skip
    """Train the policies of `runs`, (row, seed) each, and evaluate them on the levels of their row.

    The first teacher and the first policy without negative rewards are also evaluated on two tasks of one object, by the settings
    `two_tasks` (default: `p`). Evaluations in the slow engine precede those in the fast one, so that the last tasks of a run are
    short.
    """
    other, policies, logs = two_tasks or p, list[tuple[str, int, FileTree]](), list[TrainingLog]()
    recordings = list[FileTree]()
    for row, seed in runs:
        trained = train_student(g, s, row, seed, p) if row in STUDENTS else train_teacher(g, s, row, seed, p)
        policies.append((row, seed, g.pick(trained, lambda t: t.files)))
        logs.append(g.pick(trained, lambda t: t.log))
        if (row, seed) == (STUDENT, 0):
            recordings.append(record_policy(g, s, "grasp_student", trained, student_params(row, 0, p), p))
        elif (row, seed) == (TEACHER, 0):
            recordings.append(record_policy(g, s, "rl_grasp_refinement", trained, teacher_params(row, 0, p), p))
    published = [g.publish(files, f"models/{{source}}-{row}", as_=row) for row, seed, files in policies
                 if row in (TEACHER, STUDENT) and seed == 0]  # fmt: skip
    made = Results([], logs, [], published, recordings)
    for engine in p.grasping.grasp_report.engines:
        for row, seed, policy in policies:
            made.episodes.extend(evaluate(g, s, policy, row, seed, levels.get(row, LEVELS[:1]), in_engine(p, engine)))
            if row in (TEACHER, NO_NEGATIVE) and seed == 0 and engine in other.grasping.grasp_report.engines:
                made.two_tasks.extend(evaluate_two_tasks(g, s, policy, row, seed, in_engine(other, engine)))
    return made


def in_engine(p: Settings, engine: str) -> Settings:
    """Restrict evaluations to one engine."""
    return p.with_stages(grasp_report=replace(p.grasping.grasp_report, engines=(engine,)))


# Targets


def grasp(g: Graph, origin: Origin, p: Settings) -> None:
    """Prior, and a teacher with and without negative rewards, evaluated on all levels."""
    s, fast = setup(g, p), in_engine(p, p.grasping.grasp_report.engines[-1])
    report(g, "grasp", s, train_rows(g, s, planned_runs((TEACHER, NO_NEGATIVE), 1), {TEACHER: LEVELS}, p, fast), (), p)


def grasp_full(g: Graph, origin: Origin, p: Settings) -> None:
    """Table rows of grasping over several seeds; with --minutes, the rows finished by then. Run again to continue."""
    s, predicted, others = setup(g, p), {}, list[Any]()
    if POSITIVE in p.grasping.grasp_report.rows:
        tasks, recording = positive_tasks(g, s.objects, p)
        s.objects.tasks[POSITIVE], predicted["positives"] = g.collect(tasks), g.collect(tasks, partial=True)
        others.append(g.collect(recording, partial=True))
    results = train_rows(g, s, planned_runs(p.grasping.grasp_report.rows, p.grasping.grasp_report.seeds), LEVELS_OF_ROW, p)
    if (TEACHER, 0) in s.teachers:
        policy = g.pick(s.teachers[TEACHER, 0], lambda t: t.files)
        for (row, seed), teacher in s.teachers.items():
            if row == TEACHER:
                results.episodes.extend(evaluate(g, s, g.pick(teacher, lambda t: t.files), CARRIED, seed, LEVELS, p, carry=True))
        for name, changes in CONDITIONS.items():
            results.episodes.extend(evaluate(g, s, policy, f"{TEACHER}_{name}", 0, LEVELS[:1], p, **changes))
        if p.grasping.grasp_report.naa:
            found = negative_tasks(g, s.objects, p)
            with_predicted = s._replace(objects=s.objects._replace(tasks={NEW_SHAPES: g.collect(found)}))
            predicted["predicted"] = g.collect(found, partial=True)
            results.episodes.extend(evaluate(g, with_predicted, policy, f"{TEACHER}_naa", 0, (NEW_SHAPES,), p))
    results.episodes.extend(evaluate(g, s, g.pick(s.prior, lambda t: t.files), "prior", 0, LEVELS[:1], p))
    report(g, "grasp-full", s, results, evaluate_prior(g, s, p), p, others, **predicted)


def grasp_play(g: Graph, origin: Origin, p: Settings) -> None:
    """Grasps of built-in tools of new shapes by the shipped teacher, filmed and recorded; a teacher is trained where none is."""
    hand, policy = usual_teacher(g, p)
    chosen = replace(p.synthetic.object_plan, splits=("seen",), categories=p.synthetic.object_plan.categories or SHOWN)
    tools = rigid_bodies(g, "shown", chosen, p)
    tasks = g.collect(object_tasks(g, "shown", tools, p.grasping.grasp_tasks))
    people = human_motion(g, hand, tools[1], p, "shown_")
    few = replace(p.grasping.grasp_evaluate, engine="mujoco", episodes=EPISODES_SHOWN, traces=EPISODES_SHOWN)
    episodes = g.named("teacher_shown").add(grasp_evaluate.run, hand=hand, tasks=tasks, policy=policy, references=people.references,
                                            params=few, ctx=g.ctx)  # fmt: skip
    shown = g.named("teacher_record").add(grasp_record.run, hand=hand, tasks=tasks, episodes=episodes,
                                          params=p.grasping.grasp_record, ctx=g.ctx)  # fmt: skip
    g.target("grasp-play", g.publish(shown, "recordings/{source}/grasps", as_="films"))


def usual_teacher(g: Graph, p: Settings) -> tuple[HandModel, FileTree]:
    """Robot hand, and the shipped teacher; a teacher is trained where none is shipped."""
    policy = shipped(g, p, "rl_grasp_refinement")
    if policy is not None:
        return robot_hand(g, p), policy
    made = setup(g, p)
    return made.hand, g.pick(train_teacher(g, made, TEACHER, 0, p), lambda t: t.files)


def report(g: Graph, target: str, s: Setup, results: Results, followed: Iterable[ClipsFollowed], p: Settings,
           others: Iterable[Any] = (), **predicted: tuple[tuple[GraspTask, ...], ...]) -> None:  # fmt: skip
    """Report the results that are finished: tables, curves, film and sheet of the first policy, recordings; and set the target.

    `others` are further outputs of the target, `predicted` the tasks with predicted affordances.
    """
    planned, episodes = zip(*results.episodes, strict=True)
    pairs = g.finished("pairs", [g.pick(one, lambda t: t.pairs) for one in results.two_tasks])
    sheets = g.finished("sheets", [g.pick(one, lambda t: t.sheet) for one in results.two_tasks[:1]])
    logs = g.finished("logs", [*([g.pick(s.prior, lambda t: t.log)] if s.trains_prior else []), *results.logs])
    first = episodes[0]
    page = g.add(grasp_report.run, episodes=g.finished("episodes", episodes), logs=logs, pairs=pairs, sheets=sheets,
                 followed=g.finished("followed", followed), judged=judgements(g, s, first, p), params=p.grasping.grasp_report,
                 ctx=g.ctx, planned=g.leaf("planned", planned), **predicted)  # fmt: skip
    shown = g.add(grasp_record.run, hand=s.hand, tasks=s.objects.tasks["train"], episodes=first, params=p.grasping.grasp_record,
                  ctx=g.ctx)  # fmt: skip
    g.publish(shown, "recordings/{source}/grasps", as_="films")
    prior = g.publish(g.pick(s.prior, lambda t: t.files), "models/{source}-prior", as_="prior")
    control_rates(g, reported(g, page), results.episodes)
    motions = record_motions(g, s.hand, s.people.motion, s.people.clip, motion_synthesise=p.grasping.motion_synthesise,
                             hand_retarget=p.grasping.hand_retarget)  # fmt: skip
    curves = [record_policy(g, s, "hand_imitation", s.prior, p.grasping.hand_imitation, p)] if s.trains_prior else []
    recordings = [*curves, *results.recordings]
    g.target(target, page, shown, prior, g.finished("policies", results.published), record_run(g, "grasp_report", page), motions,
             g.finished("recordings", recordings), *others)  # fmt: skip


def control_rates(g: Graph, page: FileTree, episodes: Iterable[tuple[GraspExam, GraspEpisodes]]) -> None:
    """Report control steps per CPU second of the evaluations, by engine; PyBullet's figure has no prefix."""
    for engine, prefix in (("bullet", ""), ("mujoco", "mujoco.")):
        g.cost(f"{prefix}control_steps_per_s", [made for exam, made in episodes if exam.engine == engine],
               (page, f"control_steps.{engine}"), rate=True)  # fmt: skip
