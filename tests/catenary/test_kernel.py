"""The solution of the catenary against a 50-digit reference that shares no formula with it."""

import itertools
import math

import numpy as np
import pytest
from references import catenary_mpmath as reference

from cablepod.catenary import _formulas as kernel
from cablepod.catenary._shape import shape
from cablepod.catenary._uniform import FEW, least_tension, resolved, solve_catenaries, solve_catenary
from cablepod.parameters._keys import CATENARY_KEYS

MP = reference.MP
UNIT = 2.0**-53
# The kernel's own rounding: the worst of thousands of random cases was 1e-14 where the data fix the answer that well.
RIGHT = 5e-14

GUY = {"a": 20.40, "b": 57.70, "q": 78500 * 1.25e-4, "k": 2e7}
KINDS = {"upper": kernel.UPPER_TENSION, "lower": kernel.LOWER_TENSION, "force": kernel.HORIZONTAL_FORCE}


def solve(a, b, q, k, kind, value):
    out, status = solve_catenary((a, b, math.hypot(a, b), q), k, CATENARY_KEYS[kind], value)
    return status, out


def errors(out, cable):
    """Return relative errors of the two lengths, and of the four forces relative to the largest tension."""
    truth = cable.solution()
    most = max(truth[4:])
    return [
        float(abs(MP.mpf(float(o)) - t) / (t if j < 2 else most))
        for j, (o, t) in enumerate(zip(out, truth, strict=True))
    ]


def shape_errors(out, cable, count=9):
    """Return the largest errors of positions relative to the chord and of tensions relative to the largest."""
    s = np.linspace(0.0, out[0], count)
    across, along, tension = shape(s, out, float(cable.q), float(cable.stiffness))
    chord, most = MP.hypot(cable.a, cable.b), max(cable.tension(0), cable.tension(cable.length))
    position, force = 0.0, 0.0
    for i in range(count):
        x, y = cable.position(MP.mpf(float(s[i])))
        position = max(position, float(MP.hypot(x - across[i], y - along[i]) / chord))
        force = max(force, float(abs(cable.tension(MP.mpf(float(s[i]))) - tension[i]) / most))
    return position, force


def given_length_tolerance(cable):
    """Allow what a rounding of the length itself does: the tension hangs on the stretch, strain plus slack.

    A taut cable of strain T/K feels a relative change d of its length as a relative change d K/T of its tension; in a slack
    one the slack (L0 - c)/L0 takes the strain's place.
    """
    chord = MP.hypot(cable.a, cable.b)
    mean = (cable.tension(0) + cable.tension(cable.length)) / 2
    stretch = mean / cable.stiffness + max(0, (cable.length - chord) / cable.length)
    return RIGHT + 10 * UNIT / float(stretch)


def check(out, cable, tolerance):
    size = float(
        cable.stretched() / MP.hypot(cable.a, cable.b)
    )  # a cable stretched to 100 chords rounds in its own size
    assert max(errors(out, cable)) < tolerance
    position, force = shape_errors(out, cable)
    assert position < tolerance * max(1.0, size)
    assert force < tolerance


def check_length(a, b, q, k, length):
    """Check the cable of a given length; return what the kernel finds, and the reference."""
    status, out = solve(a, b, q, k, kernel.LENGTH, length)
    assert status == kernel.FOUND
    cable = reference.from_length(a, b, q, k, length)
    assert cable.residual() < MP.mpf(10) ** -50
    check(out, cable, given_length_tolerance(cable))
    return out, cable


def check_given(a, b, q, k, kind, value, tolerance=RIGHT):
    """Check the cable of a given tension or horizontal force."""
    status, out = solve(a, b, q, k, kind, value)
    assert status == kernel.FOUND
    check(out, reference.from_quantity(a, b, q, k, kind, value), tolerance)


def check_refused(status, *given):
    """Check that the kernel finds nothing, and says why."""
    found, out = solve(*given)
    assert found == status
    assert np.isnan(out).all()


def lengths(chord):
    taut = [chord / 300, chord / 1.5, chord * (1 - 1e-4), chord * (1 - 1e-9)]
    return [*taut, chord, chord * (1 + 1e-6), chord * 1.1, 3 * chord]


