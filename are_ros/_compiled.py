"""Typed access to numba's compiler, with the options that every kernel here shares."""

import fcntl
import hashlib
import re
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import Event
from typing import IO, Any, ClassVar, Final, TypeVar, cast

import numba
from numba import types
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    NullCache,
    UserProvidedCacheLocator,
)
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined] # not typed
from numba.core.registry import CPUDispatcher

from are_ros.errors import InstallationError

_Function = TypeVar("_Function", bound=Callable[..., Any])

_PACKAGE: Final = Path(__file__).parent
_IMPORT: Final = re.compile(
    rf"^\s*from ({_PACKAGE.name}[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE
)

_LONG_STACK: Final = 2**17
"""How many words a frame has, half of a piece of the stack: 1 MB."""
_ATTEMPTS: Final = 6000
_PAUSE_S: Final = 0.01

KERNELS: Final[list[str]] = []
"""The full names of all kernels of the modules that are imported."""


def compiled(function: _Function, **options: bool) -> _Function:
    """Compile a kernel to machine code on its first call, and keep it on disk.

    The cache lies beside the module, in NUMBA_CACHE_DIR when that is set (one for all places where
    the same sources are installed), or in the user's cache directory when the package is not
    writable. A change of the module, or of any module of the
    package that it imports, makes it anew. Floating point stays strict (IEEE). No code for C
    callbacks is made: it is a tenth of the compiler's time, and unused. No kernel
    should assign an array to a slice: the message of a wrong shape alone compiles for seconds.
    """
    if numba.config.DISABLE_JIT:
        return function
    KERNELS.append(name_of(function))
    ours = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    return cast("_Function", _Kernel(function, {**ours, **options}))


class _Kernel(CPUDispatcher):  # type: ignore[misc] # numba is not typed
    """A kernel as Python calls it. As others call it, it is a `_Part` of theirs.

    Numba itself makes machine code of each kernel that another one calls, with a wrapper for
    Python, though most are called by kernels alone: a sixth of the time of a first start.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_KernelCompiler)
        self._compiler = _WithQuickFlags(function, self.targetdescr, options, {}, _KernelCompiler)
        self._cache = KernelCache(function)  # as `enable_caching` of numba does
        self._part = _Part(function, options, self)

    @property
    def _numba_type_(self) -> types.Type:
        """What kernels see that call this one."""
        return types.Dispatcher(self._part)

    def add_overload(self, result: Any) -> None:
        """Take what was compiled; the parts in it get their environments."""
        super().add_overload(result)
        for environment in result._find_referenced_environments():  # noqa: SLF001 - numba has no other way
            result.library.codegen.set_env(environment.env_name, environment)


class _Part(CPUDispatcher):  # type: ignore[misc] # numba is not typed
    """A kernel as others call it: no machine code of its own, its code is put into theirs.

    If Python has called the kernel before, its code is there already, and is taken.
    """

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], kernel: _Kernel
    ) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_PartCompiler)
        self._compiler = _WithQuickFlags(function, self.targetdescr, options, {}, _PartCompiler)
        self._cache = _Made(kernel)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what numba calls for arguments of some types; literals count as their plain type.

        Numba types `step(0)` by the literal 0 at first, and would compile `step` for it alone, and
        once more for any integer.
        """
        plain = {name: types.unliteral(kind) for name, kind in dict(kws).items()}
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), plain)

    def add_overload(self, result: Any) -> None:
        """Take what was compiled, and let others find it by an entry point that is only a name."""
        result = result._replace(entry_point=object())
        self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        self.overloads[tuple(result.signature.args)] = result


class _Made(NullCache):  # type: ignore[misc] # numba is not typed
    """The kernels that Python has called, as a cache of the parts."""

    def __init__(self, kernel: _Kernel) -> None:
        self._kernel = kernel

    def load_overload(self, sig: Any, _target_context: Any) -> Any:
        """Return what was compiled of the kernel for a signature, if anything was."""
        result = self._kernel.overloads.get(sig)
        return result and result._replace(metadata={})  # numba adds how long this took


class _KernelCompiler(Compiler):  # type: ignore[misc] # numba is not typed
    """Compiles to machine code, into a library of ours."""

    def define_pipelines(self) -> Any:
        """Return the passes of the compiler."""
        state = self.state
        state.library = _KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


