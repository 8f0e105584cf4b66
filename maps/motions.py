"""From recorded motion of people's hands to what a robot hand can imitate, one line per stage."""

from __future__ import annotations

from maps.grasps import hand
from maps.recording import record_run
from maps.settings import Origin, Settings
from runner import Graph
from schemas.files import FileTree
from stages.grasping import hand_retarget, motion_files, motion_read, motion_report


def motions(g: Graph, origin: Origin, p: Settings) -> None:
    """recorded motion of hands in the joints of a robot hand, and what was dropped, and why"""
    model   = hand(g, p)
    files   = origin.motions or FileTree(origin.name, ())
    motion  = g.each(g.first(g.add(motion_read.run, files=g.leaf("motions", files), params=p.motion_read)))
    clip    = g.named("motion_retarget").add(
                hand_retarget.run,          motion=motion,   hand=model,                             params=p.motion_retarget)
    found   = g.add(motion_report.run,      clips=g.collect(clip),                                   params=p.motion_report)
    made    = g.add(motion_files.run,       references=found,        params=motion_files.Params(origin.name), ctx=g.ctx)
    g.target("motions", made, record_run(g, "motion_files", made))