DIRECTIONS = {
    "guy": (20.40, 57.70),
    "downward": (20.40, -57.70),
    "horizontal": (60.0, 0.0),
    "nearly_horizontal": (60.0, 1e-9),
    "steep": (0.5, 60.0),
}
LOADS = {"usual": (9.8125, 2e7), "rubber": (9.8125, 1e3), "heavy_rubber": (1e4, 1e3), "heavy": (1e4, 1e8)}
TENSIONS = (1875.0, 3750.0, 7500.0, 15000.0, 30000.0)  # N, of a guy in use
LOADS |= {"stiff": (9.8125, 1e13), "light": (1e-9, 2e7), "light_stiff": (1e-9, 1e13)}


def test_reference_agrees_with_quadrature():
    # The reference's own check: x' = H (1/K + 1/T) and y' likewise, ds = 1 + T/K, integrated and not in closed form.
    for length in (61.15, 64.0, 150.0):
        cable = reference.from_length(GUY["a"], GUY["b"], GUY["q"], GUY["k"], length)
        middle = max(MP.mpf(0), min(cable.length, -cable.lower / cable.q))
        part = [0, middle / 2, middle, (middle + cable.length) / 2, cable.length] if middle else [0, cable.length]

        def per_length(s, cable=cable):
            return 1 / cable.stiffness + 1 / cable.tension(s)

        with MP.workdps(40):
            across = MP.quad(lambda s, c=cable: c.force * per_length(s, c), part)
            along = MP.quad(lambda s, c=cable: c.vertical(s) * per_length(s, c), part)
            stretched = MP.quad(lambda s, c=cable: 1 + c.tension(s) / c.stiffness, part)
        assert abs(across - cable.a) < 1e-25
        assert abs(along - cable.b) < 1e-25
        assert abs(stretched - cable.stretched()) < 1e-25
        assert cable.residual() < MP.mpf(10) ** -50


@pytest.mark.parametrize(
    ("direction", "load"),
    [*itertools.product(DIRECTIONS, LOADS.values()), *(("guy", (10.0**power, 2e7)) for power in range(-9, 5, 2))],
)
def test_given_length(direction, load):
    (a, b), (q, k) = DIRECTIONS[direction], load
    for length in lengths(math.hypot(a, b)):
        check_length(a, b, q, k, length)


@pytest.mark.parametrize(
    ("direction", "load"),
    [(direction, "usual") for direction in DIRECTIONS if direction != "steep"]
    + [(direction, "heavy_rubber") for direction in ("guy", "downward", "horizontal")]
    + [("guy", load) for load in LOADS if load not in ("usual", "heavy_rubber")],
)
def test_given_tension_or_force(direction, load):
    (a, b), (q, k) = DIRECTIONS[direction], LOADS[load]
    chord = math.hypot(a, b)
    for kind in KINDS.values():
        # from near the least tension (q c is above it, by a third and more) to a strain of hundreds in rubber
        for value in (2 * q * chord, 100 * q * chord, 300 * min(k, 1e6), *(TENSIONS if load == "usual" else ())):
            # well conditioned: the answer moves by no more than a few times the relative change of what is given
            check_given(a, b, q, k, kind, value)


@pytest.mark.parametrize("power", [1, 3, 6, 12])
@pytest.mark.parametrize("rise", [57.7, -57.7])
def test_nearly_vertical(rise, power):
    a, q, k = abs(rise) * 10.0**-power, 9.8125, 2e7
    for length in (57.0, 57.7, 57.71, 170.0):
        out, cable = check_length(a, rise, q, k, length)
        # the small force across is right relative to itself; exp(2 eta) multiplies the roundings of eta, up to 30, by that
        assert float(abs(out[2] - cable.force) / cable.force) < 10 * given_length_tolerance(cable)
        check_given(a, rise, q, k, kernel.HORIZONTAL_FORCE, float(cable.force))


@pytest.mark.parametrize("rise", [57.7, -57.7])
@pytest.mark.parametrize("stiffness", [1e3, 2e7, 1e13])
def test_vertical(rise, stiffness):
    # taut, hanging at its own length, folded at a lowest point below both ends
    for length in (20.0, 57.0, 57.69, 57.7, 58.0, 170.0):
        out, _ = check_length(0.0, rise, 9.8125, stiffness, length)
        assert out[2] == 0.0
    for name in ("upper", "lower"):
        for tension in (700.0, 1e4):
            check_given(0.0, rise, 9.8125, stiffness, KINDS[name], tension)


