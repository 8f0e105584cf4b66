"""Content digests of what every target makes, pinned: `benchmarks/pinned_outputs.json`, the outputs before and after a change.

    python benchmarks/pin_outputs.py --write            run the targets, write the digests of all outputs
    python benchmarks/pin_outputs.py                    run them again and compare; exit code 1 where an output differs
    python benchmarks/pin_outputs.py --only grasp,sor3d --store DIR --old DIR_OF_PINNED

What a stage of `NAMES_CODE` makes says something about code, and may change with it; `--old` shows in which of its files.

`dataset`, `recordings` and `scenes` run with the usual settings, all others on little, for a few steps: `RUNS`. Each runs on one
worker, in an order in which later ones find what earlier ones made. An output is known by the name of its stage on the map; one
whose name is gone is looked for by its digests, and is reported as renamed. Digests are those of one kind of machine.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))  # to run without PYTHONPATH

from benchmarks.pin_sources import written  # noqa: E402
from commands.run import Request  # noqa: E402
from commands.session import open_existing  # noqa: E402
from commands.store import plan_request  # noqa: E402
from commands.targets import use  # noqa: E402
from pipeline import TARGETS, build  # noqa: E402
from runner import Runner  # noqa: E402
from runner.keys import machine_kind  # noqa: E402

PINNED = Path(__file__).with_name("pinned_outputs.json")
Outputs = dict[str, dict[str, str]]
"""stage -> shard -> digest of its output"""
Changes = Mapping[str, Any]
""""stage.field" -> value"""

STILLS: Changes = {
    "train_plan.rooms": 2, "train_plan.val_rooms": 1, "train_plan.layouts": 1, "train_plan.views": 1, "train_plan.tasks": 3,
    "shift_plan.rooms": 0,
    "still_render.width_px": 228, "still_render.height_px": 128, "still_render.supersample": 1}  # fmt: skip
CASES: Changes = {"benchmark_plan.rooms": 1, "benchmark_plan.layouts": 2, "benchmark_plan.tasks": 3,
                  "still_render.width_px": 228, "still_render.height_px": 128, "still_render.supersample": 1}  # fmt: skip
TWOHANDS: Changes = {
    "model_train.steps": 20, "model_train.batch": 2, "model_train.warmup": 2, "model_train.validate_every": 10,
    "model_train.val_samples": 4, "model_train.height_px": 64, "model_train.width_px": 96}  # fmt: skip
SEQUENCES: Changes = {"interaction_plan.train": 4, "interaction_plan.val": 2, "interaction_render.height_px": 64,
                      "interaction_render.frames": 5, "interaction_render.supersample": 1}  # fmt: skip
SOR3D: Changes = {
    f"{stage}.{name}": value for stage in ("sor3d_train", "sor3d_pretrain")
    for name, value in {"steps": 20, "warmup": 2, "validate_every": 10, "batch": 2, "accumulate": 1, "height_px": 64,
                        "val_samples": 2}.items()}  # fmt: skip
BOXES: Changes = {"boxes_train.steps": 20, "boxes_train.warmup": 2, "boxes_train.validate_every": 10, "boxes_train.batch": 2,
                  "boxes_train.height_px": 64, "boxes_train.val_samples": 2}  # fmt: skip
OBJECTS: Changes = {
    "object_plan.categories": "screwdriver,soldering_iron", "object_plan.train_per_category": 1,
    "object_plan.val_per_category": 1, "object_plan.seen_per_category": 1, "object_plan.unseen_per_category": 1}  # fmt: skip
SURFACE: Changes = {
    "view_render.size_px": 96, "view_render.directions": 64, "view_render.most": 8,
    "scorer_train.steps": 20, "scorer_train.objects": 1, "scorer_train.candidates": 4, "scorer_train.warmup": 2,
    "scorer_train.validate_every": 10}  # fmt: skip
ADAPTED: Changes = {
    "view_render.size_px": 96, "view_render.directions": 64, "view_render.most": 8, "mesh_texture.procedural.side_px": 128,
    "body_tasks.points": 256, "body_tasks.hulls": 6, "body_evaluate.episodes": 1, "body_evaluate.at_once": 1,
    "body_evaluate.iterations": 20, "body_choose.options": 2, "body_choose.episodes": 1, "body_choose.iterations": 20,
    "body_adapt.worlds": 2, "body_adapt.bullet": 1, "body_adapt.generations": 2, "body_adapt.rounds": 2, "body_adapt.updates": 5,
    "body_adapt.iterations": 20, "grasp_record.width": 64, "grasp_record.height": 48, "grasp_record.supersample": 1}  # fmt: skip
"""a few episodes with the shipped models: settings of their trainings would train others"""
LESSONS: Changes = {
    "hand_plan.rooms": 1, "hand_plan.val_rooms": 1, "hand_lessons.pictures": 24, "hand_lessons.width_px": 144,
    "hand_lessons.height_px": 80, "hand_lessons.supersample": 1}  # fmt: skip
FINDER: Changes = {
    **LESSONS, "hands_train.steps": 20, "hands_train.batch": 2, "hands_train.width_px": 64, "hands_train.height_px": 32,
    "hands_train.warmup": 2, "hands_train.judged": 8, "hands_train.validate_every": 10}  # fmt: skip
HELD: Changes = {
    "held_train.steps": 20, "held_train.batch": 2, "held_train.size_px": 32, "held_train.warmup": 2, "held_train.judged": 8,
    "held_train.validate_every": 10}  # fmt: skip
SCHOOL: Changes = {
    **OBJECTS, "object_solids.points": 256, "object_solids.hulls": 8, "grasp_tasks.within_m": 1.0, "grasp_targets.places": 2,
    "hand_imitation.cloning": 3, "hand_imitation.alone": 1, "hand_imitation.worlds": 2, "hand_imitation.hidden": "16",
    "hand_imitation.proofs": 0, "rl_grasp_refinement.updates": 2, "rl_grasp_refinement.worlds": 2,
    "rl_grasp_refinement.iterations": 20, "grasp_evaluate.episodes": 1, "grasp_evaluate.iterations": 20, "grasp_evaluate.traces": 1,
    "grasp_two_tasks.rounds": 1, "grasp_two_tasks.iterations": 20, "grasp_two_tasks.width": 64, "grasp_two_tasks.height": 48,
    "grasp_two_tasks.supersample": 1, "grasp_record.width": 64, "grasp_record.height": 48,
    "grasp_record.supersample": 1}  # fmt: skip
HOUSEHOLD: Changes = {
    **{name: value for name, value in SCHOOL.items() if not name.startswith(("grasp_two_tasks", "grasp_evaluate"))},
    "household_plan.categories": "can,tube", "household_plan.per_category": 1,
    "household_plan.train_per_category": 1, "household_build.edge_m": 0.02,
    "household_tasks.uses": 1, "household_tasks.hulls": 4, "household_tasks.points": 256, "body_refinement.updates": 2,
    "body_refinement.family_worlds": 0, "body_refinement.iterations": 20,
    "body_evaluate.episodes": 1, "body_evaluate.iterations": 20,
    "household_shown.shown": 1}  # fmt: skip
PRIOR = ("object_plan", "object_solids", "grasp_tasks", "grasp_targets", "hand_imitation")
"""stages of SCHOOL that the target grasp-prior has as well"""
PROOF: Changes = {"human_motion.data": "synthetic", "clip_proof.proofs": 0}
FULL: Changes = {
    "grasp_student.rounds": 2, "grasp_student.worlds": 1, "grasp_student.updates": 10, "grasp_student.batch": 8,
    "grasp_student.views": 1, "grasp_student.size_px": 24, "grasp_student.points": 64, "imitation_evaluate.places": 1,
    "imitation_evaluate.iterations": 20, "positive_affordance_projection.points": 16,
    "grasp_report.rows": "teacher,no_negative,student,positive", "grasp_report.seeds": 1}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One run of a target."""

    target: str
    sets: Changes = field(default_factory=dict)
    """a value `source:NAME` is the folder of that source of `pin_sources.py`"""
    source: str = ""
    """name of the source that it reads"""
    options: tuple[str, ...] = ()


