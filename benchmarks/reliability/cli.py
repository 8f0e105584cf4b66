"""2: the command line on a tiny source: kills, signals, rot during a run, and damaged caches of compiled kernels."""

from __future__ import annotations

import json
import random
import shutil
import signal
import time

from benchmarks.reliability import toy
from benchmarks.reliability.commands import END_S, Tiny
from benchmarks.reliability.disk import cannot_mount, mounted, remount
from benchmarks.reliability.rotten import Damaging, paths
from benchmarks.reliability.rows import Plan, Row, skipped
from benchmarks.reliability.signals import WAYS, send
from tests.helpers.flipped_stores import NoEndError, apart, damage, last_line

FREE_KIB = (3000, 1000, 2000, 4000, 5000, 6000, 7000, 8000)
"""of disks that are too small for a run, but the last ones"""
ROOM = 200 * 1024
"""KiB of a disk that is large enough"""
KERNELS = ("--force", "mask_densify", "--force", "hand_inpaint")
"""stages that run compiled kernels"""
SHORT = ("SIGINT once", "SIGTERM")
"""ways to stop that a quick run tries"""
STOPPED = (130, 143)
"""exit codes of a run that was stopped, as a shell shows them"""


def rows(plan: Plan) -> list[Row]:
    """Run the tests on copies of one finished store, or on a new one."""
    clean = Tiny(plan.place("clean")).write()
    wrong = clean.run()
    if wrong:
        return [Row("run dataset on a tiny source", tried=1, failures=wrong)]
    stopped = [_stopped(plan, clean, what) for what in WAYS if not plan.quick or what in SHORT]
    return [_killed(plan, clean), *stopped, _full(plan, clean), _rotten(plan, clean), _kernels(plan, clean)]


def _killed(plan: Plan, clean: Tiny) -> Row:
    """One store, killed again and again."""
    row, rng, kept = Row("kill -9 of `run dataset` with its workers"), random.Random(f"{plan.seed} cli"), 0
    tiny = Tiny(plan.place("killed")).write(clean)
    for _ in range(plan.times(12, 2)):
        process = tiny.start()
        time.sleep(rng.uniform(0.3, 3.0))
        toy.kill({process.pid, *toy.descendants(process.pid)})
        process.communicate()
        row.count([f"{kept - tiny.traces()} traces lost"] if tiny.traces() < kept else [])
        kept = tiny.traces()
    wrong = tiny.run()
    if tiny.published() != clean.published():
        wrong.append("published files differ from those of a clean store")
    row.count(wrong)
    row.figures = f"{kept} of {tiny.traces()} tasks were finished before the last run"
    return row


def _stopped(plan: Plan, clean: Tiny, what: str) -> Row:
    row = Row(f"{what}: `run dataset` ends with exit 130 or 143, without a traceback or a process that is left")
    tiny = Tiny(plan.place(what)).write(clean)
    process = tiny.start()
    time.sleep(random.Random(f"{plan.seed} {what}").uniform(0.5, 2.0))
    pids = toy.descendants(process.pid)
    send(process, WAYS[what])
    _, message = process.communicate(timeout=60)
    code = process.returncode if process.returncode >= 0 else 128 - process.returncode
    wrong = [] if code in STOPPED else [f"exit {code}"]
    wrong += ["a traceback"] if "Traceback" in message else []
    left = toy.left_after(pids)
    toy.kill(left)
    wrong += [f"{len(left)} processes are left"] if left else []
    saved = [path.name for path in (tiny.store / "scratch").glob("save-*")]
    wrong += [f"scratch folders are left: {', '.join(saved)}"] if WAYS[what] == (signal.SIGTERM,) and saved else []
    row.count(wrong + tiny.run() + ([] if tiny.published() == clean.published() else ["published files differ"]))
    return row


