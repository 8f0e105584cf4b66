"""Robot hands from URDF: fingers, mimic joints, meshes, and one-sentence errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.common.errors import SourceError
from afford.grasping.hand import assets, export
from afford.grasping.hand.link_meshes import shape_mesh
from afford.grasping.hand.tree import Tree
from schemas.files import FileTree
from stages.grasping import hand_model
from tests.helpers.made_hands import JOINT, LINK, PINCER, hand_of, read_text, written
from tests.helpers.mesh_files import box


def test_a_hand_without_fingertip_frames(tmp_path: Path) -> None:
    """The fingertip is the farthest corner of the last link; two knuckles are base and middle."""
    hand = hand_of(written(tmp_path, PINCER))
    assert (hand.fingers.name, hand.links[hand.palm], hand.side) == (("thumb", "index"), "palm", "right")
    assert [hand.links[k] for k in (*hand.fingers.base_link, *hand.fingers.middle_link)] == ["thumb", "index_a", "thumb", "index_a"]
    np.testing.assert_allclose(np.abs(hand.fingers.tip_m), [[0.005, 0.005, 0.04]] * 2)
    np.testing.assert_allclose(hand.R_palm_grip[:, 2], [0, 0, 1], atol=0.2)


def test_written_urdf_reads_back(tmp_path: Path) -> None:
    """Reading and writing again gives the same text."""
    tree = read_text(PINCER)
    text = export.urdf_text(tree)
    again = read_text(text)
    first, second = (export.urdf_text(Tree("hand", one.links, one.joints, {})) for one in (tree, again))
    assert first == second
    assert again.joints[0].axis == (0.0, -1.0, 0.0)  # made a unit vector


def test_mimic_joints(tmp_path: Path) -> None:
    """Ratio and offset are read."""
    text = PINCER.replace('<parent link="index_a"/>', '<parent link="index_a"/><mimic joint="a" multiplier="0.5" offset="0.1"/>')
    joints = hand_of(written(tmp_path, text), wrist="none").joints
    k = joints.name.index("b")
    assert (joints.role[k], joints.name[joints.driver[k]], joints.ratio[k], joints.offset[k]) == ("coupled", "a", 0.5, 0.1)


def test_a_capsule_in_parts_has_the_same_bounds() -> None:
    """The cylinder and the spheres together have the bounds of the capsule."""
    from afford.grasping.hand.tree import Shape

    T = np.eye(4)
    T[:3, 3] = 0.1, 0.2, 0.3
    whole = Shape("capsule", (0.01, 0.04), T)
    nothing = Tree("", (), (), {})
    boxes = np.stack([shape_mesh(part, nothing).bounds for part in export.split_capsule(whole)])
    np.testing.assert_allclose([boxes[:, 0].min(0), boxes[:, 1].max(0)], shape_mesh(whole, nothing).bounds, atol=1e-9)


PARENT = '<parent link="index_a"/>'
LIMIT = '<limit lower="0" upper="1.5" effort="1" velocity="2"/>'
MESH = '<mesh filename="meshes/gone.stl"/>'
BROKEN = {
    "cut short": (PINCER[:300], "expected XML"),
    "another format": ("<mujoco/>", "expected a <robot> element, got <mujoco>"),
    "no limit": (PINCER.replace(LIMIT, "", 1), "joint 't': expected a <limit> with lower, upper, effort and velocity, got no"),
    "limits swapped": (PINCER.replace('upper="1.5"', 'upper="-1"', 1), "joint 't': expected lower < upper"),
    "limit is no number": (PINCER.replace('upper="1.5"', 'upper="wide"', 1), "expected 1 numbers, got 'wide'"),
    "mesh missing": (PINCER.replace('<box size="0.01 0.01 0.04"/>', MESH, 1), "expected the file 'meshes/gone.stl'"),
    "mesh outside": (PINCER.replace('<box size="0.01 0.01 0.04"/>', MESH.replace("meshes", "../.."), 1), "files inside the source"),
    "shape of no size": (PINCER.replace("0.01 0.01 0.04", "0 0.01 0.04", 1), "<box>: expected sizes above zero"),
    "circle": (PINCER.replace('<parent link="index_a"/>', '<parent link="index_b"/>'), "a circle through link 'index_b'"),
    "nothing but a circle": (PINCER.replace("</robot>", JOINT.format("c", "index_b", "palm", "0 0 0", "1 0 0", "0 0 0")
                                            + "</robot>"), "a circle through link 'palm'"),
    "two roots": (PINCER.replace("</robot>", '<link name="lost"/></robot>'), "expected one root link, got palm and lost"),
    "two parents": (PINCER.replace('<child link="index_a"/>', '<child link="thumb"/>'), "expected every carried link once"),
    "unknown link": (PINCER.replace('<parent link="index_a"/>', '<parent link="index_z"/>'), "a joint of 'index_z'"),
    "no links": ("<robot name='x'/>", "expected one root link, got no links"),
    "joint that never ends": (PINCER.replace('type="revolute"', 'type="continuous"', 1), "expected a joint that is revolute"),
    "no axis": (PINCER.replace('xyz="0 -2 0"', 'xyz="0 0 0"'), "expected an axis with a direction"),
    "no mass": (PINCER.replace('<mass value="0.1"/>', '<mass value="0"/>'), "link 'thumb': expected a mass above zero"),
    "follows nothing": (PINCER.replace(PARENT, PARENT + '<mimic joint="z"/>'), "joint 'b': expected to"),
    "no thumb": (PINCER.replace('"thumb"', '"digit"'), "expected a thumb and another finger"),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_errors_of_broken_urdfs(what: str, tmp_path: Path) -> None:
    """The sentence names the file or hand, the expected and the actual value, and the remedy."""
    text, message = BROKEN[what]
    assert text != PINCER
    with pytest.raises(SourceError) as error:
        hand_of(written(tmp_path, text))
    assert message in str(error.value) and "\n" not in str(error.value) and "; " in str(error.value)


@pytest.mark.parametrize(("params", "message"), [
    ({"wrist": "none", "root": "index_a"}, "root: expected a link that carries the palm: arm, palm"),
    ({"coupled": ("a=lift",), "fingers": ("thumb=thumb", "index=index_b")}, "to follow a joint beyond the root 'palm'"),
    ({"fingers": ("thumb=nail",)}, "expected FINGER=LINK"),
    ({"coupled": ("b=z",)}, "expected follower=driver"), ({"coupled": ("b=a", "a=b")}, "to follow a joint with a motor"),
    ({"wrist": "strap"}, "wrist: expected gantry or none, got 'strap'"),
    ({"reach_m": 0.0}, "reach_m: expected a number above zero")])
def test_invalid_parameters(params: dict[str, object], message: str, tmp_path: Path) -> None:
    """Parameters are checked like files."""
    lift = LINK.format("arm") + JOINT.format("lift", "arm", "palm", "0 0 0", "0 0 1", "0 0 0")
    with pytest.raises(ValueError, match=message):
        hand_of(written(tmp_path, PINCER.replace("</robot>", lift + "</robot>")), **params)


def test_names_of_mesh_copies(tmp_path: Path) -> None:
    """Copies are numbered by file and scale; names with the same prefix up to a dot count together."""
    (tmp_path / "meshes").mkdir()
    for name in ("a.b", "a"):
        box().export(tmp_path / "meshes" / f"{name}.stl")
    drawn = "".join(f'<visual><geometry><mesh filename="meshes/{name}.stl" scale="{scale} 1 1"/></geometry></visual>'
                    for name, scale in (("a.b", 1), ("a", 1), ("a.b", 2), ("a.b", 1), ("a", 3)))  # fmt: skip
    hand = hand_of(written(tmp_path, PINCER.replace('<link name="palm">', '<link name="palm">' + drawn)))
    assert {mesh.file for mesh in hand.meshes} == {"meshes/a.b.obj", "meshes/a.1.obj", "meshes/a.b.1.obj", "meshes/a.3.obj"}


def test_several_urdfs_are_rejected(tmp_path: Path) -> None:
    """A folder contains one hand."""
    (tmp_path / "other.urdf").write_text(PINCER)
    with pytest.raises(SourceError, match=r"expected one URDF, got hand\.urdf, other\.urdf"):
        hand_of(written(tmp_path, PINCER))


def test_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to install the package of the Shadow Hand."""
    monkeypatch.setattr(assets, "PACKAGE", "gymnasium-robotics-that-is-not-there")
    with pytest.raises(SourceError, match="pip install"):
        assets.shadow_files()


def test_other_files_than_the_shadow_hand() -> None:
    """MuJoCo's message is passed on in one line."""
    with pytest.raises(SourceError, match="expected an MJCF that MuJoCo compiles") as error:
        hand_model.run(FileTree("nothing", ()), hand_model.Params())
    assert "\n" not in str(error.value)
