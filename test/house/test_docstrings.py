"""Public names are documented in numpydoc style, and arrays say their shape."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted(path for path in ROOT.glob("radar_*/**/*.py"))


def public(tree: ast.Module):
    """Module, classes, functions and methods whose names do not start with an underscore."""
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
            yield node.name, node
            if isinstance(node, ast.ClassDef):
                for child in node.body:
                    if isinstance(child, ast.FunctionDef) and not child.name.startswith("_"):
                        yield f"{node.name}.{child.name}", child


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_public_docstrings(path):
    """Every public name has one; a "Parameters" section names only real parameters; an array entry says its shape or its type's."""
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), "the module needs a docstring"
    problems = []
    for name, node in public(tree):
        doc = ast.get_docstring(node) or ""
        if not doc:
            problems.append(f"{name} has no docstring")
        section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n-+\n|\Z)", doc, re.M | re.S)
        if section and isinstance(node, ast.FunctionDef):
            arguments = (
                node.args.posonlyargs + node.args.args + node.args.kwonlyargs + [a for a in (node.args.vararg, node.args.kwarg) if a]
            )
            real = {a.arg for a in arguments}
            for line in re.findall(r"^(\S[^:\n]*) : ([^\n]*)", section[1], re.M):
                named = {part.strip().lstrip("*") for part in line[0].split(",")}
                if not named <= real:
                    problems.append(f"{name} documents {named - real}, which it does not take")
                if "ndarray" in line[1] and "shape" not in line[1] and not re.search(r"\([^)]*\)", section[1]):
                    problems.append(f"{name}: {line[0]} is an array without a shape")
    assert not problems, "\n".join(problems)
