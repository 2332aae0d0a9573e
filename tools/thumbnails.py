"""Write the thumbnails of presets for Blender's extension: `python tools/thumbnails.py`.

They are those of the studio. Run it after a change of presets; tests/blender/test_extension.py looks whether each has
one.
"""

from pathlib import Path

from photonbeams.studio.encoding import thumbnail_of
from photonbeams.usd.authoring.presets import PRESETS

FOLDER = Path(__file__).resolve().parents[1] / "src" / "photonbeams" / "blender" / "extension" / "thumbnails"

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for path in FOLDER.glob("*.png"):
        path.unlink()
    for preset in PRESETS:
        (FOLDER / f"{preset.name}.png").write_bytes(thumbnail_of(preset.name))
