"""Sphinx configuration of the documentation site: pages in MyST, and a reference from the docstrings.

`make docs` builds it into docs/_build/html; warnings are errors.
"""

from importlib.metadata import version as _version
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

from docutils import nodes
from sphinx.addnodes import download_reference, pending_xref
from sphinx.application import Sphinx

_DOCS = Path(__file__).resolve().parent
_ROOT = _DOCS.parent

project = "photonbeams"
author = copyright = "The photonbeams developers"
release = version = _version("photonbeams")

extensions = [
    "myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.intersphinx", "sphinx.ext.napoleon",
    "sphinx_copybutton", "sphinx_design",
]  # fmt: skip
exclude_patterns = ["_build", "scripts", "**.ipynb_checkpoints"]
templates_path = ["_templates"]
nitpicky = False

# -- pages -----------------------------------------------------------------------------------------------------------
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
# Notebooks are executed in tests/docs, and are stored with their output.
nb_execution_mode = "off"
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True
copybutton_exclude = ".linenos, .gp, .go"

# -- reference -------------------------------------------------------------------------------------------------------
autosummary_generate = True
autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
# Empty, because the site must also build without a network.
intersphinx_mapping: dict[str, tuple[str, None]] = {}

# -- the site --------------------------------------------------------------------------------------------------------
html_theme = "furo"
html_title = "photonbeams"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.svg"
html_logo = "_static/icon.svg"
html_show_sphinx = False
html_theme_options = {
    "sidebar_hide_name": False,
    "light_css_variables": {"color-brand-primary": "#9a5b12", "color-brand-content": "#9a5b12"},
    "dark_css_variables": {"color-brand-primary": "#f0b35c", "color-brand-content": "#f0b35c"},
}


#: Files of the repository that the site shows, and their pages.
_SHOWN = {"README.md": "index", "CHANGELOG.md": "changelog", "CONTRIBUTING.md": "contributing"}


#: What links into examples/ lead to on the site: a file alone would lack its textures and layers.
_EXAMPLES = "examples.zip"


def _resolve_files(app: Sphinx, doctree: nodes.document) -> None:
    """Resolve links to files of the repository: to the page that shows the file, or to the zip of the examples.

    Of other files only the link's text is kept. Pages are also written for readers of the repository. Links to files
    that do not exist are left for MyST to report.
    """
    pages, here = app.env.found_docs, (_DOCS / app.env.docname).parent
    for link in list(doctree.findall(lambda node: isinstance(node, (pending_xref, download_reference)))):
        if isinstance(link, pending_xref) and (link.get("reftype") != "myst" or link["reftarget"] in pages):
            continue
        name, _, anchor = link["reftarget"].partition("#")
        found = [
            place
            for each in (here, _ROOT)
            for place in (each / name, each / f"{name}.md", each / f"{name}.ipynb")
            if place.exists()
        ]
        if not name or not found:
            continue
        inside = found[0].resolve().relative_to(_ROOT)
        page = _SHOWN.get(
            str(inside), str(inside.relative_to("docs").with_suffix("")) if inside.parts[0] == "docs" else ""
        )
        if inside.parts[0] == "examples":
            address = "../" * app.env.docname.count("/") + _EXAMPLES
            link.replace_self(nodes.reference("", "", *link.children, refuri=address, internal=False))
        elif isinstance(link, pending_xref) and page in pages:
            link["refdomain"], link["reftarget"], link["reftargetid"] = "doc", page, anchor or None
        elif isinstance(link, pending_xref):
            link.replace_self(link.children)


def _write_examples(app: Sphinx, error: Exception | None) -> None:
    """Write the zip of the examples beside the pages."""
    if error is None and app.builder.format == "html":
        files = [path for path in sorted((_ROOT / "examples").rglob("*")) if path.is_file()]
        with ZipFile(Path(app.outdir) / _EXAMPLES, "w", ZIP_DEFLATED) as archive:
            for path in files:
                if "__pycache__" not in path.parts:
                    archive.write(path, path.relative_to(_ROOT))


def setup(app: Sphinx) -> None:
    """Register the resolver of links and the writer of the zip with Sphinx."""
    # Before Sphinx collects the files that pages offer for download.
    app.connect("doctree-read", _resolve_files, priority=100)
    app.connect("build-finished", _write_examples)
