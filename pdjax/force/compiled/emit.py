"""Scalar programs as LLVM vector instructions: one lane of a vector is one bond.

`vectorised` translates a jaxpr whose variables are all scalars. Each primitive becomes one instruction on vectors, so
that the program treats as many bonds at once as the vectors of the processor have lanes.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jax.extend import core
from llvmlite import ir

DOUBLE, LONG, BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
FAST = ("contract", "nsz")  # a product and a sum may become one instruction, and 0 needs no sign
EXP_TERMS = 13  # of the Taylor series of exp on |x| ≤ log(2)/2, whose next term is 4e-18
INLINED = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "remat2", "checkpoint"}
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
        suffix = f"v{self.width}f64"
        signature = ir.FunctionType(one, [one] * len(operands))
        module = self.builder.module
        full = f"llvm.{name}.{suffix}"
        function = module.globals.get(full) or ir.Function(module, signature, full)
        return self.builder.call(function, operands, fastmath=FAST)

    def add(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fadd(a, b, flags=FAST)

    def sub(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fsub(a, b, flags=FAST)

    def mul(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.builder.fmul(a, b, flags=FAST)

    def power(self, x: ir.Value, y: int) -> ir.Value:
        """x to a whole power."""
        if y < 0:
            return self.builder.fdiv(self.constant(1), self.power(x, -y), flags=FAST)
        result: ir.Value = self.constant(1)
        for bit in bin(y)[2:]:
            result = self.mul(result, result)
            result = self.mul(result, x) if bit == "1" else result
        return result

    def exp(self, x: ir.Value) -> ir.Value:
        """exp(x) with an error of a few units in the last place; 0 below −708 and ∞ above 709."""
        b = self.builder
        n = self.call("rint", self.mul(x, self.constant(1 / math.log(2))))
        n = self.call("minnum", self.call("maxnum", n, self.constant(-1022)), self.constant(1023))
        high = 6.93147180369123816490e-01  # log 2 with zeros in its last 32 bits, so that n · high is exact
        r = self.sub(
            self.sub(x, self.mul(n, self.constant(high))), self.mul(n, self.constant(1.90821492927058770002e-10))
        )
        series: ir.Value = self.constant(1 / math.factorial(EXP_TERMS))
        for k in range(EXP_TERMS - 1, -1, -1):
            series = self.add(self.mul(series, r), self.constant(1 / math.factorial(k)))
        exponent = b.shl(b.add(b.fptosi(n, self.type(LONG)), self.constant(1023, LONG)), self.constant(52, LONG))
        found = self.mul(series, b.bitcast(exponent, self.type(DOUBLE)))
        found = b.select(b.fcmp_unordered(">", x, self.constant(709.78)), self.add(x, self.constant(math.inf)), found)
        return b.select(b.fcmp_ordered("<", x, self.constant(-708.39)), self.constant(0), found)


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
    "square": lambda v, a, **_: v.mul(a, a),
    "integer_pow": lambda v, a, y, **_: v.power(a, y),
    "select_n": lambda v, *cases, **_: _select(v, *cases),
    "convert_element_type": _convert,
    "bitcast_convert_type": lambda v, a, new_dtype, **_: v.builder.bitcast(a, v.type(_kind(new_dtype))),
    "shift_right_logical": lambda v, a, b, **_: v.builder.lshr(a, b),
    "and": lambda v, a, b, **_: v.builder.and_(a, b),
    "or": lambda v, a, b, **_: v.builder.or_(a, b),
    "not": lambda v, a, **_: v.builder.not_(a),
    "stop_gradient": lambda v, a, **_: a,
    "copy": lambda v, a, **_: a,
    **{name: _compare(name) for name in COMPARED},
}


def _inner(eqn: core.JaxprEqn) -> core.ClosedJaxpr | None:
    if eqn.primitive.name not in INLINED:
        return None
    inner = eqn.params.get("jaxpr") or eqn.params.get("call_jaxpr") or eqn.params.get("fun_jaxpr")
    return inner if isinstance(inner, core.ClosedJaxpr) else core.ClosedJaxpr(inner, ())


def vectorised(lanes: Lanes, program: core.ClosedJaxpr, operands: list[ir.Value]) -> list[ir.Value]:
    """The results of a scalar program for operands that hold one scalar in each lane."""
    known = dict(zip(program.jaxpr.invars, operands, strict=True))
    for v, value in zip(program.jaxpr.constvars, program.consts, strict=True):
        known[v] = lanes.constant(np.asarray(value)[()], _kind(np.asarray(value).dtype))

    def read(v):
        return lanes.constant(v.val, _kind(v.aval.dtype)) if isinstance(v, core.Literal) else known[v]

    for eqn in program.jaxpr.eqns:
        given, name = [read(v) for v in eqn.invars], eqn.primitive.name
        inner = _inner(eqn)
        if inner is not None:
            results = vectorised(lanes, inner, given)
        elif name in INSTRUCTIONS and all(v.aval.shape == () for v in (*eqn.invars, *eqn.outvars)):
            results = [INSTRUCTIONS[name](lanes, *given, **eqn.params)]
        else:
            raise NotVectorised(f"the operation {name}")
        known.update(zip(eqn.outvars, results, strict=True))
    return [read(v) for v in program.jaxpr.outvars]
