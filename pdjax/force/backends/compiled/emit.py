"""Scalar programs as LLVM vector instructions: one lane of a vector is one bond.

`vectorised` translates a jaxpr whose variables are all scalars. Each primitive becomes one instruction on vectors, so
that the program treats as many bonds at once as the vectors of the processor have lanes.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.extend import core
from llvmlite import ir

from ....models import kinematics

DOUBLE, LONG, BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
FAST = ("contract", "nsz")  # a product and a sum may become one instruction, and 0 needs no sign
TAYLOR = [1 / math.factorial(k) for k in range(14)]  # of exp; for |x| ≤ log(2)/2 the next term is 4e-18
SMALL = 0.06  # below it 9 terms of exp (the next is 3e-17) and 5 of artanh (7e-17) are enough
# Without custom_vjp_call: it has no forward derivative, and the derivatives of a sum over pairs begin with that one.
INLINED = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "remat2", "checkpoint"}
# Operations that also take numbers of whole type: `kinematics.log1p` reads the bits of a number.
ON_BITS = {
    "shift_right_logical",
    "and",
    "or",
    "xor",
    "not",
    "bitcast_convert_type",
    "select_n",
    "stop_gradient",
    "copy",
}
COMPARED = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}


class NotVectorised(ValueError):
    """A model uses an operation that has no vector instruction here."""


def _kind(dtype: Any) -> ir.Type:
    dtype = np.dtype(dtype)
    if dtype == np.float64:
        return DOUBLE
    if dtype == np.bool_:
        return BIT
    if dtype in (np.uint64, np.int64):
        return LONG
    raise NotVectorised(f"numbers of the type {dtype}")


def declared(module: ir.Module, name: str, result: ir.Type, arguments: list[ir.Type]) -> ir.Function:
    """A function that is defined elsewhere: of the C library, or an intrinsic one of LLVM."""
    return module.globals.get(name) or ir.Function(module, ir.FunctionType(result, arguments), name)


class Lanes:
    """Vector instructions of a function under construction, for vectors of `width` lanes."""

    def __init__(self, builder: ir.IRBuilder, width: int):
        self.builder, self.width = builder, width

    def type(self, kind: ir.Type) -> ir.VectorType:
        return ir.VectorType(kind, self.width)

    def constant(self, value: object, kind: ir.Type = DOUBLE) -> ir.Constant:
        """The same number in all lanes."""
        number = float(value) if kind is DOUBLE else int(value)  # type: ignore[arg-type, call-overload]
        return ir.Constant(self.type(kind), [ir.Constant(kind, number)] * self.width)

    def call(self, name: str, *operands: ir.Value) -> ir.Value:
        """An intrinsic function of LLVM whose operands and result have one type."""
        one = operands[0].type
        function = declared(self.builder.module, f"llvm.{name}.v{self.width}f64", one, [one] * len(operands))
        return self.builder.call(function, operands, fastmath=FAST)

    def add(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fadd(a, b, flags=FAST)

    def sub(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fsub(a, b, flags=FAST)

    def mul(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fmul(a, b, flags=FAST)

    def as_double(self, x: ir.Value) -> ir.Value:
        """Numbers of any kind in the form of doubles, for storing."""
        if x.type.element == BIT:
            return self.builder.uitofp(x, self.type(DOUBLE))
        return self.builder.bitcast(x, self.type(DOUBLE))

    def from_double(self, x: ir.Value, kind: ir.Type) -> ir.Value:
        """The inverse of `as_double`."""
        if kind == BIT:
            return self.builder.fcmp_ordered("!=", x, self.constant(0.0))
        return self.builder.bitcast(x, self.type(kind))

    def power(self, x: ir.Value, y: int) -> ir.Value:
        """x to a whole power."""
        if y < 0:
            return self.builder.fdiv(self.constant(1), self.power(x, -y), flags=FAST)
        result: ir.Value = self.constant(1)
        for bit in bin(y)[2:]:
            result = self.mul(result, result)
            result = self.mul(result, x) if bit == "1" else result
        return result

    def series(self, x: ir.Value, coefficients: list[float]) -> ir.Value:
        """Σ c_k x^k. Two halves, in even and odd powers, are independent and run at the same time."""
        square = self.mul(x, x)
        halves: list[ir.Value] = []
        for part in (coefficients[0::2], coefficients[1::2]):
            total: ir.Value = self.constant(part[-1])
            for c in reversed(part[:-1]):
                total = self.add(self.mul(total, square), self.constant(c))
            halves.append(total)
        return self.add(self.mul(halves[1], x), halves[0])

    def if_small(self, x: ir.Value, near: Callable, far: Callable) -> ir.Value:
        """near() if |x| ≤ SMALL in every lane, else far()."""
        b = self.builder
        inside = b.fcmp_ordered("<=", self.call("fabs", x), self.constant(SMALL))
        all_ = declared(b.module, f"llvm.vector.reduce.and.v{self.width}i1", BIT, [self.type(BIT)])
        with b.if_else(b.call(all_, [inside])) as (then, otherwise):
            with then:
                first, first_end = near(), b.block
            with otherwise:
                second, second_end = far(), b.block
        found = b.phi(first.type)
        found.add_incoming(first, first_end)
        found.add_incoming(second, second_end)
        return found

    def exp(self, x: ir.Value) -> ir.Value:
        """exp(x) with an error of a few units in the last place; 0 below −708 and ∞ above 709."""
        return self.if_small(x, lambda: self.series(x, TAYLOR[:9]), lambda: self._exp(x))

    def _exp(self, x: ir.Value) -> ir.Value:
        b = self.builder
        n = self.call("rint", self.mul(x, self.constant(1 / math.log(2))))
        n = self.call("minnum", self.call("maxnum", n, self.constant(-1022)), self.constant(1023))
        # log 2 in two parts. The first has zeros in its last 32 bits, so that n times it is exact.
        r = self.sub(x, self.mul(n, self.constant(0.693147180369123816490)))
        series = self.series(self.sub(r, self.mul(n, self.constant(1.90821492927058770002e-10))), TAYLOR)
        exponent = b.shl(b.add(b.fptosi(n, self.type(LONG)), self.constant(1023, LONG)), self.constant(52, LONG))
        found = self.mul(series, b.bitcast(exponent, self.type(DOUBLE)))
        found = b.select(b.fcmp_unordered(">", x, self.constant(709.78)), self.add(x, self.constant(math.inf)), found)
        return b.select(b.fcmp_ordered("<", x, self.constant(-708.39)), self.constant(0), found)

    def log(self, x: ir.Value) -> ir.Value:
        """log(x) = k log 2 + 2 artanh t, with x = 2^k f, f in [1/√2, √2] and t = (f − 1)/(f + 1)."""
        b, long, double = self.builder, self.type(LONG), self.type(DOUBLE)
        bits = b.bitcast(x, long)
        k = b.sub(b.lshr(bits, self.constant(52, LONG)), self.constant(1023, LONG))
        mantissa = b.and_(bits, self.constant(2**52 - 1, LONG))
        f = b.bitcast(b.or_(mantissa, self.constant(1023 << 52, LONG)), double)
        upper = b.fcmp_ordered(">", f, self.constant(math.sqrt(2)))
        f = b.select(upper, self.mul(f, self.constant(0.5)), f)
        power = self.add(b.sitofp(k, double), b.uitofp(upper, double))
        t = b.fdiv(self.sub(f, self.constant(1)), self.add(f, self.constant(1)), flags=FAST)
        series = self.mul(t, self.series(self.mul(t, t), [2 / (2 * n + 1) for n in range(12)]))
        found = self.add(self.mul(power, self.constant(math.log(2))), series)
        found = b.select(b.fcmp_ordered("<", x, self.constant(math.inf)), found, x)  # ∞ and NaN
        found = b.select(b.fcmp_ordered("<", x, self.constant(0)), self.constant(math.nan), found)
        return b.select(b.fcmp_ordered("==", x, self.constant(0)), self.constant(-math.inf), found)

    def pow(self, x: ir.Value, y: ir.Value) -> ir.Value:
        """x^y = exp(y log|x|), with the sign (−1)^y for x < 0 and a whole y. NaN for x < 0 and any other y."""
        b, zero, one = self.builder, self.constant(0), self.constant(1)
        size = self.call("fabs", x)
        found = b.select(b.fcmp_ordered("==", size, one), one, self.exp(self.mul(y, self.log(size))))
        half = self.mul(y, self.constant(0.5))
        odd = b.fcmp_ordered("!=", self.call("rint", half), half)
        whole = b.fcmp_ordered("==", self.call("rint", y), y)
        negative = b.select(whole, b.select(odd, b.fneg(found), found), self.constant(math.nan))
        found = b.select(b.fcmp_ordered("<", x, zero), negative, found)
        return b.select(b.fcmp_ordered("==", y, zero), one, found)

    def sign(self, x: ir.Value) -> ir.Value:
        """−1, 0 or 1; NaN for NaN."""
        unit = self.call("copysign", self.constant(1), x)
        return self.builder.select(self.builder.fcmp_ordered("!=", x, self.constant(0)), unit, x)

    def log1p(self, x: ir.Value, far: Callable) -> ir.Value:
        """log(1 + x) = 2 artanh t with t = x/(2 + x), or far() if |x| is not small."""

        def near():
            t = self.builder.fdiv(x, self.add(x, self.constant(2)), flags=FAST)
            return self.mul(t, self.series(self.mul(t, t), [2 / (2 * k + 1) for k in range(5)]))

        return self.if_small(x, near, far)


def _compare(name: str) -> Callable:
    def emit(lanes: Lanes, a: ir.Value, b: ir.Value, **_: object) -> ir.Value:
        if a.type.element is DOUBLE:
            return (lanes.builder.fcmp_unordered if name == "ne" else lanes.builder.fcmp_ordered)(COMPARED[name], a, b)
        return lanes.builder.icmp_unsigned(COMPARED[name], a, b)

    return emit


def _convert(lanes: Lanes, x: ir.Value, new_dtype: Any, **_: object) -> ir.Value:
    kind = _kind(new_dtype)
    if x.type.element == kind:
        return x
    if x.type.element == BIT and kind is DOUBLE:
        return lanes.builder.uitofp(x, lanes.type(DOUBLE))
    raise NotVectorised(f"a conversion to {np.dtype(new_dtype)}")


def _select(lanes: Lanes, which: ir.Value, *cases: ir.Value) -> ir.Value:
    if which.type.element != BIT or len(cases) != 2:
        raise NotVectorised("a choice among more than two cases")
    return lanes.builder.select(which, cases[1], cases[0])


INSTRUCTIONS: dict[str, Callable] = {
    "add": lambda v, a, b, **_: v.add(a, b),
    "add_any": lambda v, a, b, **_: v.add(a, b),
    "sub": lambda v, a, b, **_: v.sub(a, b),
    "mul": lambda v, a, b, **_: v.mul(a, b),
    "div": lambda v, a, b, **_: v.builder.fdiv(a, b, flags=FAST),
    "neg": lambda v, a, **_: v.builder.fneg(a, flags=FAST),
    "sqrt": lambda v, a, **_: v.call("sqrt", a),
    "rsqrt": lambda v, a, **_: v.builder.fdiv(v.constant(1), v.call("sqrt", a), flags=FAST),
    "abs": lambda v, a, **_: v.call("fabs", a),
    "max": lambda v, a, b, **_: v.call("maximum", a, b),
    "min": lambda v, a, b, **_: v.call("minimum", a, b),
    "exp": lambda v, a, **_: v.exp(a),
    "log": lambda v, a, **_: v.log(a),
    "sign": lambda v, a, **_: v.sign(a),
    "pow": lambda v, a, b, **_: v.pow(a, b),
    "square": lambda v, a, **_: v.mul(a, a),
    "integer_pow": lambda v, a, y, **_: v.power(a, y),
    "select_n": lambda v, *cases, **_: _select(v, *cases),
    "convert_element_type": _convert,
    "bitcast_convert_type": lambda v, a, new_dtype, **_: v.builder.bitcast(a, v.type(_kind(new_dtype))),
    "shift_right_logical": lambda v, a, b, **_: v.builder.lshr(a, b),
    "and": lambda v, a, b, **_: v.builder.and_(a, b),
    "or": lambda v, a, b, **_: v.builder.or_(a, b),
    "xor": lambda v, a, b, **_: v.builder.xor(a, b),
    "not": lambda v, a, **_: v.builder.not_(a),
    "stop_gradient": lambda v, a, **_: a,
    "copy": lambda v, a, **_: a,
    **{name: _compare(name) for name in COMPARED},
}


def _inner(eqn: core.JaxprEqn) -> core.ClosedJaxpr | None:
    if eqn.primitive.name not in INLINED:
        return None
    inner: Any = next(eqn.params[name] for name in ("jaxpr", "call_jaxpr", "fun_jaxpr") if name in eqn.params)
    return inner if isinstance(inner, core.ClosedJaxpr) else core.ClosedJaxpr(inner, ())


@functools.cache
def _log1p_printed() -> str:
    (eqn,) = jax.make_jaxpr(kinematics.log1p)(jax.ShapeDtypeStruct((), np.dtype(np.float64))).eqns
    return str(eqn.params["call_jaxpr"])


def _is_log1p(eqn: core.JaxprEqn) -> bool:
    """Whether this is a call of `models.kinematics.log1p`. A user's function may have the same name."""
    return eqn.primitive.name == "custom_jvp_call" and str(eqn.params["call_jaxpr"]) == _log1p_printed()


