"""Mutation testing of one pure module: every small change of its code must make its tests fail.

    python -m tests.mutation.run drivers.gate tests/unit/drivers/test_gate.py
    NUMBA_DISABLE_JIT=1 python -m tests.mutation.run stack.servo.limiter tests/laws/test_servo_limits.py

Kernels have to be run without their compiler, or the changed ones would get into its cache.
Each mutant is a changed syntax tree, loaded in a child process in place of the module, two at a time. Prints the survivors with line and
change. Annotations are left alone: nothing evaluates them. A mutant that does not end within `PATIENCE_S` counts as killed.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import importlib
import os
import signal
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest

AT_ONCE = 2
PATIENCE_S = 120
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATIONS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.Pow: ast.Mult,
}


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Everything that this node may be turned into: (what, the new node)."""
    if isinstance(node, ast.Compare):
        for position, operator in enumerate(node.ops):
            for other in COMPARISONS.get(type(operator), ()):
                changed = copy.deepcopy(node)
                changed.ops[position] = other()
                yield f"{type(operator).__name__} -> {other.__name__}", changed
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATIONS:
        changed_operation = copy.deepcopy(node)
        changed_operation.op = OPERATIONS[type(node.op)]()
        yield f"{type(node.op).__name__} -> {type(changed_operation.op).__name__}", changed_operation
    elif isinstance(node, ast.BoolOp):
        changed_bool = copy.deepcopy(node)
        changed_bool.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield "and <-> or", changed_bool
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield f"without {type(node.op).__name__}", node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield f"{node.value} -> {not node.value}", ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield f"{node.value} -> {node.value + 1}", ast.Constant(node.value + 1)
    elif isinstance(node, ast.IfExp):
        yield "if-else turned round", ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.AugAssign):
        yield "assignment left out", ast.Pass()


class _Replace(ast.NodeTransformer):
    def __init__(self, target: ast.AST, new: ast.AST) -> None:
        self.target, self.new = target, new

    def visit(self, node: ast.AST) -> ast.AST:
        return ast.copy_location(self.new, node) if node is self.target else self.generic_visit(node)


def in_annotations(tree: ast.AST) -> set[int]:
    """Places in `ast.walk(tree)` of everything inside an annotation."""
    inside: set[int] = set()
    for node in ast.walk(tree):
        for name in ("annotation", "returns"):
            annotation = getattr(node, name, None)
            if annotation is not None:
                inside |= {id(part) for part in ast.walk(annotation)}
    return {place for place, node in enumerate(ast.walk(tree)) if id(node) in inside}


def mutants(source: str) -> Iterator[tuple[int, str, ast.Module]]:
    """(line, change, tree) of every mutant."""
    whole = ast.parse(source)
    left_alone = in_annotations(whole)
    for index, original in enumerate(list(ast.walk(whole))):
        if index in left_alone:
            continue
        for number, (what, _) in enumerate(changes(original)):
            tree = ast.parse(source)
            node = list(ast.walk(tree))[index]
            _, new = list(changes(node))[number]
            changed = ast.fix_missing_locations(_Replace(node, new).visit(tree))
            yield getattr(node, "lineno", 0), what, changed


def start(module: types.ModuleType, tree: ast.Module, tests: list[str]) -> int:
    """Runs the tests with the changed module in a child process; its id. It ends with 0 where they pass."""
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        signal.alarm(PATIENCE_S)
        status = 1
        with contextlib.suppress(BaseException):
            changed = types.ModuleType(module.__name__)
            changed.__file__, changed.__package__ = module.__file__, module.__package__
            sys.modules[module.__name__] = changed
            parent, _, name = module.__name__.rpartition(".")
            for other in [
                other for other in sys.modules if other.startswith(f"{parent}.") and other != module.__name__
            ]:
                del sys.modules[other]  # what has imported the sound module must import the changed one
            setattr(sys.modules[parent], name, changed)
            exec(compile(tree, str(module.__file__), "exec"), changed.__dict__)
            options = ["-q", "-x", "-p", "no:cacheprovider", "-k", "not untried", "--hypothesis-profile=quick"]
            status = int(pytest.main([*options, *tests]))
        os._exit(0 if status == 0 else 1)
    return child


def main(name: str, tests: list[str]) -> int:
    module = importlib.import_module(name)
    source = Path(str(module.__file__)).read_text(encoding="utf-8")
    lines = source.splitlines()
    total, survivors = 0, 0
    running: dict[int, tuple[int, str]] = {}

    def wait() -> int:
        child, status = os.wait()
        line, what = running.pop(child)
        if status == 0:
            print(f"survives: {name}:{line}  {what}  | {lines[line - 1].strip()}", flush=True)
        return int(status == 0)

    sound = start(module, ast.parse(source), tests)
    if os.waitpid(sound, 0)[1] != 0:
        raise SystemExit(f"{name}: the tests fail without any change")
    for line, what, tree in mutants(source):
        total += 1
        running[start(module, tree, tests)] = line, what
        if len(running) >= AT_ONCE:
            survivors += wait()
    while running:
        survivors += wait()
    print(f"{name}: {total} mutants, {total - survivors} killed, {survivors} survive")
    return survivors


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
