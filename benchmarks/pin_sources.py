"""Small sources for the runs of `pin_outputs.py`, written the same each time and without any code of the project."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import trimesh

FINGERS = ((0.05, 0.04, 0.03), (0.03, 0.09, 0.03), (0.01, 0.095, 0.032), (-0.01, 0.09, 0.03), (-0.03, 0.08, 0.025))
"""(x, y of the knuckle, length of a bone) in metres, from the thumb"""


def motion(folder: Path) -> None:
    """Write a right hand of sticks that comes down, closes and rises: 21 points in 45 frames, for `motion_read`'s keypoints."""
    closing = np.clip(np.linspace(-1.0, 2.0, 45), 0.0, 1.0)
    points = np.zeros((45, 21, 3))
    for finger, (x, knuckle, bone) in enumerate(FINGERS):
        at = np.tile([x, knuckle, 0.0], (45, 1))
        for joint in range(4):
            points[:, 1 + 4 * finger + joint] = at
            angle = 0.45 * (joint + 1) * closing
            at = at + bone * np.stack([np.zeros(45), np.cos(angle), np.sin(angle)], 1)
    points[:, :, 2] += 0.3 - 0.1 * np.sin(np.linspace(0, np.pi, 45))[:, None]
    np.savez(folder / "sticks.npz", keypoints=points.astype(np.float32), fps=60.0, hand="right", unit="m")


def mesh(folder: Path) -> None:
    """Write a grey bar of 20 cm, in metres."""
    trimesh.creation.box((0.2, 0.04, 0.03)).subdivide().subdivide().export(folder / "bar.stl")


def video(folder: Path) -> None:
    """Write a video of 16 frames without masks: a skin-coloured bar moves over noise."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (96, 160, 3)).astype(np.uint8), (0, 0), 2)
    writer = cv2.VideoWriter(str(folder / "film.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (160, 96))
    for k in range(16):
        picture = ground.copy()
        cv2.rectangle(picture, (60 + k, 40), (90 + k, 95), (120, 150, 205), -1)
        writer.write(picture)
    writer.release()


def pictures(folder: Path) -> None:
    """Write two pictures in the layout of IIT-AFF."""
    for name in ("rgb", "affordances_labels", "depth", "object_labels"):
        (folder / name).mkdir()
    (folder / "train_and_val.txt").write_text("a.jpg\nb.jpg\n")
    (folder / "val.txt").write_text("b.jpg\n")
    label = "".join(" ".join(str(k // 4) for k in range(40)) + "\n" for _ in range(40))
    for number, stem in enumerate("ab"):
        cv2.imwrite(str(folder / "rgb" / f"{stem}.jpg"), np.full((40, 40, 3), 90 + 40 * number, np.uint8))
        (folder / "affordances_labels" / f"{stem}.txt").write_text(label)
        (folder / "depth" / f"{stem}.txt").write_text("\n".join(" ".join(["1.5"] * 40) for _ in range(40)))
        (folder / "object_labels" / f"{stem}.txt").write_text("4 2 2 20 20\n9 4 4 36 36\n")


def actions(folder: Path) -> None:
    """Write eight sequences of two actions in the layout of UTKinect, one of the actions missing."""
    names = [f"s{n + 1:02d}_e01" for n in range(8)]
    for n, name in enumerate(names):
        for kind in ("RGB", "depth"):
            (folder / kind / name).mkdir(parents=True)
        data = " ".join(str(1000 + 50 * n << 3) for _ in range(8 * 6))
        text = f"<opencv_storage><d><width>8</width><height>6</height><data>{data}</data></d></opencv_storage>"
        for k in (10, 12, 14, 16):
            cv2.imwrite(str(folder / "RGB" / name / f"colorImg{k}.jpg"), np.full((12, 16, 3), 10 * k + n, np.uint8))
            (folder / "depth" / name / f"depthImg{k}.xml").write_text(text)
    (folder / "actionLabel.txt").write_text("".join(f"{name}\nwalk: 10 16\ncarry: NaN NaN\n" for name in names))


SOURCES = {"motion": motion, "mesh": mesh, "video": video, "pictures": pictures, "actions": actions}
"""name -> what writes it into an empty folder"""


def written(name: str, below: Path) -> Path:
    """The folder of a source, written where it is not there yet."""
    folder = below / name
    if not folder.exists():
        folder.mkdir(parents=True)
        SOURCES[name](folder)
    return folder
