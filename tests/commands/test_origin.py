"""Origin of a run's data, and its name."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands.errors import UsageError
from commands.origin import OWN_ROOMS, origin
from maps.settings import Origin, Settings
from pipeline import build


@pytest.mark.parametrize("target", ["grasp", "grasp-full"])
def test_grasping_reads_no_source(target: str, tmp_path: Path) -> None:
    """Its objects are built in: a folder would only name the run."""
    with pytest.raises(UsageError, match=f"--source .*{target} .*reads no source"):
        origin(target, tmp_path, Settings(), lambda path: "")


def test_targets_do_not_overwrite_what_others_publish() -> None:
    """Targets with their own data have distinct names, which differ from that of the rendered clips."""
    names = {target: origin(target, None, Settings(), lambda path: "")[0].name for target in ("grasp", "grasp-full", "dataset")}
    assert names == {"grasp": "grasp", "grasp-full": "grasp-full", "dataset": "synthetic"}
    assert len(set(OWN_ROOMS.values())) == len(OWN_ROOMS)


@pytest.mark.parametrize("target", ["grasp", "grasp-full"])
def test_trainings_do_not_depend_on_the_name_of_the_run(target: str) -> None:
    """A training under another name is cached: no stage, parameter or leaf contains the name."""
    one, other = (build(target, Origin(name), Settings()).nodes for name in ("synthetic", target))
    shown = [[(node.sort, node.name, node.inputs, node.value, node.params) for node in nodes] for nodes in (one, other)]
    assert shown[0] == shown[1]
