"""Render the stages that README.md and the pages of docs/ show, at the size of a page. `make pictures` calls it.

The attic's layer and the ribbon are those that the pages print.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
from pages import DOCS, ROOT, saved_files

PICTURES = DOCS / "pictures"
PLATE = "examples/blender/plate.exr"
# What takes less than half a minute a picture, and has no grain.
CLEAN = ("--passes", "16", "--denoise")
ATTIC = ("examples/blender/attic.usda", "--scattering", "0.05", "--exposure", "1", *CLEAN)
DUSTY = ("dusty.usda", "--exposure", "1", *CLEAN)
RIBBON = ("ribbon.usda", "--exposure", "3", *CLEAN)
KEYHOLE = ("examples/keyhole/keyhole.usda", *CLEAN)

#: Stage and flags, and what is shown of it: layer and picture.
RENDERS = {
    ATTIC: {"rgba": "attic-fog"},
    DUSTY: {"rgba": "attic-dusty", "surface": "attic-surface", "beams": "attic-beams"},
    RIBBON: {"rgba": "ribbon"},
    KEYHOLE: {"rgba": "keyhole", "beams": "keyhole-beams"},
    (KEYHOLE[0], "--bounces", "4", "--passes", "8", "--denoise"): {"rgba": "keyhole-bounces"},
}

#: The same of the shots of docs/examples.md, wider.
MAGIC, SHAFT = "examples/magic/magic.usda", "examples/shaft/physical.usda"
DIRECTED = ("--session-layer", "examples/shaft/directed.usda")
EXAMPLES = {
    (MAGIC, *CLEAN): {"rgba": "magic"},
    (SHAFT, *CLEAN): {"rgba": "shaft-physical"},
    (SHAFT, *DIRECTED, *CLEAN): {"rgba": "shaft-directed"},
}

#: The stages of docs/examples.md, each shown by a picture of its name, and the most bytes that it may have.
STAGES = ("examples/forest/forest.usda", "examples/concert/concert.usda", "examples/smoke/smoke.usda")
MOST = 490_000

OVER = (*ATTIC, "--holdout", PLATE, "--over", PLATE)

# Of the flight every fifth frame, each as a small picture of one sheet.
FLIGHT = (
    "examples/keyhole/keyhole.usda", "-cam", "Flight", "-f", "1:96x5", "--res", "320", "0",
    "-o", "flight.####.exr", "-q", "--set", "/World/Light/Key.photonbeams:count=2048",
)  # fmt: skip
THUMB = 160


# Of the strands that grow, four frames in a row.
GROWTH = (
    MAGIC, "--session-layer", "examples/magic/grow.usda", "-f", "6,18,30,42", "--res", "480", "0",
    "-o", "grow.####.exr", "-q",
)  # fmt: skip


def photonbeams(folder: Path, *arguments: str) -> None:
    """Run the command in a folder."""
    subprocess.run([sys.executable, "-m", "photonbeams", *arguments], cwd=folder, check=True)


def sheet(folder: Path, arguments: tuple[str, ...], name: str, columns: int, thumb: int) -> None:
    """Write the contact sheet of a sequence, by the keyhole's own script."""
    sys.path.insert(0, str(ROOT / "examples" / "keyhole"))
    import film

    photonbeams(folder, "render", *arguments)
    film.COLUMNS, film.THUMB = columns, thumb
    pattern = arguments[arguments.index("-o") + 1]
    film.contact_sheet(list(film.pictures(film.frames_of(str(folder / pattern)))), PICTURES / name)


def example(folder: Path, stage: str) -> None:
    """Write the picture of an example: what its command renders, but smaller and denoised."""
    from photonbeams.images.display import srgb_encoded, tone_mapped
    from photonbeams.images.files import read_layers

    flags = [*CLEAN, "--res", "960", "0", "-q", "-o", "example.exr", "--layers", "rgba"]
    photonbeams(folder, "render", stage, *flags)
    pixels = 255 * srgb_encoded(tone_mapped(read_layers(folder / "example.exr")["rgba"][..., :3]))
    write_small(folder / "example.png", pixels, MOST)
    shutil.copy(folder / "example.png", PICTURES / f"{Path(stage).stem}.png")


def write_small(path: Path, levels: Any, most: int) -> None:
    """Write a PNG of sRGB levels, of fewer where it has more bytes: what is noisy takes too many with all 256."""
    for step in range(1, 9):
        write_levels(path, step * np.round(levels / step))
        if path.stat().st_size <= most:
            break


def write_levels(path: Path, levels: Any) -> None:
    """Write whole numbers from 0 to 255 as a small PNG; a dithered one, as of `write_png`, is a third larger."""
    spec = OpenImageIO.ImageSpec(levels.shape[1], levels.shape[0], 3, "uint8")
    spec.attribute("png:compressionLevel", 9)
    image = OpenImageIO.ImageOutput.create("png")
    done = image.open(str(path), spec) and image.write_image(np.clip(levels, 0, 255).astype(np.uint8))
    if not (image.close() and done):
        raise OSError(f"{path}: cannot be written")


def plate(folder: Path) -> None:
    """Write Cycles' plate as it is, and with beams over it, both of the plate's own size."""
    from photonbeams.images.files import read_layers, write_png

    write_png(PICTURES / "attic-plate.png", read_layers(ROOT / PLATE)["ViewLayer.Combined"], exposure=1.0)
    flags = [f"--picture=rgba={PICTURES / 'attic-over'}.png", "-q"]
    photonbeams(folder, "render", *OVER, *flags)


def rendered(folder: Path, arguments: tuple[str, ...], pictures: dict[str, str], width: str) -> None:
    """Write what is shown of a stage."""
    flags = [f"--picture={layer}={PICTURES / name}.png" for layer, name in pictures.items()]
    photonbeams(folder, "render", *arguments, "--res", width, "0", "-q", *flags)


def examples(folder: Path) -> None:
    """Write what docs/examples.md shows."""
    for stage in STAGES:
        example(folder, stage)
    for arguments, pictures in EXAMPLES.items():
        rendered(folder, arguments, pictures, "960")
    photonbeams(folder, "swatch", SHAFT, *DIRECTED, "--length", "7", "-o", str(PICTURES / "shaft-look.png"))
    sheet(folder, GROWTH, "magic-grow.png", columns=4, thumb=240)


def fitted(folder: Path) -> None:
    """Write what docs/looks.md shows of the fit."""
    script, painting = ROOT / "examples" / "fit" / "fit.py", ROOT / "examples" / "fit" / "painted.png"
    subprocess.run([sys.executable, script, ROOT / SHAFT, painting, "-o", folder / "fit"], check=True)
    shutil.copy(folder / "fit.png", PICTURES / "fit.png")


def main() -> None:
    """Write all renders."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        for page in ("guide.md", "beams.md"):
            for name, source in saved_files((DOCS / page).read_text()).items():
                (Path(folder) / name).write_text(source)
        for arguments, pictures in RENDERS.items():
            rendered(Path(folder), arguments, pictures, "640")
        plate(Path(folder))
        sheet(Path(folder), FLIGHT, "flight.png", columns=5, thumb=THUMB)
        examples(Path(folder))
        fitted(Path(folder))


if __name__ == "__main__":
    main()
