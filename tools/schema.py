"""Write what is made from the source of the USD schemas, `src/photonbeams/usd/schema/schema.usda`.

That is `generatedSchema.usda`, the file that OpenUSD reads (pip's build of OpenUSD has no usdGenSchema), the tables of
attributes in docs/looks.md and docs/reference/attributes.md, and what Blender's extension knows of looks. Run
`python tools/schema.py` after a change of them; tests/usd/common/test_definitions.py compares the files.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from photonbeams.looks.ramp import interpolate
from photonbeams.usd.authoring.presets import PRESETS
from photonbeams.usd.common.definitions import (
    BLOCKER,
    CAMERA,
    CURVES,
    FOLDER,
    LIGHT,
    LOOK,
    MEDIUM,
    PREFIX,
    RAMP,
    Definition,
    definitions,
)

_ROOT = Path(__file__).resolve().parents[1]
_DOCS = _ROOT / "docs"
_EXTENSION = _ROOT / "src" / "photonbeams" / "blender" / "extension" / "looks.json"

#: The pages with tables, by the schemas.
PAGES = {"looks.md": (LOOK,), "reference/attributes.md": (LIGHT, CURVES, MEDIUM, CAMERA, BLOCKER, RAMP)}


def generated() -> str:
    """Return the text of generatedSchema.usda: the schemas without what only usdGenSchema reads."""
    text = (FOLDER / "schema.usda").read_text()
    head, _, classes = text.partition('over "GLOBAL"')
    classes = classes[classes.index("class ") :]
    classes = re.sub(r"^    customData = \{\n.*?^    \}\n", "", classes, flags=re.M | re.S)
    classes = re.sub(r"^    inherits = .*\n", "", classes, flags=re.M)
    return f"{head.splitlines()[0]}\n\n{classes}"


def table(schema: str) -> str:
    """Return a table of a schema's attributes."""
    rows = ["| attribute | default | values | meaning |", "|---|---|---|---|"]
    for name, own in definitions(schema).items():
        doc = re.sub(r"([|*<])", r"\\\1", own.doc)
        cells = (f"`{name.removeprefix(PREFIX)}`", _default(own), _values(own), doc)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _default(own: Definition) -> str:
    if own.default is None or own.default in ("", []):
        return ""
    if own.kind == "bool":
        return "on" if own.default else "off"
    return f"`{own.default}`" if own.kind == "choice" else str(own.default).strip("[]")


def _values(own: Definition) -> str:
    if own.choices:
        return ", ".join(f'`"{each}"`' for each in own.choices)
    if own.least is None:
        return {"paths": "prims", "asset": "a file"}.get(own.kind, own.kind)
    bound = "above" if own.open else "from"
    if own.most is None:
        return f"{bound} {own.least:g}" if own.open else f"{own.least:g} or more"
    return f"between {own.least:g} and {own.most:g}" if own.open else f"{own.least:g} to {own.most:,.10g}"


def looks() -> str:
    """Return the attributes and the presets of looks, as the extension reads them.

    Blender's widgets make ramps and tables, so these have no attributes. Its ramps know three interpolations; those of
    presets with another one are given as many colours.
    """
    attributes = {
        name.removeprefix(PREFIX): {key: value for key, value in asdict(own).items() if key != "name"}
        for name, own in definitions(LOOK).items()
        if ":ramp:" not in name and not name.endswith("across:values")
    }
    presets = [
        {"name": each.name, "factor": each.factor, "label": each.label, "values": _plain_ramps(each.attributes())}
        for each in PRESETS
    ]
    return json.dumps({"attributes": attributes, "presets": presets}, indent=1) + "\n"


def _plain_ramps(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a preset by names without the prefix; ramps have interpolations that Blender has."""
    values = {name.removeprefix(PREFIX): value for name, value in given.items()}
    for name in [each for each in values if each.endswith(":ramp:interpolation")]:
        ramp = name.rpartition(":")[0]
        if values[name] not in ("none", "linear", "smooth"):
            knots, colors = (np.array(values[f"{ramp}:{part}"], float) for part in ("knots", "colors"))
            steps = 31 // (len(knots) - 1)  # of the 32 colours that Blender's ramps may have
            places = np.interp(np.arange((len(knots) - 1) * steps + 1) / steps, np.arange(len(knots)), knots)
            values[f"{ramp}:knots"] = places.round(4).tolist()
            values[f"{ramp}:colors"] = (
                interpolate(knots, colors, values[name].replace("catmullRom", "catmull-rom"), places).round(4).tolist()
            )
            values[name] = "linear"
    return values


def files() -> dict[Path, str]:
    """Return the files as they ought to be."""
    found = {FOLDER / "generatedSchema.usda": generated(), _EXTENSION: looks()}
    for name, schemas in PAGES.items():
        tables = iter([table(each) for each in schemas])
        text = (_DOCS / name).read_text()
        found[_DOCS / name] = re.sub(
            r"^\| attribute \| default \|.*\n(?:\|.*\n)+", lambda _, new=tables: next(new) + "\n", text, flags=re.M
        )
    return found


if __name__ == "__main__":
    for path, text in files().items():
        path.write_text(text)
