#!/usr/bin/env python3
"""Copies a data set as if the camera had chosen an exposure for each training photograph.

  pip install numpy pillow
  scripts/other-exposures.py DATA OUT                 DATA as of NeRF Synthetic: transforms_train.json and its pictures
  scripts/other-exposures.py cli/data/demo out/exposed
  specula train out/exposed -m out/model --eval --exposure

The colour c of each training picture becomes A c + b, kept within 0 and 1: up to a fifth brighter or darker, each
colour by itself up to a twentieth, and a veil of up to a twentieth. The mean of all maps is the identity, so that a scene that is
learned with a map for each picture has the colours of DATA. Test pictures stay as they are. OUT/exposures.json has the
maps, in rows of [A | b].
"""

import argparse
import json
import pathlib
import shutil

import numpy as np
from PIL import Image

GAIN, TINT, VEIL = 0.2, 0.05, 0.05


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    frames = json.loads((args.data / "transforms_train.json").read_text())["frames"]
    shutil.copytree(args.data, args.out)
    pictures = [picture_of(args.out, frame["file_path"]) for frame in frames]
    maps = drawn(len(pictures), np.random.default_rng(args.seed))
    for path, exposure in zip(pictures, maps):
        expose(path, exposure)
    known = {path.name: exposure.tolist() for path, exposure in zip(pictures, maps)}
    (args.out / "exposures.json").write_text(json.dumps(known, indent=1) + "\n")
    print(f"{args.out}: {len(pictures)} training pictures, each of an exposure of its own")


def picture_of(folder, name):
    """The field leaves the ending of pictures out."""
    path = folder / name
    return path if path.suffix else path.with_suffix(".png")


def drawn(count, random):
    """A map for each picture; their mean is the identity."""
    gains = 1 + random.uniform(-GAIN, GAIN, (count, 1)) + random.uniform(-TINT, TINT, (count, 3))
    veils = random.uniform(-VEIL, VEIL, (count, 3, 1))
    maps = np.concatenate([gains[:, :, None] * np.eye(3), veils], axis=2)
    return maps + np.eye(3, 4) - maps.mean(axis=0)


def expose(path, exposure):
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGBA" if "A" in image.getbands() else "RGB"), dtype=np.float64) / 255
    pixels[..., :3] = pixels[..., :3] @ exposure[:, :3].T + exposure[:, 3]
    Image.fromarray((pixels.clip(0, 1) * 255).round().astype(np.uint8)).save(path)


main()
