"""Render the stages that README.md, docs/guide.md and docs/beams.md show, at the size of a page. `make docs` calls it.

The attic's layer and the ribbon are those that the pages print.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from pages import DOCS, ROOT, saved_files

PICTURES = DOCS / "pictures"
PLATE = "examples/blender/plate.exr"
ATTIC = ("examples/blender/attic.usda", "--scattering", "0.05", "--exposure", "1", "--passes", "128")
DUSTY = ("dusty.usda", "--exposure", "1", "--passes", "128")
RIBBON = ("ribbon.usda", "--exposure", "3", "--passes", "64")
KEYHOLE = ("examples/keyhole/keyhole.usda", "--passes", "256")

#: Stage and flags, and what is shown of it: layer and picture.
RENDERS = {
    ATTIC: {"rgba": "attic-fog"},
    DUSTY: {"rgba": "attic-dusty", "surface": "attic-surface", "beams": "attic-beams"},
    RIBBON: {"rgba": "ribbon"},
    KEYHOLE: {"rgba": "keyhole", "beams": "keyhole-beams"},
}

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
        for page in ("guide.md", "beams.md"):
            for name, source in saved_files((DOCS / page).read_text()).items():
                (Path(folder) / name).write_text(source)
        for arguments, pictures in RENDERS.items():
            flags = [f"--picture={layer}={PICTURES / name}.png" for layer, name in pictures.items()]
            command = [sys.executable, "-m", "photonbeams", "render", *arguments, "--res", "640", "0", "-q", *flags]
            subprocess.run(command, cwd=folder, check=True)
        plate(Path(folder))
        flight(Path(folder))


if __name__ == "__main__":
    main()
