"""How compiled code calls, by address, C functions and kernels that are compiled apart from it: those of plugins.

The addresses of such kernels are in a table. Compiled code has the table's symbol, whose address is that of this
process. So it is the same code, and in the cache, whatever is in the table.
"""

from collections.abc import Callable, Sequence
from typing import Any

NOT_LINKED = "no kernel of this number is linked"


class LinkTable:
    """Addresses of kernels for compiled code; there must be only one of each symbol in a process."""

    def __init__(self, symbol: str) -> None:
        import ctypes

        from llvmlite import binding

        self._symbol = symbol
        self._pointer = ctypes.c_void_p()
        self._tables: list[Any] = []  # all: code that runs may be about to read an earlier one
        binding.add_symbol(symbol, ctypes.addressof(self._pointer))

    def fill(self, addresses: Sequence[int]) -> None:
        """Replace the addresses; 0 is none."""
        import ctypes

        self._tables.append((ctypes.c_int64 * (1 + len(addresses)))(len(addresses), *addresses))
        self._pointer.value = ctypes.addressof(self._tables[-1])

    def call(self, like: Sequence[Any]) -> Callable[..., Any]:
        """A numba function `call(which, arguments)`, which returns nothing and raises what the kernel raises.

        It raises IndexError(NOT_LINKED) if the table has no kernel of this number. They were compiled for arguments
        like these.
        """
        from llvmlite import ir
        from numba import typeof, types
        from numba.core import cgutils
        from numba.core.errors import TypingError
        from numba.extending import intrinsic

        number = ir.IntType(64)
        expected = types.Tuple([*map(typeof, like)])

        def call(typing_context: Any, which: Any, arguments: Any) -> Any:
            if _form(arguments) != _form(expected):
                raise TypingError(f"expected arguments {expected}, found {arguments}")

            def build(context: Any, builder: Any, signature: Any, given: Any) -> Any:
                convention, kinds = context.call_conv, signature.args[1].types
                pointer = builder.module.globals.get(self._symbol) or ir.GlobalVariable(
                    builder.module, ir.PointerType(number), self._symbol
                )
                table = builder.load(pointer)
                one, none = number(1), number(0)
                is_beyond = builder.icmp_unsigned(">=", given[0], builder.load(table))
                place = builder.select(is_beyond, none, builder.add(given[0], one))
                address = builder.select(is_beyond, none, builder.load(builder.gep(table, [place])))
                with cgutils.if_unlikely(builder, builder.icmp_unsigned("==", address, none)):
                    convention.return_user_exc(builder, IndexError, (NOT_LINKED,))
                kernel = ir.PointerType(convention.get_function_type(types.none, kinds))
                values = cgutils.unpack_tuple(builder, given[1])
                status, _ = convention.call_function(
                    builder, builder.inttoptr(address, kernel), types.none, kinds, values
                )
                with cgutils.if_unlikely(builder, status.is_error):
                    convention.return_status_propagate(builder, status)
                return context.get_dummy_value()

            return types.none(types.int64, arguments), build

        made: Callable[..., Any] = intrinsic(call)
        return made


def any_layout(kind: Any) -> Any:
    """A type with arrays of any layout: code for it takes those of all layouts, as these are passed alike."""
    from numba import types

    if isinstance(kind, types.BaseNamedTuple):
        return types.NamedTuple([*map(any_layout, kind)], kind.instance_class)
    return kind.copy(layout="A") if isinstance(kind, types.Array) else kind


def _form(kind: Any) -> Any:
    """What machine code knows of an argument's type."""
    from numba import types

    if isinstance(kind, types.BaseTuple):
        return tuple(map(_form, kind))
    return (kind.dtype, kind.ndim) if isinstance(kind, types.Array) else kind


def c_call(*arguments: str, result: str = "nothing") -> Callable[[int, tuple[float, ...]], int]:
    """A call of a C function: `call(address, (values, ...))`.

    A vector of two doubles that is passed by value is two arguments: so it is on x86-64 (System V) and on AArch64, not
    on Windows.

    Args:
        arguments: "pointer" (the value is an int64 address), "int" or "double", in the order of the C function.
        result: "nothing" or "pointer".
    """

    def call(typing_context: Any, address: Any, values: Any) -> Any:
        from llvmlite import ir
        from numba import types
        from numba.core import cgutils

        byte, number = ir.PointerType(ir.IntType(8)), ir.IntType(32)
        c_types = [{"pointer": byte, "int": number, "double": ir.DoubleType()}[argument] for argument in arguments]
        is_pointer = result == "pointer"
        c_function = ir.PointerType(ir.FunctionType(byte if is_pointer else ir.VoidType(), c_types))
        values_of: Callable[[Any, Any], list[Any]] = cgutils.unpack_tuple

        def build(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            convert = {byte: builder.inttoptr, number: builder.trunc}
            passed = [
                convert[c_type](value, c_type) if c_type in convert else value
                for value, c_type in zip(values_of(builder, given[1]), c_types, strict=True)
            ]
            found = builder.call(builder.inttoptr(given[0], c_function), passed)
            return builder.ptrtoint(found, ir.IntType(64)) if is_pointer else context.get_dummy_value()

        return (types.int64 if is_pointer else types.void)(types.int64, values), build

    return _intrinsic(call, "_".join(["call", *arguments, *([result] if result != "nothing" else [])]))


def memory_access() -> tuple[Callable[[int], float], Callable[[int, float], None]]:
    """`load(address)` and `store(address, value)` of a double in memory."""

    def load(typing_context: Any, address: Any) -> Any:
        from llvmlite import ir
        from numba import types

        def build(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            return builder.load(builder.inttoptr(given[0], ir.PointerType(ir.DoubleType())))

        return types.float64(types.int64), build

    def store(typing_context: Any, address: Any, value: Any) -> Any:
        from llvmlite import ir
        from numba import types

        def build(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            builder.store(given[1], builder.inttoptr(given[0], ir.PointerType(ir.DoubleType())))
            return context.get_dummy_value()

        return types.void(types.int64, types.float64), build

    return _intrinsic(load, "load"), _intrinsic(store, "store")


def _intrinsic(types_and_code: Callable[..., Any], name: str) -> Callable[..., Any]:
    """A function for compiled code only, of numba's `intrinsic`, which takes long to import: so that waits."""

    def call(*arguments: Any) -> Any:
        raise NotImplementedError(f"{name} is for compiled code only")

    call.intrinsic = types_and_code  # type: ignore[attr-defined]
    call.__qualname__ = call.__name__ = name
    return call
