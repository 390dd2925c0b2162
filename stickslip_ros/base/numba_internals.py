# SPDX-License-Identifier: Apache-2.0
"""The only file that uses internals of numba, which may change; without it compiling takes longer.

numba optimises every function together with its callees and makes machine code of them, again for
each caller. In a kernel of a hundred small functions this takes half of the time. So a function
that a compiled function calls becomes a `_Part`, which is only typed and lowered; LLVM compiles
everything once, from the function that Python calls. What is typed again and again, as most
operations are, is looked up once (`_in_haste`).

Each file of the cache ends with a checksum; a file with a wrong checksum is compiled again.

numba names machine code by function, types and a number that counts from 1 in each process, and
closures of one text, or records of different fields, can have the same name and type in two
processes. Of two pieces of the cache that are named alike only one would be used, for both (numba's
issue 10486). So the numbers begin at random.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import io
import itertools
import operator
import secrets
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import BuiltinFunctionType
from typing import Any

import numba

#: The first and the last version of numba that this file was tested on, by
#: `validation/numba_versions.sh`. On others numba compiles as it promises.
TESTED = (0, 61), (0, 68)

try:
    from numba.core import compiler, event, ir
    from numba.core.caching import FunctionCache, IndexDataCacheFile
    from numba.core.codegen import JITCodeLibrary, ll
    from numba.core.compiler import Compiler
    from numba.core.compiler_machinery import FunctionPass, register_pass
    from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
    from numba.core.errors import ForceLiteralArg, TypingError
    from numba.core.ir_utils import get_definition, guard
    from numba.core.registry import CPUDispatcher
    from numba.core.runtime import rtsys
    from numba.core.targetconfig import ConfigStack
    from numba.core.typing.context import BaseContext
    from numba.core.untyped_passes import IRProcessing
except ImportError:
    TESTED = (0, 0), (0, 0)
    FunctionCache = IndexDataCacheFile = JITCodeLibrary = object
    _FunctionCompiler = CPUDispatcher = Compiler = FunctionPass = object

    def register_pass(**_: Any) -> Any:
        return lambda one: one


with contextlib.suppress(ImportError):
    from numba.core.bytecode import FunctionIdentity

    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(62))


#: Passes of numba that the functions of this package do not need
_NEEDLESS = "InlineClosureLikes", "InlineOverloads", "NopythonRewrites"


def is_known() -> bool:
    """Return whether this version of numba is one that this file was tested on."""
    try:
        version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    except ValueError:
        return False
    return TESTED[0] <= version <= TESTED[1]


def compile_cached(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return a function that is compiled on its first call and cached in numba's folder.

    Raises RuntimeError if that folder cannot be written.
    """
    if not is_known():
        return numba.njit(cache=True, **options)(function)
    dispatcher = numba.njit(**options)(function)
    dispatcher._cache = _Cache(function)
    return in_parts(dispatcher, options)


def in_parts(dispatcher: Any, options: dict[str, Any]) -> Any:
    """Let compiled functions that call this one use its `_Part`."""
    if is_known() and not numba.config.DISABLE_JIT:
        wanted = {"nopython": True, "no_cpython_wrapper": True, **options}
        # Made when it is needed: to load compiled functions none is.
        part = cache(lambda: _Part(dispatcher.py_func, wanted))
        dispatcher.part = part
        dispatcher.get_call_template = lambda *call: part().get_call_template(*call)
        dispatcher.get_overload = lambda signature: part().get_overload(signature)
        dispatcher._compiler = _WholeCompiler.instead_of(dispatcher._compiler)
    return dispatcher


@contextlib.contextmanager
def _in_haste() -> Iterator[None]:
    """Let numba find out once how an operation takes its types, while it has its lock.

    It tries all forms of an operation wherever that stands, and writes texts about those that do
    not fit: a third of the time, for a kernel of numbers. A tenth goes into searches for garbage,
    of which there is too little to be worth it.
    """
    known: dict[Any, Any] = {}
    find_form, find_type = numba.types.Function.get_call_type, BaseContext.resolve_value_type

    def get_call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
        flags = ConfigStack.top_or_none()
        form = function, context, tuple(args), tuple(kws.items()), bool(flags and flags.fastmath)
        if form not in known:
            try:
                known[form] = find_form(function, context, args, kws)
            except ForceLiteralArg:
                raise
            except TypingError as error:
                known[form] = error
        if isinstance(known[form], TypingError):
            raise known[form].with_traceback(None)
        return known[form]

    def resolve_value_type(context: Any, value: Any) -> Any:
        if not isinstance(value, BuiltinFunctionType):
            return find_type(context, value)
        if (context, value) not in known:
            known[context, value] = find_type(context, value)
        return known[context, value]

    patched: Any = numba.types.Function
    patched.get_call_type, BaseContext.resolve_value_type = get_call_type, resolve_value_type
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
        patched.get_call_type, BaseContext.resolve_value_type = find_form, find_type


class _WholeCompiler(_FunctionCompiler):
    """Compiles a function that Python calls, with its parts."""

    @classmethod
    def instead_of(cls, own: Any) -> Any:
        """Return one for the function of a compiler of numba's own."""
        options = own.targetoptions
        return cls(own.py_func, own.targetdescr, options, own.locals, _Passes)

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        with _in_haste():
            return self._compile_into(_WholeLibrary, args, return_type)

    def _compile_into(self, kind: Any, args: Any, return_type: Any) -> Any:
        flags = compiler.Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = kind is _PartLibrary
        target = self.targetdescr.target_context
        library = kind(target.codegen(), self.py_func.__qualname__)
        if kind is _WholeLibrary:
            library.enable_object_caching()
        return compiler.compile_extra(
            self.targetdescr.typing_context,
            target,
            self.py_func,
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            library=library,
            pipeline_class=self.pipeline_class,
        )