RUNS: dict[str, Run] = {
    "dataset": Run("dataset"),
    "recordings": Run("recordings"),
    "scenes": Run("scenes"),
    "extraction-report": Run("extraction-report", {"extraction_report.standard_clips": 1, "extraction_report.hard_clips": 1,
                                                   "scene_render.supersample": 1}),
    "train-set": Run("train-set", STILLS),
    "benchmark-set": Run("benchmark-set", CASES),
    "train": Run("train", {**STILLS, **TWOHANDS}),
    "benchmark": Run("benchmark", {**STILLS, **CASES, **TWOHANDS, "benchmark.resamples": 50}),
    "ablation": Run("ablation", {**STILLS, **CASES, **TWOHANDS, "ablation_report.rows": "full,k1", "ablation_report.seeds": 1,
                                 "ablation_report.steps": 20}),
    "hands": Run("hands", FINDER),
    "held": Run("held", {**LESSONS, **HELD}),
    "negative-affordance": Run("negative-affordance", {**OBJECTS, **SURFACE}),
    "motions": Run("motions", {"motion_retarget.min_s": 0.0, "motion_retarget.max_error_m": 1.0}, source="motion"),
    "grasp": Run("grasp", SCHOOL),
    "grasp-full": Run("grasp-full", {**SCHOOL, **FULL, **SURFACE, **STILLS, **TWOHANDS}, options=("--minutes", "inf")),
    "grasp-play": Run("grasp-play", {name: value for name, value in SCHOOL.items() if "two_tasks" not in name}),
    "grasp-adapt": Run("grasp-adapt", ADAPTED, source="mesh"),
    "grasp-household": Run("grasp-household", HOUSEHOLD),
    "grasp-prior": Run("grasp-prior", {**{name: value for name, value in SCHOOL.items() if name.startswith(PRIOR)}, **PROOF},
                       source="motion"),
    "interactions": Run("interactions", SEQUENCES),
    "sor3d": Run("sor3d", {**SEQUENCES, **SOR3D, "sor3d_report.pretrained": "true", "sor3d_report.resamples": 20,
                           "sor3d_evaluate.shown": 1, "interaction_record.shown": 1}),
    "sor3d-ablation": Run("sor3d-ablation", {
        **SEQUENCES, **SOR3D, "sor3d_report.rows": "rgb,rgbd_attention_flow3d,pretrained", "sor3d_report.seeds": 1,
        "sor3d_report.resamples": 20, "sor3d_evaluate.shown": 1}, options=("--minutes", "inf")),
    "static-sets": Run("static-sets", {**SEQUENCES, **{name: value for name, value in SOR3D.items() if "sor3d_train" in name},
                                       **BOXES, "static_evaluate.shown": 2}),
    "recordings of a bare video": Run("recordings", FINDER, source="video"),
    "negative-affordance of a mesh": Run("negative-affordance", {
        **OBJECTS, **SURFACE, "mesh_texture.procedural.side_px": 128}, source="mesh"),
    "sor3d after actions": Run("sor3d", {
        **SEQUENCES, **SOR3D, "sor3d_report.pretrained": "true", "sor3d_report.actions": "source:actions",
        "action_read.size_px": 32, "action_pack.val_share": 0.5, "sor3d_report.resamples": 20, "sor3d_evaluate.shown": 1,
        "interaction_record.shown": 1}),
    "static-sets of pictures": Run("static-sets", {
        **SEQUENCES, **{name: value for name, value in SOR3D.items() if "sor3d_train" in name}, **BOXES, "static_evaluate.shown": 2,
        "static_read.backend": "iit-aff", "static_read.crop_px": 32}, source="pictures"),
}  # fmt: skip
"""name -> the run; the settings of every stage stand here and nowhere else"""


