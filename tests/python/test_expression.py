"""The formula reader: what it computes, what it refuses, and that the plant's C computes what its NumPy does."""

from __future__ import annotations

import doctest
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from terrapin_hil.physics import expression
from terrapin_hil.physics.compiled import ffi, library
from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.program import instructions
from terrapin_hil.units import units

VALUES = {"x": 1.7, "y": -0.6, "z": 0.25}


def test_docstring_examples() -> None:
    assert doctest.testmod(expression).failed == 0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2*x", 4.4),
        ("-x**2", -2.89),
        ("2**-1", 0.5),
        ("2**3**2", 512.0),
        ("x - y - z", 2.05),
        ("x / y / z", 1.7 / -0.6 / 0.25),
        ("abs(y) + sign(y)", -0.4),
        ("sign(0*x)", 0.0),
        ("sqrt(z)", 0.5),
        ("exp(log(x))", 1.7),
        ("sin(x)**2 + cos(x)**2", 1.0),
        ("tan(z) - sin(z)/cos(z)", 0.0),
        ("tanh(1e3)", 1.0),
        ("min(x, y, z)", -0.6),
        ("max(x, y, 3)", 3.0),
        ("(x > 1) + (x >= 1.7) + (x < 1) + (x <= 1) + (x == 1.7) + (x != 1.7)", 3.0),
        ("+x", 1.7),
        ("  1e-3 * x ", 1.7e-3),
    ],
)
def test_value(text: str, value: float) -> None:
    assert float(parse(text).evaluate(VALUES)) == pytest.approx(value, abs=1e-14)


def test_arrays_broadcast() -> None:
    grid = parse("a * x").evaluate({"a": np.array([[1.0], [2.0]]), "x": np.array([1.0, 2.0, 3.0])})
    np.testing.assert_array_equal(grid, [[1, 2, 3], [2, 4, 6]])


def test_no_value_is_nan_without_a_warning() -> None:
    with np.errstate(all="raise"):
        assert math.isnan(float(parse("log(y)").evaluate(VALUES)))
        assert math.isinf(float(parse("1/(x-x)").evaluate(VALUES)))


def test_missing_value_is_named() -> None:
    with pytest.raises(KeyError, match="q"):
        parse("q + 1").evaluate(VALUES)


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("", 1, "empty"),
        ("1 +", 4, "it ends where a name"),
        ("k**", 4, "it ends where a name"),
        ("2 x*v", 3, r"expected an operator \(\+ - \* / \*\*\) before x\*v"),
        (" k*sin x", 8, "expected an operator"),
        ("a2 + 3b", 7, "before b"),
        ("2e3*x 4", 7, "before 4"),
        ("2 (x)", 3, "expected an operator"),
        ("(x+1)(y)", 6, "expected an operator"),
        ("x << 2", 3, "operator << is not known; known: "),
        ("k*x , 2", 5, "a comma"),
        ("x ^ 2", 3, r"operator \^ is not known: a power is written \*\*"),
        (" x*|y|", 4, r"operator \| is not known: a magnitude is written abs\(x\)"),
        ("x*y|y", 4, r"operator \| is not known: a magnitude is written abs\(x\)"),
        ("x % 2", 3, "operator % is not known; known: "),
        ("0,5*x", 2, "a decimal mark is a point"),
        ("x and y", 1, "BoolOp"),
        ("x if y else z", 1, "IfExp"),
        ("__import__('os').system('true')", 1, "Call"),
        ("2*__import__", 3, "may use"),
        ("x.real", 1, "Attribute"),
        ("x[0]", 1, "Subscript"),
        ("(lambda: 1)()", 1, "Call"),
        ("[x for x in y]", 1, "ListComp"),
        ("f(x)", 1, "unknown function f"),
        ("sin", 1, "function"),
        ("sin(x, y)", 1, "one argument"),
        ("min(x)", 1, "two or more"),
        ("max(*x)", 1, "before an argument"),
        ("sin(x=1)", 1, "Call"),
        ("'a'", 1, "not a number"),
        ("True", 1, "not a number"),
        ("1j", 1, "not a number"),
        ("1e999", 1, "out of range"),
        ("1 < x < 2", 1, "chained"),
        ("x := 2", 3, "not a formula"),
        ("i = load/k + i0", 3, "expected what stands right of ="),
        ("x; y", 2, "not a formula"),
        ("x // y", 3, "operator // is not known; known: "),
        ("x in y", 1, "comparison"),
        ("~x", 1, "UnaryOp"),
        ("x\n+ y", 2, "ASCII"),
        ("ω", 1, "ASCII"),
        ("  f(x)", 3, "unknown function"),
        ("x\0", 2, "ASCII"),
        ("1+" * 600 + "1", 1000, "longer"),
        ("(" * 400 + "x" + ")" * 400, None, "not a formula"),
    ],
)
def test_refuses(text: str, column: int | None, reason: str) -> None:
    with pytest.raises(ValueError, match=reason) as caught:
        parse(text)
    if column is not None:
        assert str(caught.value).startswith(f"column {column}:")


@given(st.text(max_size=60))
@settings(max_examples=400, deadline=None)
@example("x" * 999)
@example("-" * 999 + "x")
def test_any_text_is_a_formula_or_a_valueerror(text: str) -> None:
    try:
        result = str(parse(text))
    except ValueError as error:
        result = str(error)
    assert result == text.strip() or result.startswith("column ")