def _read(lanes: Lanes, known: dict, v: Any) -> ir.Value:
    return lanes.constant(v.val, _kind(np.asarray(v.val).dtype)) if isinstance(v, core.Literal) else known[v]


def _is_scalar(eqn: core.JaxprEqn) -> bool:
    variables: list[Any] = [*eqn.invars, *eqn.outvars]
    return all(v.aval.shape == () for v in variables)


def _run(lanes: Lanes, eqns: list[core.JaxprEqn], known: dict, reciprocals: dict | None = None) -> None:
    """Add the results of these operations to the values of the variables in `known`.

    `reciprocals` holds the reciprocals of some divisors.
    """
    reciprocals = reciprocals or {}
    for eqn in eqns:
        given, name = [_read(lanes, known, v) for v in eqn.invars], eqn.primitive.name
        inner = _inner(eqn)
        if inner is not None and _is_log1p(eqn):
            results = [lanes.log1p(given[0], lambda inner=inner, given=given: vectorised(lanes, inner, given)[0])]
        elif inner is not None:
            results = vectorised(lanes, inner, given)
        elif name == "div" and not isinstance(eqn.invars[1], core.Literal) and eqn.invars[1] in reciprocals:
            results = [lanes.mul(given[0], reciprocals[eqn.invars[1]])]
        elif name in INSTRUCTIONS and _is_scalar(eqn):
            if name not in ON_BITS and any(x.type.element == LONG for x in given):
                raise NotVectorised(f"the operation {name} of whole numbers")
            results = [INSTRUCTIONS[name](lanes, *given, **eqn.params)]
        else:
            raise NotVectorised(f"the operation {name}")
        known.update(zip(eqn.outvars, results, strict=True))


