"""Build the extension for Blender: out/photonbeams-VERSION.zip. `make blender` calls it.

The zip has the engine alone. It starts a Python that has photonbeams, which the add-on's preferences choose.
"""

import re
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "photonbeams" / "blender" / "extension"


def build(folder: Path) -> Path:
    """Write the zip into a folder, and return its path."""
    manifest = (SOURCE / "blender_manifest.toml").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.+)"$', manifest, re.MULTILINE)[1]
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"photonbeams-{version}.zip"
    files = [path for path in sorted(SOURCE.rglob("*")) if path.suffix in (".py", ".toml", ".json", ".png")]
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in [*files, ROOT / "LICENSE"]:
            archive.write(path, path.name if path.parent == ROOT else path.relative_to(SOURCE))
    return target


if __name__ == "__main__":
    print(build(Path(sys.argv[1]) if sys.argv[1:] else ROOT / "out"))
