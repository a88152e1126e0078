"""Make the library of kernels that images hold in place of a compiler: `python deploy/kernel_library.py FOLDER CPU`.

Renders and localises the scenes of `distalock.prepare`, which calls every kernel with the types that it will be called
with later, and compiles each kernel for each of these types with numba's ahead-of-time compiler, with the options of
its decorator, which that compiler by itself does not know. Needs a C compiler. For builds only.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from llvmlite.binding import Linkage
from numba.core import types
from numba.core.compiler import Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime import nrtdynmod
from numba.np.numpy_support import as_dtype
from numba.pycc import cc
from numba.pycc.compiler import ExportEntry, ModuleCompiler

from distalock.prepare import compile_kernels
from shared.just_in_time import KERNELS, SOURCES, Dispatcher
from shared.kernel_library import CONTENTS, MODULE, Key, name_of, source_sha256

PRODUCT: Final = ("shared.", "services.")
# Of numba's for what every compiled function may refer to.
_ENVIRONMENT: Final = "_ZN08NumbaEnv"


class KernelEntry(ExportEntry):
    """A function of the library: a kernel for arguments of some types, with its decorator's options."""

    def __init__(self, number: int, kernel: Dispatcher, signature: Any) -> None:
        super().__init__(f"kernel_{number}", signature, kernel.py_func)
        self.options = kernel.targetoptions


class _Compiler(ModuleCompiler):
    """Numba's ahead-of-time compiler, with each kernel's own options."""

    @global_compiler_lock
    def _cull_exports(self) -> Any:
        self.exported_function_types, self.function_environments = {}, {}
        self.environment_gvs, self.extra_environments = {}, {}
        library = self.context.codegen().create_library(self.module_name)
        library.add_ir_module(nrtdynmod.create_nrt_module(self.context)[0])
        for entry in self.export_entries:
            self._add(entry, library)
        wrapper = library.create_ir_module("wrapper")
        self._emit_python_wrapper(wrapper)
        library.add_ir_module(wrapper)
        library.finalize()
        for function in library.get_defined_functions():
            if function.name not in self.dll_exports:
                inner = function.linkage in {Linkage.private, Linkage.internal}
                function.visibility = "default" if inner else "hidden"
        return library

    def _add(self, entry: KernelEntry, library: Any) -> None:
        flags = Flags()
        cpu_target.options.parse_as_flags(flags, entry.options)
        flags.no_compile, flags.no_cfunc_wrapper, flags.nrt = True, True, True
        made = compile_extra(
            self.typing_context,
            self.context,
            entry.function,
            entry.signature.args,
            entry.signature.return_type,
            flags,
            locals={},
            library=library,
        )
        made.library.get_function(made.fndesc.llvm_func_name).linkage = "internal"
        wrapper = made.library.get_function(made.fndesc.llvm_cpython_wrapper_name)
        wrapper.name, wrapper.linkage = self._mangle_method_symbol(entry.symbol), "external"
        convention = made.target_context.call_conv
        self.exported_function_types[entry] = convention.get_function_type(made.fndesc.restype, made.fndesc.argtypes)
        self.function_environments[entry] = made.environment
        self.environment_gvs[entry] = made.fndesc.env_name
        self.extra_environments.update(_environments(library))


def _environments(library: Any) -> Iterator[tuple[str, Any]]:
    for linked in library._linking_libraries:
        for variable in linked._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                found = lookup_environment(variable.name)
                if found is not None and found.can_cache():
                    yield variable.name, found


def called_kernels() -> list[KernelEntry]:
    """Every kernel of `shared` and the services that was called, for the types that it was called with."""
    product = (kernel for kernel in KERNELS if kernel.py_func.__module__.startswith(PRODUCT))
    called = [
        (kernel, kernel.overloads[given].signature)
        for kernel in sorted(product, key=lambda one: name_of(one.py_func))
        for given in dict.fromkeys([*kernel.stats.cache_hits, *kernel.stats.cache_misses])
    ]
    return [KernelEntry(number, *one) for number, one in enumerate(called)]


def key_of_type(numba_type: Any) -> Key:
    """What `shared.kernel_library.key_of` says of values of this type."""
    if isinstance(numba_type, types.Array):
        dtype = as_dtype(numba_type.dtype).str
        return dtype, numba_type.ndim, numba_type.layout, numba_type.mutable, numba_type.aligned
    if isinstance(numba_type, types.BaseTuple):
        name = numba_type.instance_class.__name__ if isinstance(numba_type, types.BaseNamedTuple) else "tuple"
        return name, *map(key_of_type, numba_type)
    return str(as_dtype(numba_type).str)


def contents(entries: Sequence[KernelEntry], cpu: str) -> dict[str, object]:
    """What the library holds, for the file beside it."""
    sources = sorted(name for name in SOURCES if name.startswith(PRODUCT))
    return {
        "cpu": cpu,
        "sources": {name: source_sha256(name) for name in sources},
        "kernels": [
            {
                "name": name_of(entry.function),
                "symbol": entry.symbol,
                "types": [key_of_type(one) for one in entry.signature.args],
            }
            for entry in entries
        ],
    }


def compile_library(entries: Sequence[KernelEntry], folder: Path, cpu: str) -> None:
    """Compile a library into a folder, for processors from `cpu` on."""
    cc.ModuleCompiler = _Compiler
    compiler = cc.CC(MODULE, source_module="numba")  # any module: only its folder is asked for, and set anew here
    compiler.output_dir, compiler.target_cpu = str(folder), cpu
    compiler._exported_functions.update({entry.symbol: entry for entry in entries})
    compiler.compile()
    (folder / CONTENTS).write_text(json.dumps(contents(entries, cpu), indent=1), encoding="utf-8")


def main(folder: Path, cpu: str) -> None:
    """Make the library of the product's kernels; ends the process when the scenes that call them are refused."""
    if (verdict := compile_kernels()) != "accepted":
        sys.exit(f"the scenes that call the kernels were {verdict}")
    entries = called_kernels()
    compile_library(entries, folder, cpu)
    names = {name_of(entry.function) for entry in entries}
    sys.stdout.write(f"{len(entries)} pieces of machine code of {len(names)} kernels\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