@pytest.mark.parametrize("a", [0.0, 1e-9, 1e-3])
@pytest.mark.parametrize("tension", [1e-3, 1.0])
def test_small_tension_at_the_lower_end_is_right_relative_to_itself(a, tension):
    # It is what was given; T - |V| tanh(eta) or |V| - w would lose it beside the 566 N at the upper end.
    for k in (1e4, 1e13):
        for rise, kind in ((57.7, kernel.LOWER_TENSION), (-57.7, kernel.UPPER_TENSION)):
            try:
                cable = reference.from_quantity(a, rise, 9.8125, k, kind, tension)
            except reference.NoCable:
                continue
            status, out = solve(a, rise, 9.8125, k, kind, tension)
            assert status == kernel.FOUND
            assert out[5 - kind] == pytest.approx(tension, rel=1e-13, abs=0.0)
            assert out[2] == pytest.approx(float(cable.force), rel=1e-13, abs=0.0)


@pytest.mark.parametrize("k", [1e3, 2e7, 1e13])
@pytest.mark.parametrize("b", [57.7, -57.7, 0.0])
def test_weightless_is_a_straight_spring(b, k):
    a = 20.4
    chord = math.hypot(a, b)
    for length in (chord / 200, chord / 2, chord * (1 - 1e-6)):
        check_length(a, b, 0.0, k, length)
    for kind in KINDS.values():
        check_given(a, b, 0.0, k, kind, 1000.0)
    check_refused(kernel.SLACK_WEIGHTLESS, a, b, 0.0, k, kernel.LENGTH, chord * 1.01)


@pytest.mark.parametrize(
    ("a", "b", "q", "k", "which", "printed"),
    [
        # The guy: 628.30 N and 62.12 N belong to an inextensible cable (628.3024 and 62.1212), 628.2922 to its K.
        (20.40, 57.70, 9.8125, 2e7, 0, 628.29223035849819),
        (20.40, 57.70, 9.8125, 2e7, 1, 62.120752661968602),
        (20.40, 57.70, 9.8125, 1e15, 0, 628.30240524536),
        (60.0, 0.0, 9.8125, 1e13, 0, None),
        (20.40, -57.70, 9.8125, 1e3, 0, None),
        (1e-6, 57.7, 9.8125, 2e7, 1, None),
        # stretched to many times its length by its own weight
        (20.40, 57.70, 1e4, 1e3, 0, None),
        (20.40, 57.70, 300.0, 1e3, 0, None),
    ],
)
def test_least_tension(a, b, q, k, which, printed):
    cable, least = reference.least(a, b, q, k, which)
    if printed is not None:
        assert float(least) == pytest.approx(printed, rel=1e-13)
    most = float(max(cable.tension(0), cable.tension(cable.length)))
    sign = 1.0 if which == 0 else -1.0
    assert least_tension(a, b, math.hypot(a, b), q, k, sign) == pytest.approx(float(least), rel=0, abs=1e-14 * most)
    for margin in (1e-13, 1e-8, 1e-4):
        above, below = float(least + margin * most), float(least - margin * most)
        check_refused(kernel.BELOW_LEAST_TENSION, a, b, q, k, which, below)
        # A double root: a rounding d of the tension moves the length by d / (2 sqrt(margin)), times the width of the
        # minimum, and the sum of some roundings stands in for d.
        check_given(a, b, q, k, which, above, RIGHT + 1e-15 / math.sqrt(margin))


def test_the_shorter_of_two_lengths():
    a, b, q, k = GUY.values()
    slack = reference.from_length(a, b, q, k, MP.mpf("324.44439700111155"))
    assert float(slack.tension(slack.length)) == pytest.approx(1875.0, rel=1e-13)
    assert float(slack.stretched()) == pytest.approx(324.457728, rel=1e-9)
    status, out = solve(a, b, q, k, kernel.UPPER_TENSION, 1875.0)
    assert status == kernel.FOUND
    assert out[0] == pytest.approx(61.2367546459758, rel=1e-13)


