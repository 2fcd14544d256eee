#!/usr/bin/env python3
"""Makes the animation of README's first screen: an object turning under three lights.

    scripts/first-screen.py SCENE OUT [SPECULA]

SCENE is a data set in the layout of NeRF Synthetic with lights in relight/NAME.hdr, such as a path-traced `toaster`. A model
is trained into OUT unless it is there already. Writes docs/turntable.webp. Needs Pillow.
"""

import subprocess
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

FRAMES, EDGE, SECONDS, LABEL = 60, 280, 6, 24


def main(scene, out, specula):
    root = Path(__file__).resolve().parent.parent

    def run(*arguments):
        subprocess.run([specula, *map(str, arguments), "--executor", "cpu"], check=True)

    model = out / "specula"
    if not (model / "results.json").exists():
        run("train", scene, "-m", model, "--eval", "-r", 2, "--iterations", 1500)

    turns = {"captured light": out / "turn" / "captured"}
    camera = ["--turntable", FRAMES, "--size", f"{EDGE},{EDGE}"]
    run("render", model, *camera, "-o", turns["captured light"])
    camera += ["--background", "env"]
    for light in sorted((scene / "relight").glob("*.hdr")):
        turns[light.stem] = out / "turn" / light.stem
        run("relight", model, "--env", light, *camera, "-o", turns[light.stem])
    rows = {label: sorted((folder / "rgb").glob("*.png")) for label, folder in turns.items()}
    frames = [strip({label: Image.open(files[k]) for label, files in rows.items()}) for k in range(FRAMES)]
    frames[0].save(
        root / "docs/turntable.webp",
        save_all=True,
        append_images=frames[1:],
        duration=1000 * SECONDS // FRAMES,
        loop=0,
        quality=70,
        method=6,
    )


def strip(pictures):
    """Pictures side by side on white, each with its label below."""
    edge = next(iter(pictures.values())).width
    row = Image.new("RGB", (edge * len(pictures), edge + LABEL), "white")
    draw = ImageDraw.Draw(row)
    font = ImageFont.load_default(15)
    for k, (label, picture) in enumerate(pictures.items()):
        picture = picture.convert("RGBA")
        row.paste(picture, (k * edge, 0), picture)
        width = draw.textlength(label, font=font)
        draw.text((k * edge + (edge - width) / 2, edge + 3), label, fill=(60, 60, 60), font=font)
    return row


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3] if len(sys.argv) == 4 else "specula")