class _PartCompiler(Compiler):  # type: ignore[misc] # numba is not typed
    """Goes as far as code that can be linked."""

    def define_pipelines(self) -> Any:
        """Return the passes of the compiler."""
        state = self.state
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


class _KernelLibrary(JITCodeLibrary):  # type: ignore[misc] # numba is not typed
    """Code that is optimised once: numba itself also does so with each function alone, at first.

    That was a twentieth of the time of a first start, and the kernels are as fast without.
    """

    def _optimize_functions(self, module: Any) -> None:
        """Leave the functions as they are; the data layout is needed later."""
        module.data_layout = self._codegen._data_layout  # noqa: SLF001 - numba has no other way


class _PartLibrary(_KernelLibrary):
    """Code that becomes machine code where it is linked into."""

    def finalize(self) -> None:
        """Link what this code calls, and optimise it: inlined first, loops would not be vectors."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)  # noqa: SLF001 - numba has no other way
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)  # noqa: SLF001
        self._optimize_final_module()
        self._finalize_dynamic_globals()
        self._finalized = True


class _WithQuickFlags(_FunctionCompiler):  # type: ignore[misc] # numba is not typed
    """What a dispatcher compiles with."""

    def _customize_flags(self, flags: Any) -> Any:
        return _QuickFlags(flags)


class _QuickFlags(Flags):  # type: ignore[misc] # numba is not typed
    """The compiler's options, quick to hash and to compare.

    Numba looks up each call by its types and by all options there are, one after the other: a tenth
    of the time of a first start.
    """

    def __hash__(self) -> int:
        """Return the same for all: the types tell calls apart, the options hardly ever."""
        return hash(type(self))

    def __eq__(self, other: object) -> bool:
        """Return whether all options are the same; only those that either one sets can differ."""
        if not isinstance(other, _QuickFlags):
            return False
        if self._values == other._values:
            return True
        is_set = self._values.keys() | other._values.keys()
        return all(getattr(self, name) == getattr(other, name) for name in is_set)


def name_of(function: Callable[..., Any]) -> str:
    """Return a kernel's full name."""
    return f"{function.__module__}.{function.__qualname__}"


class _SameForAllInstallations(UserProvidedCacheLocator):  # type: ignore[misc] # numba is not typed
    """The folder in NUMBA_CACHE_DIR of a module of the package, wherever that is installed.

    Numba itself would have one for each place, and compile the same sources in each.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the folder's path below NUMBA_CACHE_DIR."""
        return str(Path(py_file).parent.relative_to(_PACKAGE.parent))

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """Return the locator of a function; None if no folder is set, or for another package."""
        if Path(py_file).is_relative_to(_PACKAGE):
            return super().from_function(py_func, py_file)
        return None


class _KernelCacheImpl(CompileResultCacheImpl):  # type: ignore[misc] # numba is not typed
    _locator_classes: ClassVar = [
        _SameForAllInstallations,
        *CompileResultCacheImpl._locator_classes,  # noqa: SLF001 - numba has no other way
    ]


