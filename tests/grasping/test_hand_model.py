"""The built Shadow Hand: joints, limits, masses, shapes and palm axes equal those of its source."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import mujoco
import numpy as np
import pytest

from afford.codecs import CODEC
from afford.grasping.hand import Urdf, mjcf, read_urdf
from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.export import save_hand
from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, moving_joints, points_on_links
from stages.grasping import hand_model
from tests.helpers.made_hands import read_text, shadow, tree


@pytest.fixture(scope="module")
def source() -> mujoco.MjModel:
    return mjcf.compile_hand(shadow_files())


def test_number_of_joints() -> None:
    """AffordDex: 6 of the wrist, 22 of the fingers, of which 18 have a motor and 4 follow the joint before them."""
    joints = shadow().joints
    assert [joints.role.count(role) for role in ("wrist", "actuated", "coupled", "fixed")] == [6, 18, 4, 0]
    pairs = {joints.name[k]: joints.name[joints.driver[k]] for k, role in enumerate(joints.role) if role == "coupled"}
    assert pairs == {f"{finger}J0": f"{finger}J1" for finger in ("FF", "MF", "RF", "LF")}
    per_finger = {short: sum(n.startswith(short) and r == "actuated" for n, r in zip(joints.name, joints.role, strict=True))
                  for short in ("TH", "FF", "MF", "RF", "LF")}
    assert per_finger == {"TH": 5, "FF": 3, "MF": 3, "RF": 3, "LF": 4}


def test_limits_and_torques(source: mujoco.MjModel) -> None:
    """Values agree to the last bit, in the table and in the URDF."""
    joints = shadow().joints
    urdf = {joint.get("name"): joint.find("limit").attrib for joint in Xml.fromstring(shadow().urdf).findall("joint")}
    for k, name in enumerate(joints.name):
        assert (joints.lower[k], joints.upper[k]) == (float(urdf[name]["lower"]), float(urdf[name]["upper"]))
        if joints.role[k] == "wrist":
            continue
        assert [joints.lower[k], joints.upper[k]] == source.joint(f"robot0:{name}").range.tolist()
        if joints.role[k] == "actuated":
            assert joints.effort[k] == source.actuator_forcerange[source.actuator(f"robot0:A_{name}").id, 1]


def test_masses_and_inertia(source: mujoco.MjModel) -> None:
    """Links have a mass, the sum equals MuJoCo's subtree mass, and inertia is positive definite."""
    hand = shadow()
    palm = source.body("robot0:palm").id
    assert (hand.mass_kg > 0).all()
    assert hand.mass_kg[hand.palm:].sum() == pytest.approx(source.body_subtreemass[palm], abs=1e-12)
    for link in read_urdf_links(hand.urdf):
        assert np.linalg.eigvalsh(link.inertia_kgm2).min() > 0


def read_urdf_links(urdf: str) -> list[read_urdf.Link]:
    root = Xml.fromstring(urdf)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    return list(read_text(Xml.tostring(root, encoding="unicode")).links)


