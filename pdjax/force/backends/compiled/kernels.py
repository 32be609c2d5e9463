"""The loops over the bonds and the points of a body, as LLVM modules made for a pair program.

A module defines `item(work, phase, k)`, which treats one part of the body, and the functions of `handler`, which call
it. One vector holds neighbouring points; the loop over their bonds is inside, so that the numbers of these points and
their sums stay in registers.

    "lattice"   Every pair once. The neighbours at one offset of neighbouring cells are neighbouring cells again.
                Operands: filled (flat,), ξ (offsets, dim), ω (offsets,), shifts (offsets,), sizes
                Two parts of the body share sums only if they are adjacent. So three phases follow each other: set the
                sums to 0, treat the even parts, treat the odd parts.
    "cloud"     Every bond from both of its ends. The bonds of `width` neighbouring points are stored together, one bond
                of each point after the other.
                Operands: neighbours (bonds,), ξ (dim, bonds), ω (bonds,), ω of the reverse bonds (bonds,), the first
                bond of every group of points, sizes

    "points"    No bond: a function of the numbers of one point, at every point. Operand: sizes

The results have as many numbers as the rows of the points.
"""

from collections.abc import Callable

from llvmlite import ir

from .emit import DOUBLE, LONG, Parted, vectorised
from .handler import add_handler
from .loops import INT, VOID, Loops
from .machine import target
from .pairs import PairProgram

ITEM = ir.FunctionType(VOID, [LONG.as_pointer(), LONG, LONG])


def _started(program: PairProgram, geometry: list[ir.Type]) -> tuple:
    """A module with an empty function `item` and its loops; the rows, the shared numbers, the geometry and the sums."""
    machine, width = target()
    module = ir.Module("pairs")
    module.triple = machine.triple
    item = ir.Function(module, ITEM, "item")
    item.linkage = "internal"
    loops = Loops(item, width)
    counts = program.rows, len(program.numbers), len(geometry), program.outs
    kinds = [DOUBLE] * (counts[0] + counts[1]) + geometry + [DOUBLE] * counts[3]
    all_ = iter(loops.buffers(item.args[0], kinds))
    rows, vectors, arrays, sums = ([next(all_) for _ in range(n)] for n in counts)
    lengths = zip(vectors, program.numbers, strict=True)
    shared = [loops.spread(loops.number(v, i)) for v, n in lengths for i in range(n)]
    return module, item, loops, rows, shared, arrays, sums


def _finished(module: ir.Module, item: ir.Function, phases: int, program: PairProgram, geometry: list) -> ir.Module:
    """The module with its handler. `sizes` is the last array of the geometry."""
    add_handler(module, item, phases, program.rows + len(program.numbers) + len(geometry) - 1)
    return module


def lattice(program: PairProgram) -> ir.Module:
    """All pairs of a lattice, each once."""
    kinds = [DOUBLE, DOUBLE, DOUBLE, LONG, LONG]
    module, item, f, rows, shared, (filled, xi, omega, shifts, sizes), sums = _started(program, kinds)
    _, phase, k = item.args
    b, lanes, zero = f.builder, f.lanes, f.lanes.constant(0.0)
    cells, part, _, offsets, flat, plane, strip, cleared = (f.number(sizes, i) for i in range(8))
    dim, blank = program.dim, [zero] * len(rows)
    # What depends on the offset alone is computed once for each offset: `count` numbers a row of the table.
    parted = Parted(program.jaxpr, [False] * 2 * len(rows) + [True] * (dim + 2 + len(shared)))
    count = LONG(parted.count)

    def tabulate(h, table):
        bond = [f.spread(f.number(xi, b.add(b.mul(h, LONG(dim)), LONG(d)))) for d in range(dim)]
        weight = f.spread(f.number(omega, h))
        for n, x in enumerate(parted.first(lanes, [*blank, *blank, *bond, weight, weight, *shared])):
            b.store(b.extract_element(x, INT(0)), b.gep(table, [b.add(b.mul(h, count), LONG(n))]))
        return []

    def pairs(i, end, table):
        here = [f.vector(row, i) for row in rows]
        real = b.select(f.below(i, end), f.vector(filled, i), zero)

        def offset(h, mine):
            j = b.add(i, f.number(shifts, h))
            there = [f.vector(row, j) for row in rows]
            both = b.fcmp_ordered(">", lanes.mul(real, f.vector(filled, j)), zero)
            known = [f.spread(f.number(table, b.add(b.mul(h, count), LONG(n)))) for n in range(parted.count)]
            found = parted.second(lanes, [*here, *there, *[zero] * (dim + 2), *shared], known)
            found = [b.select(both, x, zero) for x in found]  # an empty cell has no bond, whatever the program gives
            for row, x in zip(sums, found[program.outs :], strict=True):
                f.store(lanes.add(f.vector(row, j), x), row, j)
            return [lanes.add(a, x) for a, x in zip(mine, found[: program.outs], strict=True)]

        mine = f.loop(LONG(0), offsets, 1, [zero] * program.outs, offset)
        for row, x in zip(sums, mine, strict=True):
            f.store(lanes.add(f.vector(row, i), x), row, i)
        return []

    def clear(i, _):
        for row in sums:
            f.store(zero, row, i)
        return []

    def strips(part_start, part_end, table):
        """The same strip of all planes, then the next one: neighbours in the next planes stay in the cache."""

        def of(t, _):
            def of_plane(x, _):
                start = b.add(x, t)
                end = f.least(f.least(b.add(start, strip), b.add(x, plane)), part_end)
                return f.loop(start, end, f.width, [], lambda i, _: pairs(i, end, table))

            return f.loop(part_start, part_end, plane, [], of_plane)

        f.loop(LONG(0), plane, strip, [], of)

    with b.if_else(b.icmp_signed("==", phase, LONG(0))) as (at_first, then):
        with at_first:
            start = b.mul(k, cleared)
            f.loop(f.least(start, flat), f.least(b.add(start, cleared), flat), f.width, [], clear)
        with then:
            table = f.memory(b.mul(offsets, count))
            f.loop(LONG(0), offsets, 1, [], lambda h, _: tabulate(h, table))
            start = b.mul(b.sub(b.add(b.shl(k, LONG(1)), phase), LONG(1)), part)
            strips(f.least(start, cells), f.least(b.add(start, part), cells), table)
            f.release(table)
    b.ret_void()
    return _finished(module, item, 3, program, kinds)


