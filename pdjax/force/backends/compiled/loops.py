"""Loads, stores and loops of LLVM functions under construction."""

from collections.abc import Callable

from llvmlite import ir

from .emit import DOUBLE, LONG, Lanes, declared

INT, BYTE, VOID = ir.IntType(32), ir.IntType(8), ir.VoidType()
POINTER = ir.PointerType(BYTE)
BUFFERS = 5  # the first word of `work` that holds an address; see `handler`


class Loops:
    """A function that treats vectors of `width` numbers."""

    def __init__(self, function: ir.Function, width: int):
        self.function, self.width = function, width
        self.builder = ir.IRBuilder(function.append_basic_block("entry"))
        self.lanes = Lanes(self.builder, width)

    def buffers(self, work: ir.Value, kinds: list[ir.Type]) -> list[ir.Value]:
        """The operands and results as arrays of these types."""
        b = self.builder
        words = (b.load(b.gep(work, [LONG(BUFFERS + k)])) for k in range(len(kinds)))
        return [b.inttoptr(word, kind.as_pointer()) for word, kind in zip(words, kinds, strict=True)]

    def number(self, array: ir.Value, index: ir.Value | int) -> ir.Value:
        """One number of an array."""
        return self.builder.load(self.builder.gep(array, [LONG(index) if isinstance(index, int) else index]))

    def _place(self, array: ir.Value, index: ir.Value) -> ir.Value:
        kind = self.lanes.type(array.type.pointee)
        return self.builder.bitcast(self.builder.gep(array, [index]), kind.as_pointer())

    def vector(self, array: ir.Value, index: ir.Value) -> ir.Value:
        """The numbers of an array from this index on."""
        return self.builder.load(self._place(array, index), align=8)

    def store(self, value: ir.Value, array: ir.Value, index: ir.Value) -> None:
        """Set the numbers of an array from this index on."""
        self.builder.store(value, self._place(array, index), align=8)

    def spread(self, number: ir.Value) -> ir.Value:
        """One number in all lanes."""
        b, kind = self.builder, self.lanes.type(number.type)
        nothing = ir.Constant(kind, ir.Undefined)
        first = b.insert_element(nothing, number, INT(0))
        return b.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(INT, self.width), [INT(0)] * self.width))

    def below(self, index: ir.Value, end: ir.Value) -> ir.Value:
        """In which lanes index + lane is below `end`."""
        lanes = ir.Constant(self.lanes.type(LONG), [LONG(k) for k in range(self.width)])
        return self.builder.icmp_signed("<", lanes, self.spread(self.builder.sub(end, index)))

    def gathered(self, array: ir.Value, places: list[ir.Value]) -> ir.Value:
        """The numbers of an array at one place for each lane."""
        out: ir.Value = ir.Constant(self.lanes.type(array.type.pointee), ir.Undefined)
        for k, place in enumerate(places):
            out = self.builder.insert_element(out, self.number(array, place), INT(k))
        return out

    def memory(self, count: ir.Value) -> ir.Value:
        """Memory for numbers, to be given back by `release`."""
        malloc = declared(self.builder.module, "malloc", POINTER, [LONG])
        return self.builder.bitcast(self.builder.call(malloc, [self.builder.mul(count, LONG(8))]), DOUBLE.as_pointer())

    def release(self, memory: ir.Value) -> None:
        """Give memory back."""
        free = declared(self.builder.module, "free", VOID, [POINTER])
        self.builder.call(free, [self.builder.bitcast(memory, POINTER)])

    def loop(self, start: ir.Value, end: ir.Value, step: ir.Value | int, carried: list, body: Callable) -> list:
        """Repeat `carried = body(index, carried)` for every index from `start` to below `end`."""
        b, before = self.builder, self.builder.block
        head, inside, after = (self.function.append_basic_block() for _ in range(3))
        b.branch(head)
        b.position_at_end(head)
        index, values = b.phi(LONG), [b.phi(x.type) for x in carried]
        b.cbranch(b.icmp_signed("<", index, end), inside, after)
        b.position_at_end(inside)
        new = body(index, values)
        following = b.add(index, LONG(step) if isinstance(step, int) else step)
        for v, x, y in zip([index, *values], [start, *carried], [following, *new], strict=True):
            v.add_incoming(x, before)
            v.add_incoming(y, b.block)
        b.branch(head)
        b.position_at_end(after)
        return values

    def least(self, x: ir.Value, y: ir.Value) -> ir.Value:
        """The smaller of two whole numbers."""
        return self.builder.select(self.builder.icmp_signed("<", x, y), x, y)
