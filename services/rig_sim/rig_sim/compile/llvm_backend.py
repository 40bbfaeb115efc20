"""Compile LLVM IR in memory for this machine's processor."""

import ctypes
import ctypes.util
import sys
import weakref
from dataclasses import dataclass
from functools import cache

from llvmlite import binding as llvm

#: Called where the processor has no such instruction.
_LIBM = ("fma", "floor")


@dataclass(frozen=True)
class CompiledModule:
    """Machine code; it stays in memory as long as this object, and no address may outlive it.

    `engine`: The owner of the code.
    """

    engine: llvm.ExecutionEngine

    def address(self, symbol: str) -> int:
        """Return the address of a function."""
        address = self.engine.get_function_address(symbol)
        if not address:
            raise ValueError(f"The compiled module has no function {symbol!r}; name one that its text defines.")
        return address


def compile_module(text: str, *, optimization: int = 2) -> CompiledModule:
    """Compile a module."""
    _initialize()
    context = llvm.create_context()
    module = llvm.parse_assembly(text, context)
    module.verify()
    target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=optimization
    )
    tuning = llvm.create_pipeline_tuning_options(speed_level=optimization)
    # Packing neighbouring scalars gains 1 to 3 % on traced models: lanes are the place for vectors.
    tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(target, tuning)
    builder.getModulePassManager().run(module, builder)
    engine = llvm.create_mcjit_compiler(module, target)
    engine.finalize_object()
    compiled = CompiledModule(engine)
    # The garbage collector finalises what is in a cycle in any order; the engine must go before the context of its
    # module, or LLVM reads freed memory. Held here, neither is garbage before the module of both is.
    weakref.finalize(compiled, _dispose, engine, context).atexit = False
    return compiled


def _dispose(engine: llvm.ExecutionEngine, context: llvm.ContextRef) -> None:
    engine.close()
    context.close()


@cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    # LLVM looks symbols up in the process, where a statically linked Python has no libm: name the addresses.
    library = ctypes.CDLL("libm.so.6" if sys.platform == "linux" else ctypes.util.find_library("m"))
    for name in _LIBM:
        llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
