"""Writes docs/src/python-reference.md from the docstrings and signatures of the package.

    python python/reference.py            # --check only says whether it is as it should be
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "src" / "python-reference.md"
HEAD = """# Reference of the Python package

Made by `python python/reference.py` from the docstrings of the package. [Skysink in Python](python.md) is where to begin.
"""
SOURCES = {
    "skysink": ["_skysink.pyi", "strategy.py", "flight.py", "sweeps.py"],
    "skysink.environment": ["environment.py"],
    "skysink.ring": ["ring.py"],
}
PUBLIC = {
    "skysink": [
        "Scenario", "simulate", "Run", "Table", "Strategy", "View", "Field", "Decision", "compare", "sweep", "InputError",
    ],
    "skysink.environment": ["DataCollectionEnv", "DataCollectionVectorEnv"],
    "skysink.ring": ["planner"],
}  # fmt: skip

Documented = ast.ClassDef | ast.FunctionDef


def definitions(module: str) -> dict[str, Documented]:
    """The classes and functions of a module by name; what has a docstring counts before what has none."""
    found: dict[str, Documented] = {}
    for source in SOURCES[module]:
        for node in ast.parse((HERE / "skysink" / source).read_text()).body:
            if isinstance(node, Documented) and (node.name not in found or ast.get_docstring(node)):
                found[node.name] = node
    return found


def methods(node: ast.ClassDef, found: dict[str, Documented]) -> list[ast.FunctionDef]:
    """The methods of a class, then those of its bases in the same module."""
    own = [item for item in node.body if isinstance(item, ast.FunctionDef)]
    bases = [found.get(base.id) for base in node.bases if isinstance(base, ast.Name)]
    return own + [item for base in bases if isinstance(base, ast.ClassDef) for item in methods(base, found)]


def signature(function: ast.FunctionDef, name: str) -> str:
    """A call as it is written, without self; a property without brackets."""
    decorators = [decorator.id for decorator in function.decorator_list if isinstance(decorator, ast.Name)]
    result = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    if "property" in decorators:
        return f"{name}{result.replace(' ->', ':')}"
    arguments = function.args
    if arguments.args and arguments.args[0].arg in ("self", "cls"):
        del arguments.args[0]
    elif arguments.posonlyargs and arguments.posonlyargs[0].arg in ("self", "cls"):
        del arguments.posonlyargs[0]
    return f"{name}({ast.unparse(arguments)}){result}"


def text(node: Documented) -> str:
    """Its docstring in Markdown."""
    doc = ast.get_docstring(node) or ""
    for role in (":func:", ":class:", ":meth:", ":data:"):
        doc = doc.replace(role, "")
    return doc.replace("``", "`").replace("`skysink.", "`")


def lines() -> Iterator[str]:
    """The page."""
    yield HEAD
    for module, names in PUBLIC.items():
        yield f"## {module}\n"
        found = definitions(module)
        preface = ast.get_docstring(ast.parse((HERE / "skysink" / "environment.py").read_text()))
        if module.endswith("environment") and preface:
            yield preface.replace("``", "`") + "\n"
        for name in names:
            node = found[name]
            if isinstance(node, ast.FunctionDef):
                yield f"### `{signature(node, name)}`\n\n{text(node)}\n"
                continue
            yield f"### {name}\n\n{text(node)}\n"
            for item in methods(node, found):
                if ast.get_docstring(item) and (not item.name.startswith("_") or item.name.startswith("__")):
                    call = name if item.name == "__new__" else item.name.replace("__getitem__", "[]")
                    yield f"- `{signature(item, call)}`: {' '.join(text(item).split())}"
            yield ""


def main() -> int:
    page = "\n".join(lines()).rstrip() + "\n"
    while "\n\n\n" in page:
        page = page.replace("\n\n\n", "\n\n")
    if "--check" in sys.argv:
        return int(PAGE.read_text() != page)
    PAGE.write_text(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
