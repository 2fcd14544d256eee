#!/usr/bin/env python3
"""Makes the pictures of README's first screen: an object turning under three lights, and a row of stills.

    scripts/first-screen.py SCENE OUT [SPECULA]

SCENE is a data set in the layout of NeRF Synthetic with lights in relight/NAME.hdr, such as a path-traced `toaster`. Models
are trained into OUT unless they are there already. Writes docs/turntable.webp and docs/stills.jpg. Needs Pillow.
"""

import subprocess
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

FRAMES, EDGE, SECONDS, LABEL = 60, 280, 6, 24
VIEW = 12


def main(scene, out, specula):
    root = Path(__file__).resolve().parent.parent

    def run(*arguments):
        subprocess.run([specula, *map(str, arguments), "--executor", "cpu"], check=True)

    models = {profile: out / profile for profile in ("specula", "3dgs")}
    for profile, model in models.items():
        if not (model / "results.json").exists():
            settings = ["--eval", "-r", 2, "--iterations", 1500, "--random-points", 20000]
            run("train", scene, "-m", model, "--profile", profile, *settings)

    turns = {"captured light": out / "turn" / "captured"}
    camera = ["--turntable", FRAMES, "--size", f"{EDGE},{EDGE}"]
    run("render", models["specula"], *camera, "-o", turns["captured light"])
    camera += ["--background", "env"]
    for light in sorted((scene / "relight").glob("*.hdr")):
        turns[light.stem] = out / "turn" / light.stem
        run("relight", models["specula"], "--env", light, *camera, "-o", turns[light.stem])
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

    for profile, model in models.items():
        run("render", model, "--layers", "rgb,normal", "--size", "400,400", "-o", out / "views" / profile)
    view = lambda profile, layer: sorted((out / "views" / profile / layer).glob("*.png"), key=number)[VIEW]
    stills = {
        "truth": Image.open(scene / "test" / f"r_{VIEW}.png"),
        "3dgs": Image.open(view("3dgs", "rgb")),
        "specula": Image.open(view("specula", "rgb")),
        "normals": Image.open(view("specula", "normal")),
    }
    strip({label: picture.resize((210, 210), Image.LANCZOS) for label, picture in stills.items()}).save(
        root / "docs/stills.jpg", quality=90
    )


def number(path):
    return int("".join(filter(str.isdigit, path.stem)) or 0)


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