def request(run: Run, store: Path) -> Request:
    """Return the command-line request of a run, with its sources written below the store."""
    below = store / "pinned-sources"

    def text(value: Any) -> str:
        kind, colon, name = str(value).partition(":")
        return str(written(name, below)) if colon and kind == "source" else str(value)

    sets = tuple(f"{name}={text(value)}" for name, value in run.sets.items())
    return Request(run.target, written(run.source, below) if run.source else None, sets=sets, store=store)


def make(run: Run, store: Path) -> float:
    """Make the target of a run, in a process of its own; seconds that it took. SystemExit where it fails."""
    asked, began = request(run, store), time.monotonic()
    source = [f"--source={asked.source}"] if asked.source else []
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONHASHSEED"}
    command = [sys.executable, "pipeline.py", "run", run.target, *source, *(f"--set={word}" for word in asked.sets), *run.options,
               f"--store={store}", "--jobs=1"]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{run.target}: the run failed:\n{done.stderr}")
    return time.monotonic() - began


def outputs(run: Run, store: Path) -> Outputs:
    """Return the digests of all outputs of a run, by stage in the order of the graph. Raises SystemExit when one is missing."""
    found: Outputs = {}
    for plan in plan_request(request(run, store)):
        if plan.status != "cached":
            raise SystemExit(f"{run.target}: {plan.stage} {plan.shard} is {plan.status} after the run: {plan.reason}")
        found.setdefault(plan.stage, {})[plan.shard] = plan.output
    return {stage: dict(sorted(shards.items())) for stage, shards in found.items()}


