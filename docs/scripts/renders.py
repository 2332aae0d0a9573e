"""Render the stages that README.md and docs/ show. `make pictures` calls it; with names it renders those alone.

The attic's layer, the ribbon and the filters are those that the pages print. The plate is by Cycles, which the set-up
installs with Python 3.11.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pages import DOCS, ROOT, saved_files
from PIL import Image

PICTURES = DOCS / "pictures"
WIDTH = 1280
# Of WebP: lower ones show blotches in the dark; this has a fifth of the bytes of PNG.
QUALITY = 97
# Without grain, and in a minute or two a picture.
CLEAN = ("--passes", "32", "--denoise")
BLENDER = Path(sys.prefix) / "bpy" / "bin" / "python"
ATTIC = ("examples/blender/attic.usda", "--scattering", "0.05", "--exposure", "1", *CLEAN)
KEYHOLE, MAGIC, SHAFT = (f"examples/{name}.usda" for name in ("keyhole/keyhole", "magic/magic", "shaft/physical"))
DIRECTED = ("--session-layer", "examples/shaft/directed.usda")

#: Stage and flags, and what is shown of it: layer and picture.
RENDERS = {
    (*ATTIC, "--bounces", "3"): {"rgba": "attic-fog"},
    ("dusty.usda", "--exposure", "1", *CLEAN): {
        "rgba": "attic-dusty", "surface": "attic-surface", "beams": "attic-beams",
    },
    ("interior.usda", "--exposure", "1", *CLEAN): {"rgba": "attic-interior"},
    ("ribbon.usda", "--exposure", "3", *CLEAN): {"rgba": "ribbon"},
    ("filters.usda", "--exposure", "1", *CLEAN): {"rgba": "filters"},
    (KEYHOLE, *CLEAN): {"rgba": "keyhole", "beams": "keyhole-beams"},
    (KEYHOLE, "--bounces", "4", *CLEAN): {"rgba": "keyhole-bounces"},
    (MAGIC, *CLEAN): {"rgba": "magic"},
    (SHAFT, *CLEAN): {"rgba": "shaft-physical"},
    (SHAFT, *DIRECTED, *CLEAN): {"rgba": "shaft-directed"},
    ("examples/forest/forest.usda", *CLEAN): {"rgba": "forest"},
    ("examples/concert/concert.usda", *CLEAN): {"rgba": "concert"},
    ("examples/smoke/smoke.usda", "--passes", "8", "--denoise"): {"rgba": "smoke"},
}  # fmt: skip

# Of the flight every fifth frame, each as a small picture of one sheet.
FLIGHT = (
    KEYHOLE, "-cam", "Flight", "-f", "1:96x5", "--res", "512", "0", "--passes", "8", "--denoise",
    "-o", "flight.####.exr", "-q", "--set", "/World/Light/Key.photonbeams:count=2048",
)  # fmt: skip

# Of the strands that grow, four frames in a row.
GROWTH = (
    MAGIC, "--session-layer", "examples/magic/grow.usda", "-f", "6,18,30,42", "--res", "640", "0", "--passes", "8",
    "--denoise", "-o", "grow.####.exr", "-q",
)  # fmt: skip


def photonbeams(folder: Path, *arguments: str) -> None:
    """Run the command in a folder."""
    subprocess.run([sys.executable, "-m", "photonbeams", *arguments], cwd=folder, check=True)


def keep(picture: Path | Image.Image | Any, name: str, quality: int = QUALITY) -> None:
    """Write a picture, a file or levels from 0 to 255 of the shape (H, W, 3), as one of the pages'."""
    if isinstance(picture, np.ndarray):
        picture = Image.fromarray(np.clip(np.round(picture), 0, 255).astype(np.uint8))
    image = picture if isinstance(picture, Image.Image) else Image.open(picture)
    image.convert("RGB").save(PICTURES / f"{name}.webp", quality=quality, method=6, use_sharp_yuv=True)


def sheet(folder: Path, arguments: tuple[str, ...], name: str, columns: int) -> None:
    """Write the contact sheet of a sequence, by the keyhole's own script."""
    sys.path.insert(0, str(ROOT / "examples" / "keyhole"))
    import film

    photonbeams(folder, "render", *arguments)
    film.COLUMNS, film.THUMB = columns, WIDTH // columns
    pattern = arguments[arguments.index("-o") + 1]
    film.contact_sheet(list(film.pictures(film.frames_of(str(folder / pattern)))), folder / "sheet.png")
    keep(folder / "sheet.png", name)


def plate(folder: Path) -> None:
    """Write Cycles' plate as it is, and with beams over it."""
    from photonbeams.images.files import read_layers
    from photonbeams.images.writing import write_png

    if not BLENDER.exists():
        raise SystemExit(f"the plate is by Cycles: {BLENDER} is missing, which the set-up makes with Python 3.11")
    script = ROOT / "examples" / "blender" / "plate.py"
    subprocess.run([BLENDER, script, "--", "plate.exr", str(WIDTH)], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    write_png(folder / "plate.png", read_layers(folder / "plate.exr")["ViewLayer.Combined"], exposure=1.0)
    keep(folder / "plate.png", "attic-plate")
    rendered(folder, (*ATTIC, "--holdout", "plate.exr", "--over", "plate.exr"), {"rgba": "attic-over"})


def rendered(folder: Path, arguments: tuple[str, ...], pictures: dict[str, str]) -> None:
    """Write what is shown of a stage."""
    flags = [f"--picture={layer}={name}.png" for layer, name in pictures.items()]
    photonbeams(folder, "render", *arguments, "--res", str(WIDTH), "0", "-q", *flags)
    for name in pictures.values():
        keep(folder / f"{name}.png", name)


def dressed(folder: Path) -> None:
    """Write the attic under the layer that `photonbeams dress` makes."""
    photonbeams(folder, "dress", ATTIC[0], "-o", "dressed.usda", "-q")
    rendered(folder, ("dressed.usda", "--bounces", "3", "--exposure", "1", *CLEAN), {"rgba": "attic-dressed"})


def swatch(folder: Path) -> None:
    """Write what docs/examples.md shows of the shaft's look."""
    photonbeams(folder, "swatch", SHAFT, *DIRECTED, "--length", "7", "-o", str(PICTURES / "shaft-look.png"))


def fitted(folder: Path) -> None:
    """Write what docs/looks.md shows of the fit."""
    script, painting = ROOT / "examples" / "fit" / "fit.py", ROOT / "examples" / "fit" / "painted.png"
    subprocess.run([sys.executable, script, ROOT / SHAFT, painting, "-o", folder / "fit"], check=True)
    shutil.copy(folder / "fit.png", PICTURES / "fit.png")


def main() -> None:
    """Write all renders, or those that the command line names."""
    wanted = sys.argv[1:] if __name__ == "__main__" else []
    jobs: dict[str, Any] = {
        next(iter(pictures.values())): lambda folder, each=arguments, of=pictures: rendered(folder, each, of)
        for arguments, pictures in RENDERS.items()
    }
    jobs |= {
        "attic-dressed": dressed, "attic-over": plate, "shaft-look": swatch, "fit": fitted,
        "flight": lambda folder: sheet(folder, FLIGHT, "flight", columns=5),
        "magic-grow": lambda folder: sheet(folder, GROWTH, "magic-grow", columns=4),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        for page in ("guide.md", "beams.md", "filters.md"):
            for name, source in saved_files((DOCS / page).read_text()).items():
                (Path(folder) / name).write_text(source)
        for name, write in jobs.items():
            if not wanted or name in wanted:
                write(Path(folder))


if __name__ == "__main__":
    main()