_atoms = st.one_of(
    st.sampled_from(["x", "y", "z"]),
    st.floats(0.0, 100.0, allow_nan=False).map(lambda v: repr(round(v, 4))),
)
_formulas = st.recursive(
    _atoms,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!="]), inner).map(
            lambda t: f"({t[0]} {t[1]} {t[2]})"
        ),
        st.tuples(inner, st.sampled_from(["2", "3", "0.5", "-1"])).map(lambda t: f"({t[0]})**{t[1]}"),
        inner.map(lambda t: f"-({t})"),
        st.tuples(st.sampled_from(["abs", "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "tanh"]), inner).map(
            lambda t: f"{t[0]}({t[1]})"
        ),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(lambda t: f"{t[0]}({t[1]}, {t[2]})"),
    ),
    max_leaves=8,
)


@given(_formulas)
@settings(max_examples=400, deadline=None)
def test_the_plant_computes_what_numpy_says(text: str) -> None:
    formula = parse(text)
    for point in ((1.7, -0.6, 0.25), (-3.0, 0.0, 40.0), (0.0, 1.0, -1.0)):
        wanted = float(formula.evaluate(dict(zip("xyz", point, strict=True))))
        if math.isfinite(wanted) and abs(wanted) < 1e12 and _well_posed(formula, point):
            assert in_the_plant(text, point) == pytest.approx(wanted, rel=1e-9, abs=1e-9)


def in_the_plant(text: str, point: tuple[float, float, float]) -> float:
    """Value of a formula of x and y, which vary, and z, a number in the code; sign() has no smoothing."""
    code = instructions(text, {"x": 0, "y": 1}, {"z": point[2]})
    value: float = library().hil_program_run(ffi().new("hil_instruction[]", code), len(code), 0.0, list(point[:2]))
    return value


def _well_posed(formula: expression.Expression, point: tuple[float, float, float]) -> bool:
    """Jumps (comparisons, sign, poles) may fall on either side by one rounding: compare where neighbours agree."""
    here = float(formula.evaluate(dict(zip("xyz", point, strict=True))))
    for scale in (1 - 1e-13, 1 + 1e-13):
        near = float(formula.evaluate({n: v * scale + (scale - 1) for n, v in zip("xyz", point, strict=True)}))
        if not abs(near - here) <= 1e-9 * (1 + abs(here)):
            return False
    return True


def test_the_deepest_formula_fits_the_stack() -> None:
    deep = expression.MAX_DEPTH - 1
    assert in_the_plant("x+(" * deep + "x" + ")" * deep, (1.0, 0.0, 0.0)) == expression.MAX_DEPTH
    with pytest.raises(ValueError, match="too deeply"):
        parse("x+(" * (deep + 1) + "x" + ")" * (deep + 1))


UNITS = {
    "f_s": "s^2/rad^2",
    "omega": "rad/s",
    "radius": "m",
    "load": "N",
    "a_t": "1/K",
    "temperature": "degC",
    "m": "1",
    "speed": "m/s",
}


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("f_s * omega**2 * radius * load * sign(omega)", "N m"),
        ("-a_t * (temperature - 25)", "1"),
        ("sqrt(speed**2 + 0)", "m/s"),
        ("exp(-(omega/3)**2)", None),
        ("max(speed, 0.1) / radius", "1/s"),
        ("(speed > 0.1) * load", "N"),
        ("2 + 3", "1"),
        ("m**2.5", "1"),
        ("2**m", "1"),
        ("abs(speed)*tanh(m)", "m/s"),
    ],
)
def test_unit(text: str, unit: str | None) -> None:
    if unit is None:  # omega/3 keeps 1/s: a plain number divides, it does not carry a unit
        with pytest.raises(ValueError, match="exp of a quantity"):
            parse(text).unit(UNITS)
        return
    registry = units()
    assert (
        parse(text).unit(UNITS).dimensionality
        == registry.parse_units(unit.replace("1", "dimensionless", unit == "1")).dimensionality
    )


@pytest.mark.parametrize("text", ["speed + load", "speed < load", "speed**m", "2**speed", "log(load)", "min(speed, m)"])
def test_mixed_units_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"between|power|exponent|of a quantity"):
        parse(text).unit(UNITS)


def test_unit_of_an_unknown_name() -> None:
    with pytest.raises(KeyError):
        parse("load * q").unit(UNITS)


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("f_s*omega**2", r"f_{\mathrm{s}}\,\omega^{2}"),
        ("(a + b)*c", r"\left(a + b\right)\,c"),
        ("a - (b - c)", r"a - \left(b - c\right)"),
        ("-a*(temperature - 25)", r"-a\,\left(\mathrm{temperature} - 25\right)"),
        ("exp(-x/tau)", r"e^{\frac{-x}{\tau}}"),
        ("max(s - xi2, 0)", r"\max\left(s - \xi_{\mathrm{2}},\,0\right)"),
        ("abs(v) > 1e-3", r"\left[\left|v\right| > 0.001\right]"),
        ("pass_**kappa", r"\mathrm{pass}^{\kappa}"),
    ],
)
def test_latex(text: str, latex: str) -> None:
    assert parse(text).to_latex() == latex
