"""Write what is made from the source of the USD schemas, `src/photonbeams/usd/schema/schema.usda`.

That is `generatedSchema.usda`, the file that OpenUSD reads (pip's build of OpenUSD has no usdGenSchema), and the tables
of attributes in docs/looks.md and docs/reference/attributes.md. Run `python tools/schema.py` after a change of them;
tests/usd/common/test_definitions.py compares the files.
"""

import re
from pathlib import Path

from photonbeams.usd.common.definitions import CURVES, FOLDER, LIGHT, LOOK, MEDIUM, PREFIX, Definition, definitions

_DOCS = Path(__file__).resolve().parents[1] / "docs"

#: The pages with tables, by the schemas.
PAGES = {"looks.md": (LOOK,), "reference/attributes.md": (LIGHT, CURVES, MEDIUM)}


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


def files() -> dict[Path, str]:
    """Return the files as they ought to be."""
    found = {FOLDER / "generatedSchema.usda": generated()}
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