def test_round_trips_between_the_four_ways_to_give_the_length():
    n = 400
    random = np.random.default_rng(3)
    angle = random.uniform(-1.5, 1.5, n)
    c = 10.0 ** random.uniform(-1, 3, n)
    a, b = c * np.cos(angle), c * np.sin(angle)
    c = np.hypot(a, b)
    k, q = 10.0 ** random.uniform(3, 13, n), 10.0 ** random.uniform(-6, 3, n)
    # at most as much slack as at half the length of least tension, so that the shorter length is the one given
    length = c * np.where(
        random.random(n) < 0.5, 1 / (1 + 10.0 ** random.uniform(-4, 0, n)), 1 + 0.001 * random.random(n)
    )
    first, status = solve_catenaries((a, b, c, q), k, "unstretched_length", length)
    assert (status == kernel.FOUND).all()
    for kind, column in ((kernel.UPPER_TENSION, 5), (kernel.LOWER_TENSION, 4), (kernel.HORIZONTAL_FORCE, 2)):
        second, status = solve_catenaries((a, b, c, q), k, CATENARY_KEYS[kind], first[:, column].copy())
        # a soft steep cable may hang below its end with more slack than the shorter length of that tension; not the force
        kept = status == kernel.FOUND
        if kind == kernel.HORIZONTAL_FORCE:
            assert kept.all()
        shorter = second[:, 0] < length * (1 - 1e-9)
        assert (kept & ~shorter).mean() > 0.9
        assert (second[kept, 0] <= length[kept] * (1 + 1e-9)).all()
        same = kept & ~shorter
        # from the force back to the length loses nothing; near the least tension its square root does
        bound = 1e-13 if kind == kernel.HORIZONTAL_FORCE else 1e-9
        assert np.abs(second[same, 0] / length[same] - 1).max() < bound


@pytest.mark.parametrize(
    ("a", "b", "q", "k", "kind", "value"),
    [
        # slack and nearly vertical: steps on the misfit itself gain half a unit of eta each
        (4.162050706628166e-07, 3.705598107730202, 0.08246748148094, 19678944605.5425, 3, 3.7776483813589725),
        (5.257595534063513e-10, 25.769338108427895, 0.00463871671748929, 61533.24626307583, 3, 25.769728083976467),
        (0.4073881362393706, -434.5964880482356, 26.168559467424327, 22172.372204740477, 3, 434.5966789897847),
        # a strain of hundreds under its own weight: q a / (2 H) is beyond cosh, eta is not
        (20.0, 5.0, 1e4, 1e3, 2, 100.0),
        (870.0900373205541, 0.0, 6931.702937618429, 3125.3345373707775, 2, 3100.9962305087583),
        # taut and nearly horizontal, no force against the load at one end: the form for the nearly vertical must not be used
        (60.0, 1e-9, 1e-9, 2e7, 3, 59.994),
        # eta just below and above where the series of eta coth(eta) takes over
        (482.0, -42.3, 0.0193, 1.06e3, 3, 484.0),
        (10.0, 1.0, 3.0, 1e7, 2, 32.0),
        (10.0, 1.0, 3.0, 1e7, 2, 28.0),
    ],
)
def test_cases_once_found_wrong_or_given_up(a, b, q, k, kind, value):
    if kind == kernel.LENGTH:
        check_length(a, b, q, k, value)
    else:
        check_given(a, b, q, k, kind, value)


def test_sag_function():
    # 1e-14: eta - tanh(eta) loses a factor 12 at 0.5, where the series ends
    for eta in (1e-12, 1e-3, 0.1, 0.29, 0.31, 0.45, 0.499, 0.501, 0.7, 2.0, 20.0, 200.0):
        excess, slope = kernel.sag_excess(eta)
        x = MP.mpf(eta)
        assert abs(excess / (x * MP.coth(x) - 1) - 1) < 1e-14
        assert abs(slope / (MP.coth(x) - x / MP.sinh(x) ** 2) - 1) < 1e-14


@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 0.0])
def test_impossible_values_are_refused(kind, value):
    for b in (57.7, -57.7, 0.0):
        for a in (20.4, 1e-9):
            status, out = solve(a, b, 9.8125, 2e7, kind, value)
            assert status != kernel.FOUND
            assert np.isnan(out).all()


