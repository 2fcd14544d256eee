#!/usr/bin/env python3
"""Turns a scene of Glossy Synthetic (NeRO, Liu et al. 2023) into the layout of NeRF Synthetic.

  pip install numpy pillow
  scripts/glossy-synthetic.py GlossySynthetic/bell data/bell --split synthetic_split_128.pkl
  specula train data/bell -m out/bell --eval --preset glossy-synthetic

What is known of the data set, from the reader in its authors' repository (github.com/liuyuan-pal/NeRO, MIT,
dataset/database.py): a scene is a folder with three files for each view i = 0, 1, ...

  {i}.png          the picture; three channels are used
  {i}-depth.png    16 bits, 65535 is a depth of 15; from 14.5 on nothing is there
  {i}-camera.pkl   a pickle of [pose, K, ...]: pose is 3 x 4, from the world to a camera with x to the right, y down and
                   z forward; K is 3 x 3, in pixels

Test views are those of configs/synthetic_split_128.pkl in that repository, a pickle of (test ids, training ids), which
--split takes. Without it every 8th view is one, and results are not those of anybody's tables.

Written are transforms_train.json and transforms_test.json, with cameras that look along -z with y up, and pictures whose
alpha is 0 where nothing is. Pickles may run any program when they are opened; this opens them with nothing allowed but
arrays of numpy.
"""

import argparse
import json
import pickle
import sys
from pathlib import Path

import numpy as np
from PIL import Image

# Depth of the value 65535 in depth pictures, and the depth from which pixels are empty.
DEPTH_MAX = 15.0
NOTHING_FROM = 14.5
# Without a list of test views, every Nth view is held out.
TEST_EVERY = 8
# Tolerance of a camera's rotation.
ROTATION_TOLERANCE = 1e-3


class ArraysOnly(pickle.Unpickler):
    """Opens arrays, lists and numbers, and nothing else."""

    ALLOWED = {
        (module, name)
        for core in ("numpy.core", "numpy._core")
        for module, name in [
            (f"{core}.multiarray", "_reconstruct"),
            (f"{core}.multiarray", "scalar"),
            (f"{core}.numeric", "_frombuffer"),
            ("numpy", "ndarray"),
            ("numpy", "dtype"),
            ("_codecs", "encode"),
        ]
    }

    def find_class(self, module, name):
        if (module, name) not in self.ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}, which is no array")
        return super().find_class(module, name)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, metavar="SCENE")
    parser.add_argument("output", type=Path, metavar="OUT")
    parser.add_argument("--split", type=Path, metavar="FILE.pkl", help="(test ids, training ids)")
    args = parser.parse_args()
    ids = sorted(int(path.name.split("-")[0]) for path in args.scene.glob("*-camera.pkl"))
    if not ids:
        fail(f"no 0-camera.pkl in {args.scene}; name the folder of a scene such as GlossySynthetic/bell")
    if args.split is None:
        print(f"no --split, so every {TEST_EVERY}th view is a test view: not the split of published tables", file=sys.stderr)
    for name, own in split(ids, args.split).items():
        frames = [convert(args.scene, args.output, name, index) for index in own]
        text = json.dumps({"frames": frames}, indent=1)
        (args.output / f"transforms_{name}.json").write_text(text + "\n")
        print(f"{name}: {len(frames)} views")


def fail(sentence):
    sys.exit(f"glossy-synthetic.py: {sentence}")


def opened(path):
    try:
        with open(path, "rb") as file:
            return ArraysOnly(file).load()
    except (OSError, pickle.UnpicklingError, EOFError) as error:
        fail(f"cannot open {path}: {error}")


def split(ids, path):
    """Numbers of the training views and of the test views."""
    if path is None:
        test = ids[::TEST_EVERY]
    else:
        test = sorted(int(index) for index in opened(path)[0])
        missing = [index for index in test if index not in ids]
        if missing:
            fail(f"{path} names view {missing[0]}, which is not there; use the list that belongs to this data set")
    return {"train": [index for index in ids if index not in test], "test": test}


def convert(scene, output, name, index):
    """Writes a view's picture; returns its entry."""
    picture = np.asarray(Image.open(scene / f"{index}.png").convert("RGB"))
    height, width = picture.shape[:2]
    alpha = 255 * is_there(scene / f"{index}-depth.png", (height, width))
    (output / name).mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.dstack([picture, alpha]).astype(np.uint8), "RGBA").save(output / name / f"r_{index}.png")
    path = scene / f"{index}-camera.pkl"
    pose, matrix = (np.asarray(part, float) for part in opened(path)[:2])
    return {
        "file_path": f"./{name}/r_{index}",
        "transform_matrix": world_from_camera(pose, path).tolist(),
        "w": width,
        "h": height,
        "fl_x": matrix[0, 0],
        "fl_y": matrix[1, 1],
        "cx": matrix[0, 2],
        "cy": matrix[1, 2],
    }


def is_there(path, size):
    """Whether a pixel shows the object; everywhere where there is no depth."""
    if not path.is_file():
        return np.ones(size)
    return np.asarray(Image.open(path), float) / 65535 * DEPTH_MAX < NOTHING_FROM


def world_from_camera(pose, path):
    """From a camera that looks along -z with y up to the world, of a pose from the world to one along z with y down."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(rotation) < 0:
        fail(f"the pose in {path} is no rotation and translation; is it of Glossy Synthetic?")
    result = np.eye(4)
    result[:3, :3] = rotation.T @ np.diag([1.0, -1.0, -1.0])
    result[:3, 3] = -rotation.T @ translation
    return result


if __name__ == "__main__":
    main()
