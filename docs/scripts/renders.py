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
    ("window.usda", "--passes", "8", "--denoise"): {"rgba": "window"},
    ("ribbon.usda", "--exposure", "3", *CLEAN): {"rgba": "ribbon"},
    ("filters.usda", "--exposure", "1", *CLEAN): {"rgba": "filters"},
    ("pool.usda", "--exposure", "2", *CLEAN): {"rgba": "pool"},
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


def composited(folder: Path) -> None:
    """Write the attic's cryptomatte beside a ball that is put into the shaft by the deep file."""
    import OpenImageIO

    from photonbeams.images.display import srgb_encoded, tone_mapped
    from photonbeams.images.files import read_layers

    flags = ("--res", str(WIDTH // 2), "0", "--layers", "surface,beams,depth,crypto_object", "-q")
    photonbeams(folder, "render", *ATTIC[:3], *flags, *CLEAN[:2], "-o", "flat.exr", "--deep", "deep.exr")
    layers = read_layers(folder / "flat.exr")
    beams, depth, surface = layers["beams"], layers["depth"], layers["surface"]
    height, width = depth.shape
    deep = OpenImageIO.ImageBuf(str(folder / "deep.exr"))
    # The ball is round in the picture, and in the middle of the light of the brightest pixel of a row.
    row = 2 * height // 5
    column = int(np.argmax(beams[row].sum(axis=1)))
    samples = [(deep.deep_value(column, row, 0, 0, k), deep.deep_value(column, row, 0, 4, k),
                deep.deep_value(column, row, 0, 5, k)) for k in range(deep.deep_samples(column, row))]  # fmt: skip
    middle = sum(light * (front + back) / 2 for light, front, back in samples) / sum(light for light, *_ in samples)
    y, x = np.mgrid[:height, :width]
    radius = height / 6
    square = 1 - ((x - column) ** 2 + (y - row) ** 2) / radius**2
    ball, up = square > 0, np.sqrt(np.maximum(square, 0))
    pixels = np.zeros((height, width, 6), np.float32)
    shade = 0.05 + 0.5 * np.maximum(0.5 * up - 0.8 * (y - row) / radius, 0)
    pixels[..., :3] = np.where(ball, shade, 0)[..., None] * (0.9, 0.35, 0.1)
    pixels[..., 3], pixels[..., 4:] = ball, (middle * (1 - 0.1 * up))[..., None]
    spec = OpenImageIO.ImageSpec(width, height, 6, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z", "ZBack")
    flat = OpenImageIO.ImageBuf(spec)
    flat.set_pixels(OpenImageIO.ROI.All, pixels)
    both = OpenImageIO.ImageBufAlgo.deep_merge(OpenImageIO.ImageBufAlgo.deepen(flat), deep)
    merged = OpenImageIO.ImageBufAlgo.flatten(both).get_pixels("float")[..., :3]
    hidden = ball & (pixels[..., 4] < depth)
    ids = layers["crypto_object00"]
    codes = ids[..., 0].copy().view(np.uint32)
    colors = np.stack([(codes >> shift & 255) / 255 for shift in (0, 8, 16)], axis=2) * ids[..., 1:2]
    shown = srgb_encoded(tone_mapped(merged + np.where(hidden[..., None], 0, surface), 1.0))
    keep(255 * np.hstack([colors, shown]), "compositing")


def rendered(folder: Path, arguments: tuple[str, ...], pictures: dict[str, str]) -> None:
    """Write what is shown of a stage."""
    flags = [f"--picture={layer}={name}.png" for layer, name in pictures.items()]
    photonbeams(folder, "render", *arguments, "--res", str(WIDTH), "0", "-q", *flags)
    for name in pictures.values():
        keep(folder / f"{name}.png", name)


def spaces(folder: Path) -> None:
    """Write the page's stage in linear Rec. 709 and in ACEScg beside each other."""
    flags = ("--res", str(WIDTH // 2), "0", "--bounces", "2", "--exposure", "1", *CLEAN, "-q")
    for name in ("lin_rec709", "ACEScg"):
        photonbeams(folder, "render", "color.usda", "--working-space", name, *flags, "-o", f"{name}.png")
    keep(np.hstack([np.asarray(Image.open(folder / f"{name}.png")) for name in ("lin_rec709", "ACEScg")]), "color")


def dressed(folder: Path) -> None:
    """Write the attic under the layer that `photonbeams dress` makes."""
    photonbeams(folder, "dress", ATTIC[0], "-o", "dressed.usda", "-q")
    rendered(folder, ("dressed.usda", "--bounces", "3", "--exposure", "1", *CLEAN), {"rgba": "attic-dressed"})


def blind(folder: Path) -> None:
    """Write the stripes of a blind with too few beams, beside those with the number that a render names."""
    for beams in ("512", "1900"):
        flags = ("--res", str(WIDTH // 2), "0", "--exposure", "1", "--beams", beams, "-q", "-o", f"blind{beams}.png")
        photonbeams(folder, "render", "blind.usda", *flags)
    both = [np.asarray(Image.open(folder / f"blind{beams}.png").convert("RGB")) for beams in ("512", "1900")]
    keep(np.hstack(both), "blind")


def held(folder: Path) -> None:
    """Write slats that are held out by one depth a pixel, with its alpha, and by a deep file of a finer depth."""
    from photonbeams.images.files import read_layers

    size, parts = (208, 117), 8
    flags = ("slats.usda", "-q", "--res")
    finer = [str(parts * each) for each in size]
    photonbeams(folder, "render", *flags, *map(str, size), "--layers", "rgba,depth", "-o", "slats.exr")
    photonbeams(
        folder, "render", *flags, *finer, "--passes", "1", "--beams", "8", "--layers", "depth", "-o", "fine.exr"
    )
    deepened(read_layers(folder / "fine.exr")["depth"], parts, folder / "deep.exr")
    pictures = []
    for name, *more in (("slats.exr", "--holdout-coverage", "none"), ("slats.exr",), ("deep.exr",)):
        flags = ("slats.usda", *CLEAN, "-q", "--holdout", name, *more, "-o", "held.png")
        photonbeams(folder, "render", *flags)
        pictures.append(np.asarray(Image.open(folder / "held.png").convert("RGB")))
    keep(np.kron(np.hstack(pictures), np.ones((2, 2, 1))), "holdout-coverage")


def deepened(depth: np.ndarray[Any, Any], parts: int, path: Path) -> None:
    """Write a deep file of surfaces, from depths of so many times the size; a tenth of a unit parts two surfaces."""
    import OpenImageIO

    height, width = (each // parts for each in depth.shape)
    pixels = depth.reshape(height, parts, width, parts).swapaxes(1, 2).reshape(height * width, -1)
    spec = OpenImageIO.ImageSpec(width, height, 2, "float")
    spec.deep, spec.channelnames = True, ("Z", "A")
    data = OpenImageIO.DeepData()
    data.init(len(pixels), 2, ["float", "float"], spec.channelnames)
    for pixel, own in enumerate(pixels):
        there, left = np.sort(own[np.isfinite(own)]), own.size
        surfaces = [each for each in np.split(there, np.flatnonzero(np.diff(there) > 0.1) + 1) if len(each)]
        data.set_samples(pixel, len(surfaces))
        for number, each in enumerate(surfaces):
            data.set_deep_value(pixel, 0, number, float(each.mean()))
            data.set_deep_value(pixel, 1, number, len(each) / left)
            left -= len(each)
    out = OpenImageIO.ImageOutput.create(str(path))
    if not (out.open(str(path), spec) and out.write_deep_image(data)):
        raise SystemExit(out.geterror())
    out.close()


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
        "attic-dressed": dressed, "attic-over": plate, "compositing": composited, "color": spaces,
        "shaft-look": swatch, "fit": fitted, "blind": blind,
        "holdout-coverage": held,
        "flight": lambda folder: sheet(folder, FLIGHT, "flight", columns=5),
        "magic-grow": lambda folder: sheet(folder, GROWTH, "magic-grow", columns=4),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(ROOT / "examples")
        pages = "guide", "beams", "looks", "filters", "color", "compositing", "performance"
        for page in (f"{name}.md" for name in pages):
            for name, source in saved_files((DOCS / page).read_text()).items():
                (Path(folder) / name).write_text(source)
        for name, write in jobs.items():
            if not wanted or name in wanted:
                write(Path(folder))


if __name__ == "__main__":
    main()
