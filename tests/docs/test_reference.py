"""The docstring of every public name describes its parameters and has examples, which run."""

import doctest
import inspect
import re
import sys
from dataclasses import fields, is_dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from numpydoc.docscrape import NumpyDocString

import photonbeams as pb
import photonbeams.studio.widget
from docs.scripts.settings import pages

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "index.md"
NAMES = re.findall(r"^   ([\w.]+)$", PAGE.read_text(), re.MULTILINE)
#: Names for type checkers, which cannot be called.
NO_OBJECTS = {"Modifier"}
#: The stage that examples call shot.usda.
STAGE = """#usda 1.0
def Scope "Fog" (prepend apiSchemas = ["PhotonBeamsMediumAPI"])
{
    color3f photonbeams:scattering = (0.1, 0.1, 0.1)
}
def Camera "Camera" {}
def SphereLight "Lamp" {}
"""
DESCRIBED = ("Parameters", "Other Parameters", "Attributes")


def public(name):
    """Return the object of a public name."""
    return reduce(getattr, name.split("."), pb)


def documented(subject):
    """Return the names that a docstring describes: "s" and "t" for "s, t", and "more" for "**more".

    A class may leave the description of attributes to a public base class that it names in `backquotes`.
    """
    text = inspect.getdoc(subject) or ""
    sections = NumpyDocString(text)
    rows = [row.name for section in DESCRIBED for row in sections[section]]
    names = {each.strip(" *`") for row in rows for each in row.split(",")}
    bases = [each for each in getattr(subject, "__mro__", ())[1:] if each in map(public, NAMES)]
    return names.union(*(documented(base) for base in bases if f"`{base.__name__}`" in text))


def parameters(subject):
    """Return the names of the parameters that a caller passes."""
    if is_dataclass(subject):
        return {each.name for each in fields(subject) if each.init and not each.name.startswith("_")}
    made = subject.__init__ if inspect.isclass(subject) else subject
    if made is object.__init__:
        return set()
    names = {name.lstrip("_") for name in inspect.signature(made).parameters}
    return names - {"self", "cls", "args", "kwargs", ""}


def methods(subject):
    """Return the names of the public methods that a class itself defines."""
    if not inspect.isclass(subject):
        return []
    names = [name for name in vars(subject) if not name.startswith("_")]
    kinds = (staticmethod, classmethod)
    return [name for name in names if inspect.isfunction(vars(subject)[name]) or isinstance(vars(subject)[name], kinds)]


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_describes_what_it_takes(name):
    subject = public(name)
    assert name in NO_OBJECTS or parameters(subject) - documented(subject) == set()
    for method in methods(subject):
        first = next(each for each in reversed(subject.__mro__) if method in vars(each))
        if first is subject:
            taken = parameters(getattr(subject, method))
            text = inspect.getdoc(getattr(subject, method)) or ""
            # A docstring of one line needs no table: it names the parameters in `backquotes`.
            named = documented(getattr(subject, method)) | set(re.findall(r"`(\w+)`", text))
            assert text, f"{name}.{method}"
            assert taken - named == set(), f"{name}.{method}"


def test_the_tables_of_settings_say_what_the_settings_say():
    for path, text in pages().items():
        assert path.read_text() == text, "run docs/scripts/settings.py"


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_of_a_public_name_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shot.usda").write_text(STAGE)
    subject = public(name)
    assert name in NO_OBJECTS or NumpyDocString(inspect.getdoc(subject))["Examples"], f"{name} has no example"
    module = sys.modules[getattr(subject, "__module__", "photonbeams")]
    names = {**vars(module), "pb": pb, "np": np}
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    report = []
    for test in doctest.DocTestFinder().find(subject, name, module, names):
        runner.run(test, out=report.append)
    assert runner.failures == 0, "".join(report)