@pytest.mark.parametrize(
    ("name", "value"), [(n, v) for n in "abqk" for v in (math.nan, math.inf, -1.0) if (n, v) != ("b", -1.0)]
)
def test_impossible_cables_are_refused(name, value):
    data = GUY | {name: value}
    for kind, given in ((0, 1875.0), (1, 1875.0), (2, 500.0), (3, 61.0), (3, 70.0)):
        check_refused(kernel.NOT_FOUND, *data.values(), kind, given)


def test_other_statuses():
    a, b, q, k = GUY.values()
    for kind in (-1, 4):
        assert kernel.solve(a, b, math.hypot(a, b), q, k, kind, 61.0, np.empty(6)) == kernel.NOT_FOUND
    check_refused(kernel.VERTICAL_WITH_FORCE, 0.0, 57.7, 9.8125, 2e7, kernel.HORIZONTAL_FORCE, 1.0)
    # so slack, and unable to stretch instead, that its tension is exp(1000) times the force: refused, not infinite
    check_refused(kernel.NOT_FOUND, 20.4, 57.7, 9.8125, 1e300, kernel.HORIZONTAL_FORCE, 0.1)
    # vertical, hanging from its upper end with no tension at the lower one: the least there is
    check_given(0.0, 57.7, 9.8125, 2e7, kernel.LOWER_TENSION, 0.0)


def test_many_are_the_same_as_few():
    length = np.tile([61.0, 61.2, 62.0, 150.0, -1.0], 13)
    assert length.size > FEW  # compiled code
    a, b, q, k = (np.full(length.size, value) for value in GUY.values())
    out, status = solve_catenaries((a, b, np.hypot(a, b), q), k, "unstretched_length", length)
    for i in range(length.size):
        one, row = solve(*GUY.values(), kernel.LENGTH, length[i])
        assert one == status[i]
        np.testing.assert_allclose(row, out[i], rtol=1e-15)  # roots and hyperbolic functions of two libraries


@pytest.mark.parametrize("error", [ZeroDivisionError, OverflowError, ValueError])
def test_numbers_that_plain_python_refuses_are_left_to_compiled_code(monkeypatch, error):
    a, b, q, k = (np.full(1, value) for value in GUY.values())
    given = (a, b, np.hypot(a, b), q), k, "top_tension", np.array([1875.0])
    expected = solve_catenaries(*given)

    def refused(*_):
        raise error

    monkeypatch.setattr(kernel, "solve", refused)
    found = solve_catenaries(*given)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-15)
    assert found[1].tolist() == expected[1].tolist() == [kernel.FOUND]


@pytest.mark.parametrize("dims", [2, 3])
def test_chords_are_resolved_across_and_against_any_load(dims):
    rng = np.random.default_rng(dims)
    chords, loads = rng.normal(size=(2, 200, dims)) * 10.0 ** rng.uniform(-3.0, 3.0, (2, 200, 1))
    loads[:20] = 0.0  # without load the vertical takes its place
    loads[20:40, np.arange(dims) != 1] = 0.0  # weight alone
    chords[40:60] = rng.normal(size=(20, 1)) * loads[40:60]  # along the load
    span, rise, chord, load, across, against = resolved(chords, loads)
    # each number comes from a few products and sums: a few rounding errors
    np.testing.assert_allclose(
        span[:, None] * across + rise[:, None] * against, chords, rtol=0, atol=4e-16 * chord.max()
    )
    np.testing.assert_allclose(load[:, None] * against, -loads, rtol=1e-15)
    np.testing.assert_allclose(np.hypot(span, rise), chord, rtol=1e-15)
    np.testing.assert_allclose((across * against).sum(axis=1), 0.0, atol=1e-15)
    np.testing.assert_array_equal(np.abs(against[:40]), np.tile(np.eye(dims)[1], (40, 1)))
    np.testing.assert_allclose(np.linalg.norm(across[:40], axis=1), 1.0, rtol=1e-15)
    assert not across[40:60].any()
    assert not span[40:60].any()
    np.testing.assert_array_equal(np.abs(rise[40:60]), chord[40:60])
