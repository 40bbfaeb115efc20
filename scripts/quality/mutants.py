"""Small changes of modules for mutation testing, and the loader that replaces a module by a mutant."""

from __future__ import annotations

import ast
import copy
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType

_TWO_WAYS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Mult: ast.Div,
    ast.BitAnd: ast.BitOr,
    ast.Lt: ast.LtE,
    ast.Gt: ast.GtE,
    ast.Eq: ast.NotEq,
    ast.Is: ast.IsNot,
    ast.In: ast.NotIn,
    ast.And: ast.Or,
    ast.Continue: ast.Break,
}
_OTHER: dict[type[ast.AST], type[ast.AST]] = {
    **_TWO_WAYS,
    **{after: before for before, after in _TWO_WAYS.items()},
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
}
_PAIRS = (("min", "max"), ("minimum", "maximum"), ("any", "all"), ("argmin", "argmax"), ("floor", "ceil"))
_OTHER_NAME = {
    **dict(_PAIRS),
    **{after: before for before, after in _PAIRS},
    "zeros": "ones",
    "zeros_like": "ones_like",
}
_NOTHING = ("conj", "copy", "abs", "sqrt")
"""Functions of one value that a mutant omits, so that the value is unchanged."""


@dataclass(frozen=True)
class Mutant:
    """Change of a module.

    Parameters
    ----------
    path : Path
        File of the module.
    number : int
        Number of the change in the file, from 0.
    line : int
        Line of the change.
    change : str
        Old and new code.
    """

    path: Path
    number: int
    line: int
    change: str


def mutants(path: Path) -> list[Mutant]:
    """Return all possible changes of a file, in order."""
    walk = _Changer(path, wanted=-1)
    walk.visit(ast.parse(path.read_text(encoding="utf-8")))
    return walk.found


def mutated(mutant: Mutant) -> ast.Module:
    """Return the changed module."""
    tree = ast.parse(mutant.path.read_text(encoding="utf-8"))
    return ast.fix_missing_locations(_Changer(mutant.path, wanted=mutant.number).visit(tree))


def install(mutant: Mutant, module: str) -> None:
    """Make the next import of a module, which must not be imported yet, find the mutant."""
    if module in sys.modules:
        raise RuntimeError(f"{module} was imported already; the mutant would not be seen.")
    sys.meta_path.insert(0, _Finder(module, mutant))


class _Finder(MetaPathFinder):
    def __init__(self, module: str, mutant: Mutant) -> None:
        self._module, self._mutant = module, mutant

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._module:
            return None
        return spec_from_file_location(fullname, self._mutant.path, loader=_Loader(fullname, self._mutant))


class _Loader(SourceFileLoader):
    def __init__(self, fullname: str, mutant: Mutant) -> None:
        super().__init__(fullname, str(mutant.path))
        self._mutant = mutant

    def get_code(self, fullname: str) -> CodeType:
        return compile(mutated(self._mutant), self.path, "exec", dont_inherit=True)


class _Changer(ast.NodeTransformer):
    """Transformer that counts the changes and makes the wanted one; errors and annotations are not changed."""

    def __init__(self, path: Path, *, wanted: int) -> None:
        self._path, self._wanted = path, wanted
        self.found: list[Mutant] = []

    def visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
            return node
        for after in _alternatives(node):
            number = len(self.found)
            line = getattr(node, "lineno", 0)
            self.found.append(Mutant(self._path, number, line, f"{_short(node)}  →  {_short(after)}"))
            if number == self._wanted:
                return ast.copy_location(after, node)
        for field, value in ast.iter_fields(node):
            if field in ("annotation", "returns", "decorator_list"):
                continue
            if isinstance(value, list):
                value[:] = [self.visit(item) if isinstance(item, ast.AST) else item for item in value]
            elif isinstance(value, ast.AST):
                setattr(node, field, self.visit(value))
        return node


def _alternatives(node: ast.AST) -> Iterator[ast.AST]:  # noqa: PLR0912
    match node:
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign() if type(node.op) in _OTHER:
            yield _with(node, op=_OTHER[type(node.op)]())
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                if type(operator) in _OTHER:
                    ops = [*node.ops[:place], _OTHER[type(operator)](), *node.ops[place + 1 :]]
                    yield _with(node, ops=ops)
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield node.operand
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
        case ast.Constant(value=float()):
            yield ast.Constant(2.0 * node.value if node.value else 1.0)
        case ast.Call(func=ast.Attribute(attr=name, value=owner)) if name in _NOTHING:
            yield node.args[0] if node.args else owner
        case ast.Call(func=ast.Attribute(attr=name)) if name in _OTHER_NAME:
            yield _with(node, func=_with(node.func, attr=_OTHER_NAME[name]))
        case ast.Call(func=ast.Name(id=name)) if name in _OTHER_NAME:
            yield _with(node, func=_with(node.func, id=_OTHER_NAME[name]))
        case ast.If() | ast.IfExp() | ast.While() if isinstance(node.test, ast.Name | ast.Attribute | ast.Call):
            yield _with(node, test=ast.UnaryOp(op=ast.Not(), operand=node.test))
        case ast.Continue() | ast.Break():
            yield _OTHER[type(node)]()
        case ast.Expr(value=ast.Call()) | ast.Assign(targets=[ast.Subscript()]):
            yield ast.Pass()


def _with(node: ast.AST, **changed: object) -> ast.AST:
    other = copy.copy(node)
    for field, value in changed.items():
        setattr(other, field, value)
    return other


def _short(node: ast.AST) -> str:
    text = " ".join(ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).split())
    return text if len(text) <= 90 else f"{text[:87]}…"
