"""Train and examine rows of `run grasp-full` on a machine with many cores, over the shipped prior; the table is written here.

    PYTHONPATH=. python benchmarks/grasp_elsewhere.py pack  --work DIR [--store DIR] [--positive]     # here: hand, tasks, prior
    PYTHONPATH=. python benchmarks/grasp_elsewhere.py train --work DIR [--rows NAMES] [--seeds LIST] [--at-once N] [--device cuda]
    PYTHONPATH=. python benchmarks/grasp_elsewhere.py keep  --work DIR [--store DIR] [--bullet NAMES] [--levels NAMES]

`train` needs no PyBullet. Each row and seed is a process of one thread; it is examined in MuJoCo, and DIR keeps its policy and its
episodes. A student learns from the teacher of its row that is there. The row `positive` needs `pack --positive`, which trains the
two-hand model of `run train` unless it is cached. Run again, it goes on with what is missing. `keep` adds figures of `--rows` to
benchmarks/grasp_rows.json and writes the tables of docs/grasping/grasping.md and of the README. Policies of the rows of `--bullet`
are examined in PyBullet as well, those of `--levels` on every level in both engines; `teacher_carried` there are the teachers with
the carry.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from afford.codecs import load_folder, save
from afford.common.files import empty_folder, tree
from afford.grasping.evaluate.recipes import CARRIED, POSITIVE, STUDENTS, TEACHER
from benchmarks.two_hands_renderers import Here
from runner import Graph, Runner
from schemas.episodes import GraspEpisodes
from schemas.grasp import LEVELS
from schemas.hand import HandModel
from schemas.spec import Schema
from schemas.training import Trained

ROOT = Path(__file__).resolve().parent.parent
PRIOR = ROOT / "weights" / "grasp-prior"
ROWS = ("teacher", "paper_none", "paper_hti", "paper_light", "paper_half", "paper_reward", "paper_double", "transfer_none",
        "transfer_hti", "transfer_naa", "transfer_both", "neither", "naa_only", "on_script", "positive_truth", "positive",
        "no_negative", "student_no_negative", "paper_size")  # fmt: skip
LEVEL, ENGINES, COMMIT = LEVELS[0], ("bullet", "mujoco"), "commit.txt"


def pack(args: argparse.Namespace) -> None:
    """Write the hand, the tasks to train on and to examine, human motion, and the commit."""
    from benchmarks.pages import head
    from commands.session import digester, open_runner
    from commands.settings import settings
    from commands.weights import resolve_weights
    from maps import grasping

    runner, g = open_runner(args.store), Graph()
    p = resolve_weights(settings((f"human_motion.prior={PRIOR}",), None), digester(runner), "grasp-full")
    made = grasping.setup(g, p)
    wanted = {"hand": made.hand, "references": made.people.references, **{f"tasks-{level}": made.objects.tasks[level]
              for level in (grasping.TRAINING, *LEVELS)}}  # fmt: skip
    if args.positive:
        wanted[f"tasks-{POSITIVE}"] = g.collect(grasping.positive_tasks(g, made.objects, p)[0])
    for name, handle in wanted.items():
        shutil.rmtree(args.work / name, ignore_errors=True)
        for n, one in enumerate(plain(computed(runner, g, name, handle))):
            folder = args.work / name / f"{n:03d}"
            folder.mkdir(parents=True)
            save(one, folder)
    (args.work / COMMIT).write_text(head())


def computed(runner: Runner, g: Graph, target: str, *handles: Any) -> tuple[Any, ...]:
    """Values of nodes of the graph, which become a target. SystemExit where a stage fails."""
    from commands.progress import observer

    g.target(target, *handles)
    with observer(quiet=False) as shown:
        report = runner.run(g, target, observer=shown)
    if not report.ok:
        raise SystemExit(str(report.failures[0]))
    return tuple(runner.load(digest) for handle in handles for _, digest in report.outputs[g.node_of(handle).name])


def plain(value: Any) -> Iterator[Schema]:
    """Yield the plain values of a value, tuples within tuples one after the other."""
    if isinstance(value, tuple):
        for one in value:
            yield from plain(one)
    else:
        yield value


def packed(work: Path, name: str) -> tuple[Any, ...]:
    """Read what `pack` wrote."""
    return tuple(load_folder(folder) for folder in sorted((work / name).iterdir()))


def train(args: argparse.Namespace) -> None:
    """Train and examine every row and seed that is missing, several at once, each in a process of its own."""
    wanted = [f"{row}-{seed}" for seed in args.seeds.split(",") for row in args.rows.split(",")]
    missing = [name for name in wanted if not (args.work / "done" / name / "episodes").is_dir()]
    (args.work / "logs").mkdir(exist_ok=True)

    def one(name: str) -> None:
        command = (sys.executable, __file__, "one", "--work", str(args.work), "--rows", name, "--device", args.device)
        with (args.work / "logs" / f"{name}.txt").open("w") as log:
            code = subprocess.run(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT).returncode
        print(f"{name}: {'done' if code == 0 else f'failed, see logs/{name}.txt'}", flush=True)

    with ThreadPoolExecutor(args.at_once) as several:
        list(several.map(one, missing))


def train_one(args: argparse.Namespace) -> None:
    """Train one row with one seed and examine it in MuJoCo."""
    from stages.grasping import grasp_evaluate

    row = args.rows.rpartition("-")[0]
    hand, references = packed(args.work, "hand")[0], packed(args.work, "references")[0]
    scratch = args.work / "scratch" / args.rows
    scratch.mkdir(parents=True, exist_ok=True)
    trained = (student_of if row in STUDENTS else teacher_of)(args, hand, Here(scratch))
    policy = args.work / "done" / args.rows / "policy"
    for file in trained.files.files:
        (policy / file.name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file.path, policy / file.name)
    exam, tasks = grasp_evaluate.Params(policy=row, engine="mujoco", traces=0), packed(args.work, f"tasks-{LEVEL}")
    found = grasp_evaluate.run(hand, (tasks,), tree(row, policy), references, exam, Here(scratch))
    made = empty_folder(scratch / "episodes")
    save(found, made)
    made.rename(policy.parent / "episodes")


def teacher_of(args: argparse.Namespace, hand: HandModel, here: Here) -> Trained:
    """Train the teacher of a row and seed, over the shipped prior where the row has one."""
    from afford.grasping.evaluate.recipes import ROWS as RECIPES
    from stages.grasping import rl_grasp_refinement

    row, _, seed = args.rows.rpartition("-")
    usual = rl_grasp_refinement.Params(name=args.rows, seed=int(seed), device=args.device if row == "paper_size" else "cpu")
    params = replace(usual, **RECIPES[row])
    prior = (tree("prior", PRIOR),) if params.base == "prior" else ()
    tasks = packed(args.work, f"tasks-{POSITIVE if row == POSITIVE else 'training'}")
    return rl_grasp_refinement.run(hand, (tasks,), prior, params, here)


def student_of(args: argparse.Namespace, hand: HandModel, here: Here) -> Trained:
    """Train the student of a row and seed. SystemExit without its teacher."""
    from stages.grasping import grasp_student

    row, _, seed = args.rows.rpartition("-")
    teacher = args.work / "done" / f"{STUDENTS[row]}-{seed}" / "policy"
    if not teacher.is_dir():
        raise SystemExit(f"{args.rows}: expected its teacher in {teacher}; train the row {STUDENTS[row]} first")
    params = grasp_student.Params(name=args.rows, seed=int(seed))
    return grasp_student.run(hand, (packed(args.work, "tasks-training"),), tree("teacher", teacher), params, here)


def keep(args: argparse.Namespace) -> None:
    """Add the figures of all trained policies to the table's file, those of some in PyBullet as well."""
    from afford.grasping.evaluate.result_cells import scores
    from benchmarks import grasp_kept
    from benchmarks.bench_grasp import SELF, short
    from benchmarks.pages import into

    done = sorted(folder for folder in (args.work / "done").iterdir() if (folder / "episodes").is_dir())
    found = [load_folder(folder / "episodes") for folder in done if folder.name.rpartition("-")[0] in args.rows.split(",")]
    bullet, levels = args.bullet.split(","), args.levels.split(",")
    found += examined(args, [exam for folder in done for exam in more_exams(folder, bullet, levels)])
    told = args.work / "scores.json"
    told.write_text(json.dumps(scores(found)))
    known = grasp_kept.add(grasp_kept.KEPT, told, (args.work / COMMIT).read_text().strip())
    into(ROOT / "docs" / "grasping" / "grasping.md", "grasp-full", SELF, grasp_kept.table(known))
    into(ROOT / "README.md", "grasp", SELF, short(grasp_kept.rows(known)))


