"""The function that XLA calls: it shares the parts of a body among the threads of XLA's own pool.

XLA passes a call frame, a C structure of `xla/ffi/api/c_api.h` in the package jaxlib. The offsets below are those of
its fields in bytes. A thread takes parts until none is left. A part of the next phase waits until the phase before it
is done, and only for parts that other threads are computing, so that no thread ever waits for one that has not begun.
"""

import functools
import re
from pathlib import Path

import jaxlib
from llvmlite import ir

from .emit import LONG, declared
from .loops import BUFFERS, INT, POINTER, VOID, Loops

HEADER = Path(jaxlib.__file__).parent / "include" / "xla" / "ffi" / "api" / "c_api.h"
EXTENSION, API, CONTEXT, STAGE = 8, 16, 24, 32
ARGUMENTS, COUNT_OF_ARGUMENTS, RESULTS, COUNT_OF_RESULTS = 72, 56, 112, 96
EXECUTE = 3
DATA = 24  # of a buffer
FIRST_FUNCTION = 48  # of the table of functions


@functools.cache
def functions() -> tuple[dict[str, int], tuple[int, int]]:
    """The offsets of the functions in XLA's table, and the version of the interface; no offsets if it is not known."""
    if not HEADER.exists():
        return {}, (0, 0)
    text = HEADER.read_text()
    names = re.findall(r"^  _XLA_FFI_API_STRUCT_FIELD\((\w+)\);", text, re.M)
    major, minor = (int(re.findall(rf"#define XLA_FFI_API_{part} (\d+)", text)[0]) for part in ("MAJOR", "MINOR"))
    return {name: FIRST_FUNCTION + 8 * k for k, name in enumerate(names)}, (major, minor)


def add_handler(module: ir.Module, item: ir.Function, phases: int, sizes: int) -> None:
    """Add the functions `run(work)` and `handler(frame)` to a module.

    `sizes` is the number of the operand that holds (…, items of a phase at index 2).
    """
    run = _run(module, item)
    handler = ir.Function(module, ir.FunctionType(POINTER, [POINTER]), "handler")
    (frame,) = handler.args
    loops = Loops(handler, 1)
    b = loops.builder
    offsets, version = functions()

    def place(base, offset, kind):
        return b.bitcast(b.gep(base, [LONG(offset)]), kind.as_pointer())

    def read(base, offset, kind=LONG):
        return b.load(place(base, offset, kind))

    null = ir.Constant(POINTER, None)
    extension = read(frame, EXTENSION, POINTER)
    with b.if_then(b.icmp_unsigned("!=", extension, null)):
        with b.if_then(b.icmp_unsigned("==", read(extension, 8, INT), INT(1))):
            about = read(extension, 24, POINTER)
            for offset, value in ((24, version[0]), (28, version[1]), (32, 0)):
                b.store(INT(value), place(about, offset, INT))
            b.ret(null)
    with b.if_then(b.icmp_unsigned("!=", read(frame, STAGE, INT), INT(EXECUTE))):
        b.ret(null)
    given, wanted = read(frame, COUNT_OF_ARGUMENTS), read(frame, COUNT_OF_RESULTS)
    memory = b.bitcast(loops.memory(b.add(b.add(given, wanted), LONG(BUFFERS))), POINTER)
    work = b.bitcast(memory, LONG.as_pointer())

    def word(index):
        return b.gep(work, [LONG(index) if isinstance(index, int) else index])

    for source, count, start in ((ARGUMENTS, given, LONG(BUFFERS)), (RESULTS, wanted, b.add(given, LONG(BUFFERS)))):
        table = b.bitcast(read(frame, source, POINTER), POINTER.as_pointer())

        def copy(k, _, table=table, start=start):
            b.store(read(b.load(b.gep(table, [k])), DATA), word(b.add(start, k)))
            return []

        loops.loop(LONG(0), count, 1, [], copy)
    items = b.load(b.gep(b.inttoptr(b.load(word(BUFFERS + sizes)), LONG.as_pointer()), [LONG(2)]))
    api, context = read(frame, API, POINTER), read(frame, CONTEXT, POINTER)

    def api_call(name, block):
        kind = ir.FunctionType(POINTER, [POINTER]).as_pointer()
        return b.call(read(api, offsets[name], kind), [b.bitcast(block, POINTER)])

    def destroy(error):
        block = b.alloca(LONG, 3)
        for k, x in ((0, LONG(24)), (1, LONG(0)), (2, b.ptrtoint(error, LONG))):
            b.store(x, b.gep(block, [LONG(k)]))
        api_call("XLA_FFI_Error_Destroy", block)

    answer, threads = b.alloca(LONG, 4), b.alloca(LONG)
    b.store(LONG(1), threads)
    for k, x in ((0, LONG(32)), (1, LONG(0)), (2, b.ptrtoint(context, LONG)), (3, b.ptrtoint(threads, LONG))):
        b.store(x, b.gep(answer, [LONG(k)]))
    error = api_call("XLA_FFI_ThreadPool_NumThreads", answer)
    with b.if_then(b.icmp_unsigned("!=", error, null)):
        destroy(error)
        b.store(LONG(1), threads)
    count = b.load(threads)
    count = b.select(b.icmp_signed("<", count, items), count, items)
    count = b.select(b.icmp_signed(">", count, LONG(1)), count, LONG(1))
    for k, x in ((0, count), (1, LONG(0)), (2, LONG(0)), (3, items), (4, b.mul(items, LONG(phases)))):
        b.store(x, word(k))
    task = b.alloca(LONG, 5)
    for k, x in enumerate(
        (LONG(40), LONG(0), b.ptrtoint(context, LONG), b.ptrtoint(run, LONG), b.ptrtoint(memory, LONG))
    ):
        b.store(x, b.gep(task, [LONG(k)]))

    def schedule(k, _):
        error = api_call("XLA_FFI_ThreadPool_Schedule", task)
        with b.if_then(b.icmp_unsigned("!=", error, null)):
            destroy(error)
            b.atomic_rmw("sub", word(0), LONG(1), "seq_cst")
        return []

    loops.loop(LONG(1), count, 1, [], schedule)
    # The last part may be under way in another thread: its words must outlive `run`, so one more user is counted.
    b.atomic_rmw("add", word(0), LONG(1), "seq_cst")
    b.call(run, [memory])
    _wait(b, handler, word(2), b.load(word(4)))
    _release(b, work, memory)
    b.ret(null)