def test_collision_shapes(source: mujoco.MjModel) -> None:
    """18 boxes and capsules of the same volume; with `parts`, a cylinder and two spheres for each of 15 capsules."""
    links = read_urdf_links(shadow().urdf)
    found = sorted(volume(shape.kind, shape.size_m) for link in links for shape in link.collisions)
    palm = source.body("robot0:palm").id
    geoms = [g for g in range(source.ngeom) if source.geom_group[g] == mjcf.COLLIDES and source.geom_bodyid[g] >= palm]
    kinds = {int(mujoco.mjtGeom.mjGEOM_BOX): "box", int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule"}
    sizes = [(kinds[int(source.geom_type[g])], source.geom_size[g]) for g in geoms]
    wanted = sorted(volume(kind, 2 * s if kind == "box" else (s[0], 2 * s[1])) for kind, s in sizes)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    parts = [shape.kind for link in read_urdf_links(shadow(capsules="parts").urdf) for shape in link.collisions]
    assert [parts.count(kind) for kind in ("box", "cylinder", "sphere", "capsule")] == [3, 15, 30, 0]


def volume(kind: str, size: np.ndarray | tuple[float, ...]) -> float:
    if kind == "box":
        return float(np.prod(size))
    radius, length = size
    return float(np.pi * radius**2 * (length + 4 / 3 * radius))


def test_contact_pairs(source: mujoco.MjModel) -> None:
    """Pairs equal the <pair> elements; no link touches its own parent."""
    hand = shadow()
    found = {frozenset(hand.links[k] for k in pair) for pair in hand.contacts}
    wanted = {frozenset(source.body(int(source.geom_bodyid[g])).name.removeprefix("robot0:")
                        for g in (source.pair_geom1[p], source.pair_geom2[p])) for p in range(source.npair)}
    assert found == wanted
    parents = {frozenset(pair) for pair in zip(hand.joints.parent, hand.joints.child, strict=True)}
    assert not parents & {frozenset(pair) for pair in hand.contacts}


def test_side_and_palm_axes() -> None:
    """Palm axes equal the model's; bent fingers move out of the palm's side; the thumb opposes them."""
    hand = shadow()
    np.testing.assert_allclose(hand.R_palm_grip, np.eye(3), atol=1e-9)
    assert (hand.side, hand.links[hand.palm]) == ("right", "palm")
    still = np.clip(0.0, *joint_limits(hand.joints).T)
    bent = still.copy()
    for column, k in enumerate(moving_joints(hand.joints)):
        if hand.joints.name[k][2:] in ("J0", "J1", "J2") and not hand.joints.name[k].startswith("TH"):
            bent[column] = 0.8
        bent[column] = {"THJ4": 0.9, "THJ3": 1.2, "THJ1": 0.5}.get(hand.joints.name[k], bent[column])
    T = forward_kinematics(hand.joints, np.stack([still, bent]))
    open_tips, closed_tips = points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m)
    assert (closed_tips[1:, 1] < open_tips[1:, 1] - 0.05).all()
    assert np.linalg.norm(closed_tips[0] - closed_tips[1]) < 0.6 * np.linalg.norm(open_tips[0] - open_tips[1])


def test_links_of_keypoints() -> None:
    """Base joints where fingers leave the palm, middle joints one phalanx further (AffordDex, HTI)."""
    hand, fingers = shadow(), shadow().fingers
    assert fingers.name == ("thumb", "index", "middle", "ring", "little")
    names = [[hand.links[k] for k in links] for links in (fingers.base_link, fingers.middle_link, fingers.tip_link)]
    assert names[0] == ["thproximal", "ffproximal", "mfproximal", "rfproximal", "lfproximal"]
    assert names[1] == ["thmiddle", "ffmiddle", "mfmiddle", "rfmiddle", "lfmiddle"]
    assert names[2] == ["thdistal", "ffdistal", "mfdistal", "rfdistal", "lfdistal"]


def test_determinism() -> None:
    """A second build has the same digest."""
    again = hand_model.run(shadow_files(), hand_model.Params())
    assert CODEC.digest(again) == CODEC.digest(shadow())


def test_the_urdf_reads_back_to_the_same_hand(tmp_path: Path) -> None:
    """The backend `urdf` reads the same joints, couplings and poses."""
    hand = shadow(wrist="none")
    save_hand(hand, tmp_path)
    tips = tuple(f"{name}={hand.links[link]}" for name, link in zip(hand.fingers.name, hand.fingers.tip_link, strict=True))
    again = hand_model.run(tree(tmp_path), hand_model.Params(backend="urdf", wrist="none", urdf=Urdf(fingers=tips)))
    assert (again.joints.name, again.joints.role, again.links) == (hand.joints.name, hand.joints.role, hand.links)
    np.testing.assert_allclose(again.joints.T_parent_joint, hand.joints.T_parent_joint, atol=1e-15)
    for field in ("axis", "lower", "upper", "effort", "velocity", "ratio", "offset", "driver"):
        np.testing.assert_allclose(getattr(again.joints, field), getattr(hand.joints, field), atol=1e-15, err_msg=field)
    np.testing.assert_allclose(again.fingers.tip_m, hand.fingers.tip_m, atol=0.01)  # by the capsule's end, not by a site


def test_a_hand_with_its_forearm(source: mujoco.MjModel) -> None:
    """The forearm adds two joints, which belong to the wrist."""
    hand = shadow(root="forearm", wrist="none")
    assert hand.links[0] == "forearm"
    assert [name for name, role in zip(hand.joints.name, hand.joints.role, strict=True) if role == "wrist"] == ["WRJ1", "WRJ0"]
    assert hand.mass_kg.sum() == pytest.approx(source.body_subtreemass[source.body("robot0:forearm").id])