class Exam(NamedTuple):
    """An examination of a policy; its folder, and how."""

    folder: Path
    name: str
    level: str
    engine: str
    carry: bool = False


def more_exams(folder: Path, bullet: Collection[str], levels: Collection[str]) -> Iterator[Exam]:
    """Yield the examinations of a policy beyond that of its training."""
    row = folder.name.rpartition("-")[0]
    every = [(level, engine) for level in LEVELS for engine in ENGINES]
    if row == TEACHER and CARRIED in levels:
        yield from (Exam(folder, CARRIED, *one, carry=True) for one in every)
    if row in levels:
        yield from (Exam(folder, row, *one) for one in every if one != (LEVEL, "mujoco"))
    elif row in bullet:
        yield Exam(folder, row, LEVEL, "bullet")


def examined(args: argparse.Namespace, exams: Collection[Exam]) -> list[GraspEpisodes]:
    """Examine policies; results are kept in the store."""
    from commands.session import open_runner
    from stages.grasping import grasp_evaluate

    if not exams:
        return []
    runner, g = open_runner(args.store), Graph()
    (hand,), (references,) = packed(args.work, "hand"), packed(args.work, "references")
    leaves = {"hand": g.leaf("hand", hand), "references": g.leaf("references", references)}
    tasks = {level: g.collect(g.leaf(level, packed(args.work, f"tasks-{level}"))) for level in {one.level for one in exams}}
    policies = {one.folder: g.leaf(f"policy_{one.folder.name}", tree(one.folder.name, one.folder / "policy")) for one in exams}
    nodes = []
    for one in exams:
        params = grasp_evaluate.Params(policy=one.name, engine=one.engine, carry=one.carry, traces=0)
        name = f"{one.folder.name}_{one.name}_{one.level}_{one.engine}".replace("-", "_")
        nodes.append(g.named(name).add(grasp_evaluate.run, policy=policies[one.folder], tasks=tasks[one.level], params=params,
                                       ctx=g.ctx, **leaves))  # fmt: skip
    return list(computed(runner, g, "examined", *nodes))


def main() -> None:
    """Pack, train or keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts: dict[str, Callable[[argparse.Namespace], None]] = {"pack": pack, "train": train, "one": train_one, "keep": keep}
    parser.add_argument("part", choices=parts)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--store", type=Path, default=ROOT / "artifacts")
    parser.add_argument("--rows", default=",".join(ROWS))
    parser.add_argument("--seeds", default="0,1,2")
    parser.add_argument("--at-once", type=int, default=1)
    parser.add_argument("--device", default="cpu", help="of the networks of paper_size")
    parser.add_argument("--positive", action="store_true", help="pack the training tasks with predicted A_t, too")
    parser.add_argument("--bullet", default="", help="rows to examine in PyBullet too")
    parser.add_argument("--levels", default="", help="rows to examine on every level")
    args = parser.parse_args()
    parts[args.part](args)


if __name__ == "__main__":
    main()