SCHEMAS = ("its metadata `provenance` holds the name of the stage, the name of the schema and its version, which is a digest of "
           "the names and types of its fields, and the digest of what it shows")  # fmt: skip
JOB = "card.md shows the fields of the training's job, which are named in code"
PAGES = "its report names the page docs/twohands/benchmark.md"
VERB = "README.md and croissant.json say `pipeline.py lineage DIGEST`"
NAMES_CODE: dict[str, str] = {
    **dict.fromkeys((f"record_{stage}" for stage in (
        "source_read", "hand_detect", "frame_decode", "mask_densify", "hand_inpaint", "object_completion", "affordance_intersect",
        "narration_labelling", "sample_assemble", "model_train", "sor3d_train", "sor3d_pretrain", "boxes_train",
        "extraction_report", "negative_affordance_report", "motion_files",
        "grasp_report", "household_report", "sor3d_report", "static_sor3d", "static_boxes", "static_true_boxes", "static_report",
        "hands_train", "held_train", "scorer_train", "hand_imitation", "rl_grasp_refinement", "grasp_student", "motion_read",
        "motion_synthesise", "positive_affordance_projection", "train_pack")), SCHEMAS),
    **dict.fromkeys(("clip_record", "object_record", "grasp_record", "grasp_record_bullet", "grasp_record_mujoco",
                     "interaction_record"), SCHEMAS),
    "dataset_pack": VERB, "train_pack": VERB, "record_dataset_pack": f"{SCHEMAS}; {VERB}",
    "benchmark": PAGES, "ablation_report": PAGES, "record_benchmark": f"{SCHEMAS}; {PAGES}",
    "record_ablation_report": f"{SCHEMAS}; {PAGES}",
    "model_train": f"{JOB}; that of the two-hand model also says `from afford.twohands.model.predictor import Predictor`",
    "pretrained_sor3d_train": JOB, "sor3d_train": JOB, "sor3d_pretrain": JOB, "boxes_train": JOB,
    **dict.fromkeys(("static_sor3d", "static_boxes", "static_true_boxes", "static_report"),
                    "its report is called as the stage is on the map"),
}  # fmt: skip
"""stage -> what its output says about code; where this changes, its digest does, and nothing else of it may"""


