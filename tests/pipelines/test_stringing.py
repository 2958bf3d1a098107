"""The study of stringing tables: its page holds what it computes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stringing import run

PAGE = Path(run.__file__).with_name("README.md")


def test_the_page_holds_the_numbers(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["run.py"])
    run.main()
    said = capsys.readouterr().out
    rows = [line for line in said.splitlines() if line.startswith("|") and "---" not in line]
    assert len(rows) == 1 + 15 + 1 + 3
    page = PAGE.read_text(encoding="utf-8")
    assert [row for row in rows if row not in page] == []


def test_the_cubic_is_that_of_the_book():
    # T^3 + T^2 (a E (alpha t + (w1 l / T1)^2 / 6) - T1) - w2^2 l^2 a E / 6 = 0 with half the span l, in kgf and mm2
    book, half = run.BOOK, 150.0
    ice = np.pi * 915.0 * 9.5e-3 * (19.53e-3 + 9.5e-3)
    worst = np.hypot(0.844 + ice, 39.0 * (19.53e-3 + 19e-3))
    stiffness = book["area"] * book["modulus"]
    square = stiffness * (18.44e-6 * 50.0 + (worst * half / 3975.0) ** 2 / 6.0) - 3975.0
    roots = np.roots([1.0, square, 0.0, -((0.844 * half) ** 2) * stiffness / 6.0])
    (root,) = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0.0)].real
    assert run.example()[2] == pytest.approx(root, rel=1e-8)


def test_a_short_tight_span_is_a_parabola():
    forces, sags = run.conductor(20.0)
    # what is left: the load of the catenary is per unstretched length, strained by up to 2e-3
    np.testing.assert_allclose(forces[1], forces[0], rtol=3e-3)
    np.testing.assert_allclose(sags[1], sags[0], rtol=5e-3)
