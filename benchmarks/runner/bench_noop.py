"""Measure a run with nothing to do, N shards through three stages of 10 kB, and a cold run, against peers in the same rounds.

PYTHONPATH=. python benchmarks/runner/bench_noop.py [--shards 1000] [--venvs DIR] [--quick]
"""

from __future__ import annotations

import sys

from benchmarks.runner import peers
from benchmarks.runner.measure import in_turns, spent
from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project

FEW = 100
"""shards for peers that need minutes for more"""
AIM_S = 0.12


def rows(plan: Plan) -> list[Row]:
    """Our run against doit, then one row a peer."""
    found = [peers.installed(peer, plan.venvs) for peer in peers.PEERS]
    left_out = [Row(f"{peer.name}", "", why) for peer, (_, why) in zip(peers.PEERS, found, strict=True) if why]
    large, few = _round(plan, found, plan.shards, True), _round(plan, found, min(FEW, plan.shards), False)
    start = in_turns({"start": lambda: spent([sys.executable, "-c", "pass"], plan.folder).cpu_s}, plan.rounds)["start"]
    return [_goal(plan.shards, large, start), *_table(plan.shards, large), *_table(min(FEW, plan.shards), few), *left_out]


def _round(plan: Plan, found: list, shards: int, large: bool) -> dict[str, tuple[float, float]]:
    """(cold, nothing to do) in CPU seconds of ours and of every peer of a class, by name."""
    ours = Project(plan.place(f"ours-{shards}-{large}"), shards).write()
    theirs = {peer.name: peers.Project(peer, plan.place(f"{peer.name}-{shards}-{large}"), home).write(shards)
              for peer, (home, _) in zip(peers.PEERS, found, strict=True) if home and peer.large == large}  # fmt: skip
    cold = {"ours": ours.cpu_s("run")} | {name: one.cpu_s() for name, one in theirs.items()}
    idle = in_turns({"ours": lambda: ours.cpu_s("run")} | {name: one.cpu_s for name, one in theirs.items()}, plan.rounds)
    return {name: (cold[name], idle[name]) for name in cold}


def _goal(shards: int, large: dict[str, tuple[float, float]], start: float) -> Row:
    ours, doit = large["ours"][1], large.get("doit", (0.0, 0.0))[1]
    measured = f"{ours:.3f} s" + (f", doit {doit:.3f} s" if doit else ", doit not measured")
    return Row(f"nothing to do, 3 stages x {shards:,} shards of 10 kB", f"less than doit in the same rounds (aim: {AIM_S} s)",
               measured, ours < doit if doit else None, {"ours_s": ours, "doit_s": doit, "python_s": start},
               f"starting Python alone: {start:.3f} s. doit restores nothing and verifies nothing")  # fmt: skip


def _table(shards: int, found: dict[str, tuple[float, float]]) -> list[Row]:
    """One row for each, the cheapest first."""
    names = {peer.name: f"{peer.requirement.replace('==', ' ')}, {peer.kind}" for peer in peers.PEERS}
    names["ours"] = "this runner, two workers"
    return [Row(f"{shards:,} shards: {names[name]}", "",
                f"nothing to do {idle:.3f} s, cold {1000 * cold / (3 * shards):.2f} ms a task",
                figures={"cold_s": cold, "idle_s": idle})
            for name, (cold, idle) in sorted(found.items(), key=lambda one: one[1][1])]  # fmt: skip


if __name__ == "__main__":
    sys.exit(measure("noop", rows, __doc__))