class KernelCache(FunctionCache):  # type: ignore[misc] # numba is not typed
    """Numba's cache, for kernels of several modules and for several processes at a time.

    Numba itself compares only the kernel's own module with what was compiled, not the modules that
    it calls. If two processes add to its index at once, one loses its entry, or gets the other's
    code. So each kernel is locked from the miss until it is saved, and no other process compiles
    it meanwhile. Kernels do not call each other in circles, so there is no deadlock.
    """

    _impl_class = _KernelCacheImpl
    _files: ClassVar[dict[Path, IO[str]]] = {}

    def __init__(self, function: Callable[..., Any]) -> None:
        try:
            super().__init__(function)
        except RuntimeError as cause:  # numba found no folder
            raise InstallationError(
                f"the kernels, compiled for minutes, can be kept neither in {_PACKAGE} nor in the"
                " user's cache (HOME or XDG_CACHE_HOME): neither can be written. Set"
                " NUMBA_CACHE_DIR to a folder that can"
            ) from cause
        source = Path(function.__code__.co_filename)
        if source.is_file():
            self._cache_file._source_stamp = source_stamp(source)  # noqa: SLF001
        self._offset = zlib.crc32(self._impl.filename_base.encode())
        self._is_held = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature; None, and lock the kernel, if nothing was."""
        if self._is_held:
            return self._kept(sig, target_context)
        self._lock(fcntl.LOCK_SH | fcntl.LOCK_NB)
        found = self._kept(sig, target_context)
        if found is None:
            self._lock(fcntl.LOCK_UN)
            self._lock(fcntl.LOCK_EX | fcntl.LOCK_NB)
            found = self._kept(sig, target_context)
        self._is_held = found is None
        if not self._is_held:
            self._lock(fcntl.LOCK_UN)
        return found

    def _kept(self, sig: Any, target_context: Any) -> Any:
        """Return what the files hold; None, and forget them, if they are damaged.

        As files are that were written shortly before the power was cut.
        """
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - damaged bytes make pickle raise anything
            with suppress(OSError):
                self._cache_file.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, and unlock the kernel."""
        try:
            super().save_overload(sig, data)
        except OSError as cause:
            folder, why = self.cache_path, cause.strerror
            raise InstallationError(
                f"compiled kernels cannot be kept in {folder}: {why}"
            ) from cause
        self._lock(fcntl.LOCK_UN)
        self._is_held = False

    def _lock(self, how: int) -> None:
        """Lock or unlock one byte of the file; go on without after a minute, or where none can."""
        pause = Event()
        with suppress(OSError):
            for _ in range(_ATTEMPTS):
                if self._is_locked(how):
                    return
                pause.wait(_PAUSE_S)

    def _is_locked(self, how: int) -> bool:
        try:
            fcntl.lockf(self._file(), how, 1, self._offset)
        except (BlockingIOError, PermissionError):
            return False
        return True

    def _file(self) -> IO[str]:
        """Return the folder's file of locks: one for good, to close any would unlock all."""
        folder = Path(self.cache_path)
        if folder not in self._files:
            folder.mkdir(parents=True, exist_ok=True)
            self._files[folder] = (folder / "kernels.lock").open("a+", encoding="ascii")
        return self._files[folder]


@cache
def source_stamp(source: Path) -> str:
    """Return a hash of the contents of a module and of all of the package that it imports."""
    reached: set[Path] = set()
    todo = [source]
    while todo:
        path = todo.pop()
        if path not in reached:
            reached.add(path)
            todo += _digest_and_imports(path)[1]
    digests = [_digest_and_imports(path)[0] for path in sorted(reached)]
    return hashlib.sha256(b"".join(digests)).hexdigest()


@cache
def _digest_and_imports(path: Path) -> tuple[bytes, list[Path]]:
    text = path.read_text(encoding="utf-8")
    imports = [file for found in _IMPORT.finditer(text) for file in _modules(*found.groups())]
    return hashlib.sha256(text.encode()).digest(), imports


@cache
def _modules(module: str, names: str) -> list[Path]:
    """Return the files of `from module import names`, where the names may be modules."""
    folder = _PACKAGE.parent.joinpath(*module.split("."))
    beside = (
        [folder / f"{name}.py" for name in re.findall(r"\w+", names)] if folder.is_dir() else []
    )
    return [f for f in (folder.with_suffix(".py"), folder / "__init__.py", *beside) if f.is_file()]


def borrowing(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes no arrays.

    No references are counted in it: to count takes atomic operations at each row of a path, which
    was half of what planning took. Nor does a kernel that it calls, unless that is `owning`.
    """
    return compiled(function, _nrt=False)


def owning(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes arrays and that borrowing ones call."""
    return compiled(function, _nrt=True)


def inlined(function: _Function) -> _Function:
    """Compile, as `borrowing` does, a kernel that becomes a part of those that call it.

    A call that takes arrays passes seven numbers for each, which costs more than a short kernel.
    """
    return compiled(function, _nrt=False, forceinline=True)


def on_long_stack(function: _Function) -> _Function:
    """Let all that a function calls have its frames in one piece of Python's stack.

    The interpreter keeps frames in pieces of 16 KB. A call at the end of one maps another, and its
    return unmaps that: the deep compiler did so half a million times, a twelfth of a first start.
    A frame that is as large as this one makes the interpreter map a piece with room for all.
    """
    function.__code__ = function.__code__.replace(co_stacksize=_LONG_STACK)
    return function
