"""Write the tables of settings in docs/reference/settings.md and docs/mitsuba.md, from the fields of `Settings`.

Run `python docs/scripts/settings.py` after a change of a setting; tests/docs/test_reference.py compares the tables.
"""

import re
from pathlib import Path

from photonbeams import integrator
from photonbeams.render.settings import described, flags, parameters
from photonbeams.setting import Setting

_DOCS = Path(__file__).resolve().parents[1]

#: The pages, and what the line before the table begins with.
PAGES = {"reference/settings.md": "| setting ", "mitsuba.md": "| name | default | meaning"}


def settings_table() -> str:
    """Return a table of all settings, with their flags and the parameters of the plug-in."""
    rows = ["| setting | type | default | flags | `photon_beams` | meaning |", "|---|---|---|---|---|---|"]
    for name, own in described():
        given = [", ".join(f"`{each.name}`" for of, each in group() if of == name) for group in (flags, parameters)]
        kind = "object" if own.kind is object else own.type_name
        only = {"stage": " (stages only)", "scene": " (Mitsuba scenes only)"}.get(own.reader, "")
        rows.append(_row(f"`{name}`", kind, _default(own), *given, own.help + only))
    return "\n".join(rows)


def parameters_table() -> str:
    """Return a table of the plug-in's parameters."""
    rows = ["| name | default | meaning |", "|---|---|---|"]
    for each in [*(found for _, found in parameters()), integrator.LAYERS]:
        default = "0" if each.default is None else _default(each).replace("True", "true").replace("False", "false")
        rows.append(_row(f"`{each.name}`", default, each.help))
    return "\n".join(rows)


def _default(own: Setting) -> str:
    """Return a default as text, "" where the scene decides."""
    value = own.default
    return "" if value is None else f"`{value}`" if isinstance(value, str) else f"{value}"


def _row(*cells: str) -> str:
    return f"| {' | '.join(each.replace('|', chr(92) + '|') for each in cells)} |"


def pages() -> dict[Path, str]:
    """Return the pages with their tables as they ought to be."""
    tables = {"reference/settings.md": settings_table(), "mitsuba.md": parameters_table()}
    found = {}
    for name, table in tables.items():
        text = (_DOCS / name).read_text()
        begin = re.escape(PAGES[name])
        found[_DOCS / name] = re.sub(rf"^{begin}.*\n(?:\|.*\n)+", lambda _, new=table: new + "\n", text, flags=re.M)
    return found


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text)
