"""What the reference is made of: parameters documented, links and references that lead somewhere, examples that run."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import itertools
import pkgutil
import pydoc
import re
import typing
from pathlib import Path
from types import ModuleType

import _links
import pytest
from scenes import ROOT

import cablepod as cp
from cablepod import examples as shipped

PACKAGE = Path(cp.__file__).parent
PUBLIC = [item for name in cp.__all__ if inspect.ismodule(item := getattr(cp, name))] + [shipped]
#: These are what a new user calls first.
MAIN = (
    cp.make_scene, cp.read_scene, cp.catenary.rest, cp.catenary.solve, cp.chain.rest, cp.chain.simulate, cp.cable.frequencies,
    cp.pod.decompose, cp.pod.reconstruct, cp.galerkin.simulate, cp.condensed.simulate, cp.condensed.vibration_modes,
    cp.compare.errors, cp.archive.write, cp.archive.describe, cp.study.run, cp.snapshots, cp.modes,
)  # fmt: skip


def functions() -> list:
    """Every public function, and every public method of a public class."""
    found = [getattr(cp, name) for name in cp.__all__] + [getattr(m, name) for m in PUBLIC for name in m.__all__]
    methods = [item for c in found if inspect.isclass(c) for name, item in vars(c).items() if not name.startswith("_")]
    callables = [item.__func__ if isinstance(item, classmethod) else item for item in (*found, *methods)]
    return [item for item in callables if inspect.isfunction(item)]


def documented(text: str) -> list[str]:
    """Names under the heading Parameters of a numpydoc docstring."""
    section = re.search(r"^Parameters\n-{10}\n(.*?)(?=\n\n\w[\w ]*\n-{3,}\n|\Z)", text, re.DOTALL | re.MULTILINE)
    lines = section[1].splitlines() if section else []
    heads = [line.partition(" : ")[0] for line in lines if line and not line[0].isspace()]
    return [name.strip().lstrip("*") for head in heads for name in head.split(",")]


def test_every_parameter_is_documented():
    for function in functions():
        parameters = [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]
        text, name = inspect.getdoc(function) or "", f"{function.__module__}.{function.__qualname__}"
        assert text, name
        # one parameter may stand in the first sentence, which then names it
        if documented(text) or len(parameters) > 1:
            assert documented(text) == parameters, name
        assert all(parameter in text for parameter in parameters), name


def test_a_parameter_that_is_forgotten_is_seen():
    text = "Do.\n\nParameters\n----------\na, b\n    Two.\n*c\n    More.\n\nReturns\n-------\nint\n    d.\n"
    assert documented(text) == ["a", "b", "c"]


def resolves(name: str, module: ModuleType) -> bool:
    """Tell whether a docstring of `module` refers to something of it, of its sub-package, or to a full name."""
    first, *rest = name.split(".")
    folder = module.__name__ if hasattr(module, "__path__") else module.__name__.rpartition(".")[0]
    places = [
        module,
        *(item for item in vars(module).values() if inspect.isclass(item) and item.__module__ == module.__name__),
    ]
    if folder != "cablepod":
        path = importlib.import_module(folder).__path__
        places += [importlib.import_module(f"{folder}.{item.name}") for item in pkgutil.iter_modules(path)]
    for place in places:
        item = getattr(place, first, None)
        for part in rest:
            item = getattr(item, part, None)
        if item is not None:
            return True
    return pydoc.locate(name) is not None


def test_references_lead_somewhere():
    broken = []
    for path in sorted(PACKAGE.rglob("*.py")):
        nodes = ast.walk(ast.parse(path.read_text()))
        texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
        if names := {
            name for text in texts for name in re.findall(r":(?:func|class|meth|data|mod|exc):`([\w.]+)`", text)
        }:
            parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
            module = importlib.import_module(".".join(parts).removesuffix(".__init__"))
            broken += [f"{path.relative_to(PACKAGE)}: {name}" for name in sorted(names) if not resolves(name, module)]
    assert not broken, "\n".join(broken)


def test_a_reference_to_nothing_is_seen():
    assert resolves("simulate", cp.chain)
    assert resolves("cablepod.discretisation._similarity.features", cp.chain)
    assert not resolves("simulated", cp.chain)
    assert not resolves("cablepod.discretisation._similarity.feature", cp.chain)


WITH_EXAMPLES = {
    f"{f.__module__}.{f.__qualname__}": f for f in (*MAIN, *functions()) if f in MAIN or ">>>" in (f.__doc__ or "")
}


@pytest.mark.parametrize("function", WITH_EXAMPLES.values(), ids=WITH_EXAMPLES)
def test_examples_run(function, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(shipped.data_folder())
    (test,) = doctest.DocTestFinder(recurse=False).find(inspect.unwrap(function), function.__qualname__, globs={})
    assert test.examples, f"{function.__qualname__} has no example"
    said: list[str] = []
    assert doctest.DocTestRunner().run(test, out=said.append).failed == 0, "".join(said)


def test_links_of_all_pages_lead_somewhere():
    assert len(_links.markdown_pages(ROOT)) > 30
    assert list(_links.broken_markdown_links(ROOT)) == []


@pytest.mark.parametrize(
    ("text", "broken"),
    [
        (
            "[a](b/README.md), [a](b/README.md#the-error-r2), [c](b), ![d](d.png), [e](https://e.org/x), [f](#here-1)",
            [],
        ),
        ("[a](c/README.md)", ["c/README.md"]),
        ("![a](a.png)", ["a.png"]),
        ("[`a`](b/README.md#error)", ["b/README.md#error"]),
        ("[a](#there)", ["#there"]),
        ("[a](d.png#here)", ["d.png#here"]),
        ("[a](../README.md)", ["../README.md"]),
        ("`[a](c.md)` $[a](c.md)$\n```py\n[a](c.md)\n# There\n```\n[a](#there)", ["#there"]),
    ],
)
def test_a_broken_link_in_a_page_is_seen(text, broken, tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "d.png").touch()
    (tmp_path / "b/README.md").write_text("# The `error`: r2\n\n[up](../README.md#here)\n")
    (tmp_path / "out/page.md").write_text("[a](nowhere.md)")
    (tmp_path / "README.md").write_text(f"# Here\n\n{text}\n\n## Here\n")
    assert list(_links.broken_markdown_links(tmp_path)) == [f"README.md: {link} leads nowhere" for link in broken]


def test_a_broken_link_in_the_reference_is_seen(tmp_path):
    (tmp_path / "a.html").write_text('<p id="x"><a href="b.html#y"><a href="#x"><a href="https://c.org">')
    (tmp_path / "b.html").write_text('<p id="y"><a href="a.html#z"><img src="c.png"><a href="a.html">')
    assert sorted(_links.broken_html_links(tmp_path)) == [
        f"b.html: {link} leads nowhere" for link in ("a.html#z", "c.png")
    ]


def test_pages_of_the_reference():
    docs = pytest.importorskip("docs", reason="needs the extra docs", exc_type=ImportError)
    pages = {"cablepod.chain", "cablepod.chain._x", "cablepod.pod", "cablepod"}
    text = "[p](../pod/README.md#a), [`c`](../README.md), [d](../../data/README.md), [e](https://e.org) `[p](../pod/README.md)`"
    source = ROOT / "cablepod/chain"
    moved = "[p](pod.html#a), [`c`](../cablepod.html), d, [e](https://e.org) `[p](../pod/README.md)`"
    assert docs.with_page_links(text, source, "cablepod.chain", pages) == moved
    assert docs.with_page_links("[p](../pod/README.md)", source, "cablepod.chain._x", pages) == "[p](../pod.html)"
    formula = r"$a_1 < b_2 \\ \lbrace *c* \rbrace$"
    page = docs.to_html_with_formulas(f"# A\n\nSo {formula} and `$x_1$`\n\n$$\n\\_x\n$$\n")
    assert formula.replace("<", "&lt;") in page
    assert "$$\n\\_x\n$$" in page
    assert "A</a>" in page.toc_html


def test_named_tuples_of_the_reference_have_types_that_are_found():
    """Where annotations are texts, a named tuple does not know the module that has their names: no page can show them."""
    docs = pytest.importorskip("docs", reason="needs the extra docs", exc_type=ImportError)
    modules = [docs.pdoc.doc.Module.from_name(name) for name in docs.pdoc.extract.walk_specs(docs.MODULES)]
    for item in itertools.chain.from_iterable(map(docs.members, modules)):
        if isinstance(item, docs.pdoc.doc.Class) and issubclass(item.obj, tuple):
            assert typing.get_type_hints(item.obj.__new__), item.fullname