def _start(lanes: Lanes, program: core.ClosedJaxpr, operands: list[ir.Value]) -> dict:
    known = dict(zip(program.jaxpr.invars, operands, strict=True))
    for v, value in zip(program.jaxpr.constvars, program.consts, strict=True):
        known[v] = lanes.constant(np.asarray(value)[()], _kind(np.asarray(value).dtype))
    return known


def vectorised(lanes: Lanes, program: core.ClosedJaxpr, operands: list[ir.Value]) -> list[ir.Value]:
    """The results of a scalar program for operands that hold one scalar in each lane."""
    known = _start(lanes, program, operands)
    _run(lanes, program.jaxpr.eqns, known)
    return [_read(lanes, known, v) for v in program.jaxpr.outvars]


class Parted:
    """A scalar program in two parts: what depends on some of its operands alone, and the rest.

    `first` gives the `count` results of the first part that the second part reads, and `second` the results of the
    program. What no result needs is left out.
    """

    def __init__(self, program: core.ClosedJaxpr, early: list[bool]):
        jaxpr = self.jaxpr = program.jaxpr
        self.program = program
        needed = {v for v in jaxpr.outvars if not isinstance(v, core.Literal)}
        live = []
        for eqn in reversed(jaxpr.eqns):
            if any(v in needed for v in eqn.outvars):
                live.append(eqn)
                needed.update(v for v in eqn.invars if not isinstance(v, core.Literal))
        known = {v for v, e in zip(jaxpr.invars, early, strict=True) if e} | set(jaxpr.constvars)
        self.parts: tuple[list, list] = [], []
        for eqn in reversed(live):
            is_early = all(isinstance(v, core.Literal) or v in known for v in eqn.invars)
            self.parts[0 if is_early else 1].append(eqn)
            known.update(eqn.outvars if is_early else ())
        read = [v for eqn in self.parts[1] for v in eqn.invars] + list(jaxpr.outvars)
        self.between = [v for v in dict.fromkeys(v for v in read if not isinstance(v, core.Literal)) if v in known]
        # A division by an early number becomes a product with its reciprocal.
        divisors = [eqn.invars[1] for eqn in self.parts[1] if eqn.primitive.name == "div"]
        self.divisors = list(dict.fromkeys(v for v in divisors if not isinstance(v, core.Literal) and v in known))
        self.count = len(self.between) + len(self.divisors)

    def first(self, lanes: Lanes, operands: list[ir.Value]) -> list[ir.Value]:
        """The results of the first part for all operands; those of the second part are not read."""
        known = _start(lanes, self.program, operands)
        _run(lanes, self.parts[0], known)
        one = lanes.constant(1.0)
        found = [known[v] for v in self.between] + [lanes.builder.fdiv(one, known[v]) for v in self.divisors]
        return [lanes.as_double(x) for x in found]

    def second(self, lanes: Lanes, operands: list[ir.Value], between: list[ir.Value]) -> list[ir.Value]:
        """The results of the program for all operands; those of the first part are not read."""
        n = len(self.between)
        kinds: list[Any] = [v.aval for v in self.between]
        read = [lanes.from_double(x, _kind(kind.dtype)) for x, kind in zip(between[:n], kinds, strict=True)]
        known = {**_start(lanes, self.program, operands), **dict(zip(self.between, read, strict=True))}
        _run(lanes, self.parts[1], known, dict(zip(self.divisors, between[n:], strict=True)))
        return [_read(lanes, known, v) for v in self.jaxpr.outvars]


def unserved(program: core.ClosedJaxpr) -> str | None:
    """The first operation of a scalar program that has no vector instruction, or None."""
    function = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), []), "trial")
    lanes = Lanes(ir.IRBuilder(function.append_basic_block()), 2)
    try:
        vectorised(lanes, program, [lanes.constant(1.0)] * len(program.jaxpr.invars))
    except NotVectorised as error:
        return str(error)
    return None