@register_pass(mutates_CFG=False, analysis_only=False)
class _ArraysAreNotNone(FunctionPass):
    """Answers whether an argument that is an array is None, so that what is for None falls away.

    Where it is None, numba's own passes do this.
    """

    _name = "arrays_are_not_none"

    def __init__(self) -> None:
        """Do nothing, as numba asks for."""

    def run_pass(self, state: Any) -> bool:
        """Put a constant in the place of such questions; return whether there are any."""
        function, found = state.func_ir, False
        for block in function.blocks.values():
            for line in block.find_insts(ir.Assign):
                test = line.value
                if not isinstance(test, ir.Expr) or test.op != "binop":
                    continue
                if test.fn not in (operator.is_, operator.is_not):
                    continue
                left, right = (guard(get_definition, function, of) for of in (test.lhs, test.rhs))
                asked = isinstance(left, ir.Arg) and isinstance(
                    state.args[left.index], numba.types.Array
                )
                if asked and isinstance(right, ir.Const) and right.value is None:
                    line.value = ir.Const(test.fn is operator.is_not, line.loc)
                    function._definitions[line.target.name] = [line.value]
                    found = True
        return found


class _Passes(Compiler):
    """The passes of compiling, for functions of this package without those that change nothing.

    Functions of others may have closures, or expressions of arrays.
    """

    def define_pipelines(self) -> Any:
        """Return numba's own passes, or those of them that are needed."""
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_ArraysAreNotNone, IRProcessing)
        if self.state.func_id.modname.split(".")[0] == __package__.split(".")[0]:
            passes.passes = [one for one in passes.passes if one[0].__name__ not in _NEEDLESS]
        passes._finalized = False
        passes.finalize()
        return [passes]


class _Part(CPUDispatcher):
    """A function that compiled functions can call, but Python cannot."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options)
        self._compiler: Any = _PartCompiler.instead_of(self._compiler)

    def compile(self, args: Any) -> Any:
        """Compile for types of arguments, without the timers that numba starts for each function.

        As every function listens to the events of all that it calls, they take a second.
        """
        if args not in self.overloads:
            about = {"dispatcher": self, "args": args, "return_type": None}
            with self._compiling_counter, event.trigger_event("numba:compile", data=about):
                self.add_overload(self._compiler.compile(args, None))
        return self.overloads[args].entry_point

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Find or make the code for a call; constant arguments are treated like any number."""
        kws = {name: numba.types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(numba.types.unliteral, args)), kws)

    def add_overload(self, result: Any) -> None:
        result = result._replace(entry_point=object())  # a key only: a part has no entry point
        self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result


class _PartCompiler(_WholeCompiler):
    """Types and lowers a function, and leaves the rest to the function that calls it."""

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        return self._compile_into(_PartLibrary, args, return_type)


class _PartLibrary(JITCodeLibrary):
    """The code of a part alone, not optimised and without machine code; whole it is linked."""

    def finalize(self) -> None:
        """Let any number of modules have the functions."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == ll.Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return it with all that it calls, for a function that numba compiles its own way."""
        module = self._final_module.clone()
        for library in dict.fromkeys(self._linking_libraries):
            module.link_in(library._get_module_for_linking(), preserve=True)
        return module


class _WholeLibrary(JITCodeLibrary):
    """The code of a function that Python calls, and once that of each of its parts."""

    def finalize(self) -> None:
        """Link the parts, then optimise all and make machine code as numba does."""
        calls: dict[Any, list[Any]] = {}
        waiting: list[Any] = [self]
        while waiting:
            library = waiting.pop()
            if library not in calls:
                parts = library is self or isinstance(library, _PartLibrary)
                calls[library] = library._linking_libraries if parts else []
                waiting += calls[library]
        # A part is only taken if what is linked before calls it, so those that call come first.
        _, *order = reversed([*TopologicalSorter(calls).static_order()])
        for library in order:
            if isinstance(library, _PartLibrary):
                self._final_module.link_in(library._final_module, preserve=True)
                if hasattr(library, "_reload_init"):  # since 0.62
                    self._reload_init.update(library._reload_init)
        self._linking_libraries: list[Any] = [
            one for one in order if not isinstance(one, _PartLibrary)
        ]
        super().finalize()


class _Cache(FunctionCache):
    """The cache of one function, which loads without the modules that compiling needs."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file: Any = _CheckedFile(
            plain._cache_path, plain._index_name.removesuffix(".nbi"), plain._source_stamp
        )

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the compiled function of a signature, or None.

        numba first imports everything that compiling may need, which takes 0.4 s. Machine code
        needs its runtime alone; to compile, numba does the rest then.
        """
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target)


class _CheckedFile(IndexDataCacheFile):
    """The cache of one function; a cut or changed file counts as missing."""

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        data = content.getvalue()
        with super()._open_for_write(filepath) as file:
            file.write(data + hashlib.sha256(data).digest())  # behind the end of the pickle

    def _load_index(self) -> dict[Any, str]:
        return super()._load_index() if is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not is_whole(path):
            raise OSError(f"{path} is damaged")
        return super()._load_data(name)

    def save(self, key: Any, data: Any) -> None:
        # A full disk costs the cache, not the run.
        with contextlib.suppress(OSError):
            super().save(key, data)


def is_whole(path: str) -> bool:
    """Return whether a file of the cache ends with the checksum of the rest."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-32]).digest() == content[-32:]