def _full(plan: Plan, clean: Tiny) -> Row:
    """Run with space for the compiled kernels and a little more."""
    row = Row("full disk: `run dataset` ends with one sentence; with more space it goes on")
    if reason := cannot_mount(plan.place("probe")):
        return skipped(row.what, reason)
    for n, kib in enumerate(FREE_KIB[: plan.times(len(FREE_KIB), 1)]):
        tiny = Tiny(plan.place(f"full-{kib}"))
        with mounted(tiny.store, f"size={ROOM}k"):
            tiny.write(clean)
            used = ROOM - shutil.disk_usage(tiny.store).free // 1024
            remount(tiny.store, f"size={used + kib}k")
            process = tiny.start(jobs=2 * (n % 2))
            _, message = process.communicate(timeout=END_S)
            wrong = [] if process.returncode in (0, 1) else [f"exit {process.returncode}"]
            wrong += [f"a traceback: {message.splitlines()[-1]}"] if "Traceback" in message else []
            wrong += [] if process.returncode == 0 or "space" in message else [f"unclear: {message[-200:]}"]
            remount(tiny.store, f"size={ROOM}k")
            wrong += tiny.run() + ([] if tiny.published() == clean.published() else ["published files differ"])
        row.count([f"{kib} KiB free, jobs {2 * (n % 2)}: {what}" for what in wrong])
    return row


def _rotten(plan: Plan, clean: Tiny) -> Row:
    row = Row("a blob that dataset_pack reads rots after the check: the data set is there afterwards")
    for n in range(plan.times(3, 1)):
        tiny = clean.copy(plan.folder / "rotten")
        try:
            row.count(apart(_packed, tiny, random.Random(f"{plan.seed} pack {n}"), limit_s=120.0))
        except (NoEndError, RuntimeError) as error:
            row.count([last_line(error)])
    return row


def _packed(tiny: Tiny, rng: random.Random) -> list[str]:
    """Return the faults of a run whose consumer meets damage."""
    from commands.origin import origin
    from commands.session import digester, open_runner
    from maps.settings import Settings
    from pipeline import build

    runner, settings = open_runner(tiny.store, 2), Settings()
    place, _ = origin("dataset", tiny.source, settings, digester(runner), ())
    graph = build("dataset", place, settings)
    before = runner.run(graph, "dataset").outputs
    samples = [plan.output for plan in runner.explain(graph, "dataset", stage="sample_assemble")]
    hurt = Damaging("dataset_pack", [rng.choice([path for digest in samples for path in paths(runner, digest)])], "flip", rng)
    report = open_runner(tiny.store, 2).run(graph, "dataset", force=["dataset_pack"], observer=hurt)
    wrong = [] if report.ok else [f"failed: {json.dumps([failure.message for failure in report.failures])}"]
    missing = [stage for stage, made in before.items() if report.outputs.get(stage) != made]
    return wrong + ([f"outputs differ: {', '.join(missing)}, ok={report.ok}"] if missing else [])


def _kernels(plan: Plan, clean: Tiny) -> Row:
    """Flip one bit each in machine code and in its index."""
    row = Row("one bit flipped in a compiled kernel (.nbc, .nbi): the next run and the one after are right")
    rng = random.Random(f"{plan.seed} kernels")
    tiny, backup, expected = clean.copy(plan.folder / "kernels"), plan.folder / "numba", clean.published()
    shutil.copytree(tiny.store / ".cache" / "numba", backup)
    for n in range(plan.times(40, 1)):
        shutil.rmtree(tiny.store / ".cache" / "numba")
        shutil.copytree(backup, tiny.store / ".cache" / "numba")
        files = sorted(path for path in backup.rglob("*.nb?") if path.suffix == (".nbc", ".nbi")[n % 2])
        hit = rng.choice(files)
        message = damage(tiny.store / ".cache" / "numba" / hit.relative_to(backup), "flip", rng)
        wrong = tiny.run(*KERNELS, jobs=1)
        wrong += [f"run after it: {what}" for what in tiny.run(*KERNELS, jobs=1)] if wrong else []
        row.count([f"{message}: {what}" for what in wrong + ([] if tiny.published() == expected else ["published files differ"])])
    return row
