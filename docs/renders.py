"""Render the stages that README.md and docs/ show, at the size of a page. `make docs` calls it.

The attic's layer is the one that the guide prints.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO
from pages import DOCS, ROOT, saved_files

PICTURES = DOCS / "pictures"
PLATE = "examples/blender/plate.exr"
ATTIC = ("examples/blender/attic.usda", "--scattering", "0.05", "--exposure", "1", "--passes", "128")
DUSTY = ("dusty.usda", "--exposure", "1", "--passes", "128")
KEYHOLE = ("examples/keyhole/keyhole.usda", "--passes", "256")

#: Stage and flags, and what is shown of it: layer and picture.
RENDERS = {
    ATTIC: {"rgba": "attic-fog"},
    DUSTY: {"rgba": "attic-dusty", "surface": "attic-surface", "beams": "attic-beams"},
    KEYHOLE: {"rgba": "keyhole", "beams": "keyhole-beams"},
}

#: The stages of docs/examples.md, each shown by a picture of its name; and how many steps a channel of it has.
EXAMPLES = ("examples/forest/forest.usda", "examples/concert/concert.usda")
STEPS = 127  # dithered to 256, a picture of this size would be too large for a page

OVER = (*ATTIC, "--holdout", PLATE, "--over", PLATE)

# Of the flight every fifth frame, each as a small picture of one sheet.
FLIGHT = (
    "examples/keyhole/keyhole.usda", "-cam", "Flight", "-f", "1:96x5", "--res", "320", "0",
    "-o", "flight.####.exr", "-q", "--set", "/World/Light/Key.photonbeams:count=2048",
)  # fmt: skip
THUMB = 160


def flight(folder: Path) -> None:
    """Write the flight's contact sheet, by the example's own script."""
    sys.path.insert(0, str(ROOT / "examples" / "keyhole"))
    import film

    subprocess.run([sys.executable, "-m", "photonbeams", "render", *FLIGHT], cwd=folder, check=True)
    film.THUMB = THUMB
    film.contact_sheet(list(film.pictures(film.frames_of(str(folder / "flight.####.exr")))), PICTURES / "flight.png")


def example(folder: Path, stage: str) -> None:
    """Write the picture of an example: what its command renders, but smaller and of more passes."""
    from photonbeams.shot.display import srgb_encoded, tone_mapped
    from photonbeams.shot.images import atomic_path, read_layers

    flags = ["--passes", "32", "--res", "960", "0", "-q", "-o", "example.exr", "--layers", "rgba"]
    subprocess.run([sys.executable, "-m", "photonbeams", "render", stage, *flags], cwd=folder, check=True)
    levels = np.round(STEPS * srgb_encoded(tone_mapped(read_layers(folder / "example.exr")["rgba"][..., :3])))
    pixels = np.round(levels * (255 / STEPS)).astype(np.uint8)
    spec = OpenImageIO.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "uint8")
    spec.attribute("png:compressionLevel", 9)
    with atomic_path(PICTURES / f"{Path(stage).stem}.png") as path:
        image = OpenImageIO.ImageOutput.create("png")
        if not (image.open(str(path), spec) and image.write_image(pixels) and image.close()):
            raise OSError(f"{path}: cannot be written")


def plate(folder: Path) -> None:
    """Write Cycles' plate as it is, and with beams over it, both of the plate's own size."""
    from photonbeams.shot.images import read_layers, write_png

    write_png(PICTURES / "attic-plate.png", read_layers(ROOT / PLATE)["ViewLayer.Combined"], exposure=1.0)
    flags = [f"--picture=rgba={PICTURES / 'attic-over'}.png", "-q"]
    subprocess.run([sys.executable, "-m", "photonbeams", "render", *OVER, *flags], cwd=folder, check=True)


def main() -> None:
    """Write all renders."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        for name, source in saved_files((DOCS / "guide.md").read_text()).items():
            (Path(folder) / name).write_text(source)
        for arguments, pictures in RENDERS.items():
            flags = [f"--picture={layer}={PICTURES / name}.png" for layer, name in pictures.items()]
            command = [sys.executable, "-m", "photonbeams", "render", *arguments, "--res", "640", "0", "-q", *flags]
            subprocess.run(command, cwd=folder, check=True)
        for stage in EXAMPLES:
            example(Path(folder), stage)
        plate(Path(folder))
        flight(Path(folder))


if __name__ == "__main__":
    main()