def cloud(program: PairProgram) -> ir.Module:
    """All bonds of a cloud, from both ends."""
    kinds = [INT, DOUBLE, DOUBLE, DOUBLE, LONG, LONG]
    module, item, f, rows, shared, (neighbours, xi, omega, back, firsts, sizes), sums = _started(program, kinds)
    k = item.args[2]
    b, lanes, zero = f.builder, f.lanes, f.lanes.constant(0.0)
    groups, part, bonds = (f.number(sizes, i) for i in (0, 1, 3))

    def group(q, _):
        i = b.mul(q, LONG(f.width))
        here = [f.vector(row, i) for row in rows]

        def bond(e, mine):
            places = [b.zext(f.number(neighbours, b.add(e, LONG(k))), LONG) for k in range(f.width)]
            there = [f.gathered(row, places) for row in rows]
            between = [f.vector(xi, b.add(b.mul(bonds, LONG(d)), e)) for d in range(program.dim)]
            weights = f.vector(omega, e), f.vector(back, e)
            found = vectorised(lanes, program.jaxpr, [*here, *there, *between, *weights, *shared])[: program.outs]
            real = b.or_(*(b.fcmp_unordered("!=", w, zero) for w in weights))
            found = [b.select(real, x, zero) for x in found]
            return [lanes.add(a, x) for a, x in zip(mine, found, strict=True)]

        start, end = f.number(firsts, q), f.number(firsts, b.add(q, LONG(1)))
        for row, x in zip(sums, f.loop(start, end, f.width, [zero] * program.outs, bond), strict=True):
            f.store(x, row, i)
        return []

    start = b.mul(k, part)
    f.loop(f.least(start, groups), f.least(b.add(start, part), groups), 1, [], group)
    b.ret_void()
    return _finished(module, item, 1, program, kinds)


def points(program: PairProgram) -> ir.Module:
    """Every point alone: the program sees the point at both ends, and the sum is (near + far)."""
    kinds = [LONG]
    module, item, f, rows, shared, (sizes,), sums = _started(program, kinds)
    b, nothing = f.builder, f.lanes.constant(0.0)
    flat, part = (f.number(sizes, i) for i in (0, 1))

    def vector(i, _):
        i = f.least(i, b.sub(flat, LONG(f.width)))  # the last vector ends with the last number
        here = [f.vector(row, i) for row in rows]
        found = vectorised(f.lanes, program.jaxpr, [*here, *here, *[nothing] * (program.dim + 2), *shared])
        for row, x, y in zip(sums, found[: program.outs], found[program.outs :], strict=True):
            f.store(f.lanes.add(x, y), row, i)
        return []

    start = b.mul(item.args[2], part)
    f.loop(f.least(start, flat), f.least(b.add(start, part), flat), f.width, [], vector)
    b.ret_void()
    return _finished(module, item, 1, program, kinds)


KERNELS: dict[str, Callable[[PairProgram], ir.Module]] = {"lattice": lattice, "cloud": cloud, "points": points}
