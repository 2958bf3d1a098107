"""Histories: their functions and scripts; texts as no version of the package writes them, foreign, damaged, hostile."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

import xarray as xr

from cablepod import provenance

#: Characters that control a terminal, or the direction of text.
HOSTILE = "\x1b]0;owned\x07\x1b[31m\x1b[2J\x00\x08\x7f\x9b31m\u202e\u2066\u200f\u2028\x85\r"
#: Texts that would be code if they were put into a program as they are.
CODE = (
    '"); raise SystemExit("injected")  #',
    "x\nraise SystemExit('injected')",
    "__import__('os').abort()",
    "a=1, b=__import__('os').abort()",
    "'''\nimport os\nos.abort()\n'''",
)
FUNCTIONS = (
    "", "os.system", "__main__.main", "cli.main", "archive.write", "make_scene", "chain.simulate", "ensemble.run",
    "pod.decompose", "changed by hand", "..chain", "chain..simulate", "chain", "provenance.record",
    "paper.report.write", "a" * 5000, "_jit.compiled", "chain.simulate.__globals__", "é.σ", "archive._atomic.atomic_file",
)  # fmt: skip
KEYS = (
    "id", "function", "parameters", "inputs", "chosen", "written", "program", "version", "commit", "wall_time_s", "platform",
)  # fmt: skip


def functions_of(dataset: xr.Dataset) -> list[str]:
    """Return the functions of the stages of a Dataset, the first one first."""
    return [stage["function"] for stage in provenance.stages_of(dataset)]


def run_script(text: str) -> Any:
    """Run a script that makes a dataset again, but for its last line, which writes it; return what it makes."""
    body, last = text.rsplit("cp.archive.write(", 1)
    made: dict[str, Any] = {}
    exec(compile(body, "lineage", "exec"), made)
    return made[last.split(",")[0]]


def odd_value(rng: random.Random, depth: int = 0) -> Any:
    """Return a value of any type that JSON has, and texts that are worse."""
    choices = [
        None, True, -1, 0, 10**400, 1e308, float("nan"), float("inf"), "", "unknown", HOSTILE, rng.choice(CODE), [], {}, [[]],
        {"sha256": 1, "shape": None}, {"equidistant": HOSTILE, "first": "a", "last": None, "count": 10**18},
        {rng.choice(CODE): 1}, ["x", 1, None], "x" * 100_000,
    ]  # fmt: skip
    if depth < 3 and rng.random() < 0.3:
        return {rng.choice(("options", "model", "number", "scene", "values", "lambda")): odd_value(rng, depth + 1)}
    return rng.choice(choices)


def altered_history(stages: list[dict[str, Any]], seed: int) -> str:  # noqa: C901 - one branch for each kind
    """Return a history as text, altered in one to three places."""
    rng = random.Random(seed)
    stages = copy.deepcopy(stages)
    for _ in range(rng.randint(1, 3)):
        stage = rng.choice(stages)
        if not isinstance(stage, dict):
            break
        kind = rng.randrange(14)
        if kind < 4:
            stage[rng.choice(KEYS)] = odd_value(rng)
        elif kind == 4:
            stage.pop(rng.choice(KEYS), None)
        elif kind == 5:
            stage["function"] = rng.choice(FUNCTIONS)
        elif kind == 6:  # a circle
            stage["inputs"] = [other["id"] for other in stages if isinstance(other, dict) and "id" in other]
        elif kind == 7:
            stage["parameters"] = {rng.choice((*CODE, "options", "model", "step", HOSTILE)): odd_value(rng)}
        elif kind == 8:
            stages[rng.randrange(len(stages))] = odd_value(rng)
        elif kind == 9:
            stages.append(copy.deepcopy(stage))
            rng.shuffle(stages)
        elif kind == 10:
            stage["id"] = rng.choice((HOSTILE, *CODE, "x" * 10_000, " ", "unknown"))
        elif kind == 11:
            nested: Any = 1
            for _ in range(rng.choice((100, 400))):
                nested = [nested] if rng.random() < 0.5 else {"a": nested}
            stage["parameters"] = {"step": nested}
        elif kind == 12:
            stage["function"], stage["parameters"] = "ensemble.run", odd_value(rng)
        else:  # a pile of stages, each made of the one before twice
            stages += [
                {"id": f"p{i}", "function": "chain.simulate", "parameters": {}, "inputs": [f"p{i - 1}"] * 2}
                for i in range(300)
            ]
    text = json.dumps(stages)
    kind = rng.randrange(12)
    if kind == 0:
        return text[: rng.randrange(len(text))]
    if kind == 1:
        return rng.choice(
            ("[" * 100_000, '{"a":' * 50_000, "null", "5", '"text"', "", "[[]]", "[" + "9" * 5000 + "]", HOSTILE)
        )
    return text
