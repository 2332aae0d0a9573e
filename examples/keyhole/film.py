"""A film and a contact sheet of a sequence of layered EXRs: `python film.py out/flight.####.exr out/flight.mp4`.

The sheet is written beside the film, as .png. It shows frames at regular intervals, in reading order, for a quick look
without playing the film.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import OpenImageIO
from rich.progress import track

from photonbeams.images.display import srgb_encoded, tone_mapped
from photonbeams.images.files import read_layers
from photonbeams.images.writing import write_png

RATE, COLUMNS, ROWS, THUMB = 24, 5, 4, 320


def frames_of(pattern: str) -> list[Path]:
    """Return the files of a sequence in order; the run of # in `path` stands for the frame number."""
    path = Path(pattern)
    name = re.sub("#+", r"(-?\\d+)", re.escape(path.name).replace(r"\#", "#"))
    found = [(int(match[1]), each) for each in path.parent.glob("*") if (match := re.fullmatch(name, each.name))]
    return [each for _, each in sorted(found)]


def pictures(paths: list[Path]) -> Iterator[np.ndarray]:
    """Yield each frame's scene-linear picture; for stereo frames, that of the left eye."""
    for path in track(paths, "encoding"):
        layers = read_layers(path)
        yield (layers["rgba"] if "rgba" in layers else layers["rgba.left"])[..., :3]


def encode(paths: list[Path], film: Path) -> list[np.ndarray]:
    """Write the film as widely playable H.264; return the pictures of the contact sheet."""
    shown = set(np.linspace(0, len(paths) - 1, min(COLUMNS * ROWS, len(paths))).astype(int).tolist())
    sheet = []
    with av.open(str(film), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, options={"crf": "16"})
        stream.pix_fmt = "yuv420p"
        for number, picture in enumerate(pictures(paths)):
            even = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
            if number == 0:
                stream.height, stream.width = even.shape[:2]
            encoded = np.round(255 * srgb_encoded(tone_mapped(even))).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(encoded), format="rgb24")))
            if number in shown:
                sheet.append(picture)
        container.mux(stream.encode())
    return sheet


def contact_sheet(thumbs: list[np.ndarray], path: Path) -> None:
    """Write the pictures side by side, row after row."""
    height = round(THUMB * thumbs[0].shape[0] / thumbs[0].shape[1])
    small = [_resized(each, THUMB, height) for each in thumbs]
    small += [np.zeros_like(small[0])] * (-len(small) % COLUMNS)
    rows = [np.concatenate(small[at : at + COLUMNS], axis=1) for at in range(0, len(small), COLUMNS)]
    write_png(path, np.concatenate(rows))


def _resized(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    image = OpenImageIO.ImageBuf(np.ascontiguousarray(pixels, dtype=np.float32))
    resized = OpenImageIO.ImageBufAlgo.resize(
        image, filtername="triangle", roi=OpenImageIO.ROI(0, width, 0, height, 0, 1, 0, 3)
    )
    return np.asarray(resized.get_pixels("float"))


def main() -> None:
    """Write the film that the command line names, and its contact sheet."""
    if len(sys.argv) != 3:
        raise SystemExit("expected a sequence and a film, as in: film.py out/flight.####.exr out/flight.mp4")
    paths, film = frames_of(sys.argv[1]), Path(sys.argv[2])
    if not paths:
        raise SystemExit(f"{sys.argv[1]}: no such frames")
    sheet = film.with_suffix(".png")
    contact_sheet(encode(paths, film), sheet)
    print(f"wrote {film} ({len(paths)} frames, {len(paths) / RATE:.1f} s)\nwrote {sheet}")


if __name__ == "__main__":
    main()