def _wait(b: ir.IRBuilder, function: ir.Function, counter: ir.Value, least: ir.Value) -> None:
    """Wait until a counter has reached a number."""
    sched_yield = declared(b.module, "sched_yield", INT, [])
    head, inside, after = (function.append_basic_block() for _ in range(3))
    b.branch(head)
    b.position_at_end(head)
    done = b.load_atomic(counter, "acquire", 8)
    b.cbranch(b.icmp_signed("<", done, least), inside, after)
    b.position_at_end(inside)
    b.call(sched_yield, [])
    b.branch(head)
    b.position_at_end(after)


def _release(b: ir.IRBuilder, work: ir.Value, memory: ir.Value) -> None:
    """Give the words back; the last user frees them."""
    free = declared(b.module, "free", VOID, [POINTER])
    users = b.atomic_rmw("sub", work, LONG(1), "seq_cst")
    with b.if_then(b.icmp_signed("==", users, LONG(1))):
        b.call(free, [memory])


def _run(module: ir.Module, item: ir.Function) -> ir.Function:
    """`run(work)` takes parts until none is left."""
    run = ir.Function(module, ir.FunctionType(VOID, [POINTER]), "run")
    (memory,) = run.args
    b = ir.IRBuilder(run.append_basic_block("entry"))
    work = b.bitcast(memory, LONG.as_pointer())

    def word(k):
        return b.gep(work, [LONG(k)])

    per, total = b.load(word(3)), b.load(word(4))
    head, inside, after = (run.append_basic_block() for _ in range(3))
    b.branch(head)
    b.position_at_end(head)
    number = b.atomic_rmw("add", word(1), LONG(1), "seq_cst")
    b.cbranch(b.icmp_signed("<", number, total), inside, after)
    b.position_at_end(inside)
    phase = b.sdiv(number, per)
    _wait(b, run, word(2), b.mul(phase, per))
    b.call(item, [work, phase, b.srem(number, per)])
    b.atomic_rmw("add", word(2), LONG(1), "seq_cst")
    b.branch(head)
    b.position_at_end(after)
    _release(b, work, memory)
    b.ret_void()
    return run