@dataclass
class Difference:
    """Difference between two runs of a target."""

    equal: int = 0
    different: list[str] = field(default_factory=list)
    renamed: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Counts, and a line for every stage that differs."""
        lines = [f"{self.equal} equal, {len(self.different)} stages different, {len(self.renamed)} renamed"]
        return "\n".join([*lines, *(f"    renamed    {one}" for one in self.renamed),
                          *(f"    different  {one}{self._note(one)}" for one in self.different)])  # fmt: skip

    def _note(self, one: str) -> str:
        return " [names code]" if one.partition(":")[0] in NAMES_CODE else ""


def compare(before: Outputs, now: Outputs, describe: Callable[[str, str], str] = lambda before, now: "") -> Difference:
    """Compare stages by name, or by the digests of their outputs where a name is gone; `describe` describes a difference."""
    found = Difference()
    for stage in before.keys() & now.keys():
        found.equal += sum(now[stage].get(shard) == digest for shard, digest in before[stage].items())
    found.different = [f"{stage}: {changed(before[stage], now[stage], describe)}" for stage in before
                       if stage in now and before[stage] != now[stage]]  # fmt: skip
    gone, new = [stage for stage in before if stage not in now], [stage for stage in now if stage not in before]
    for stage in gone:
        same = next((name for name in new if sorted(now[name].values()) == sorted(before[stage].values())), None)
        if same is None:
            found.different.append(f"{stage}: gone")
            continue
        new.remove(same)
        found.equal += len(before[stage])
        found.renamed.append(f"{stage} -> {same}")
    found.different += [f"{stage}: new" for stage in new]
    return found


def changed(before: Mapping[str, str], now: Mapping[str, str], describe: Callable[[str, str], str]) -> str:
    """Describe the shards in which a stage differs, and the difference of the first one."""
    if sorted(before.values()) == sorted(now.values()):
        return "the same outputs under other names of shards"
    differ = [shard for shard in {**before, **now} if before.get(shard) != now.get(shard)]
    first = next((describe(before[shard], now[shard]) for shard in differ if shard in before and shard in now), "")
    shown = ", ".join(shard or "its one output" for shard in differ[:4])
    return f"{len(differ)} of {len({**before, **now})}: {shown}{' ...' if differ[4:] else ''}{first and f' ({first})'}"


def by_file(store: Path, old: Path | None) -> Callable[[str, str], str]:
    """Describe the difference of two outputs by their files, where the store of the pinned outputs exists."""
    if old is None:
        return lambda before, now: ""
    here, there = open_existing(store), open_existing(old)

    def describe(before: str, now: str) -> str:
        was, is_now = blobs(there, before), blobs(here, now)
        differ = [name for name in {**was, **is_now} if was.get(name) != is_now.get(name)]
        return f"{len(differ)} of {len(is_now)} files: {', '.join(differ[:4])}{' ...' if differ[4:] else ''}"

    return describe


def blobs(runner: Runner, digest: str) -> dict[str, str]:
    """name -> digest of every file of an artifact and of its parts."""
    parts = runner.children(digest)
    if parts is None:
        return {entry.name: entry.blob for entry in runner.store.manifest(digest).files}
    return {f"{part}/{name}": blob for part, inner in parts for name, blob in blobs(runner, inner).items()}


def pinned() -> dict[str, Any]:
    """Return the pinned digests; empty without a file."""
    return json.loads(PINNED.read_text()) if PINNED.exists() else {"targets": {}}


def write(found: Mapping[str, Outputs]) -> None:
    """Pin what was found, beside what is pinned of other runs."""
    before = pinned()["targets"]
    rows = {name: {"target": run.target, "source": run.source, "settings": dict(run.sets), "outputs": found[name]}
            if name in found else before[name] for name, run in RUNS.items() if name in found or name in before}  # fmt: skip
    tree = {"machine": machine_kind(), "names_code": NAMES_CODE, "targets": rows}
    PINNED.write_text(json.dumps(tree, indent=1) + "\n")


def asked(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    use(TARGETS, build)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="pin what is made; default: compare it with what is pinned")
    parser.add_argument("--store", type=Path, default=ROOT / "artifacts" / "pinned", help="where the runs keep what they make")
    parser.add_argument("--old", type=Path, help="store of the pinned outputs: files that differ are named")
    parser.add_argument("--only", default=",".join(RUNS), help="names of runs, with commas")
    found = parser.parse_args(argv)
    found.names = found.only.split(",")
    if unknown := [name for name in found.names if name not in RUNS]:
        parser.error(f"--only {','.join(unknown)}: expected some of {', '.join(RUNS)}")
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the targets; pin what they made, or compare it with what is pinned."""
    options = asked(argv)
    use(TARGETS, build)
    store, before, good = options.store.absolute(), pinned()["targets"], True
    for name in options.names:
        seconds = make(RUNS[name], store)
        found = outputs(RUNS[name], store)
        if options.write:
            write({name: found})
            text = f"{sum(len(shards) for shards in found.values())} outputs of {len(found)} stages"
        else:
            result = compare(before[name]["outputs"] if name in before else {}, found, by_file(store, options.old))
            text, good = result.text(), good and not result.different
        print(f"{name:<30} {seconds:7.1f} s  {text}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
