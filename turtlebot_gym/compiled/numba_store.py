"""The cache of numba's functions in the files of `store`.

numba's own cache keeps files beside the sources, for each checkout its own, and forgets a function whenever its file changes.
It offers neither such a cache nor the address of a function to others: this module and `turtlebot_gym.inlining` use names of
numba that are not public. With a numba that lacks them each process compiles for itself, and loops run on one thread.
"""

from __future__ import annotations

import hashlib
import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from numba import typeof
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from turtlebot_gym.compiled import store


def keep(dispatcher: Any, name: str, identity: str) -> None:
    """Let a function of numba load its machine code from the cache, and write there what it compiles.

    Args:
        dispatcher: The function.
        name: What it does, for people.
        identity: Hash of everything that its machine code is made of, except for types and processor.

    Raises:
        AttributeError: If this numba has no such function.
    """
    if not hasattr(dispatcher, "_cache"):
        raise AttributeError("This numba keeps its cache elsewhere.")
    cache, compile_now = Store(name, identity), dispatcher.compile
    dispatcher._cache, dispatcher.compile = cache, cache.released(compile_now)


def address_of(function: Any, *arguments: Any) -> int:
    """Return the address of a compiled function's machine code for the types of some arguments."""
    kinds = tuple(map(typeof, arguments))
    function.compile(kinds)
    result = function.overloads[kinds]
    return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)


class Store:
    """Cache of a function's machine code, a file for each type of its arguments. It has the methods of numba's own caches.

    Args:
        name: What the function does, for people.
        identity: Hash of everything the machine code is made of, except for types and processor.
    """

    def __init__(self, name: str, identity: str) -> None:
        self._name, self._identity = name, identity
        self._lock: IO[str] | None = None
        self._began = 0.0

    @property
    def cache_path(self) -> str:
        return str(store.folder())

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return a compile result from its file; None, and a notice, if numba has to compile."""
        rtsys.initialize(target)  # machine code from a file needs no more; numba refreshes its context where it compiles
        path = self._path(signature, target.codegen())

        def load(data: bytes) -> Any:
            return CompileResult._rebuild(target, *pickle.loads(data))

        result = store.read(path, load)
        if result is None:
            self._lock = store.lock_of(path.with_suffix(".lock"), self._name)
            result = store.read(path, load)  # another process may have compiled it meanwhile
        if result is None:
            self._began = time.perf_counter()
            store.say(f"turtlebot_gym: compiling {self._name} for this machine, once ... ")
        return result

    def save_overload(self, signature: Any, result: Any) -> None:
        """Write what numba has compiled, if the folder is writable."""
        store.say(f"{time.perf_counter() - self._began:.1f} s\n")
        assert not result.library.has_dynamic_globals, "addresses in the code are another process's"
        store.write(self._path(signature, result.codegen), dumps(result._reduce()))

    def released(self, compile_: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Return numba's method that loads or compiles, after which, even after an error, no other process waits."""

        def run(signature: Any) -> Any:
            try:
                return compile_(signature)
            finally:
                store.release(self._lock)
                self._lock = None

        return run

    def _path(self, signature: Any, codegen: Any) -> Path:
        key = f"{self._identity} {signature} {codegen.magic_tuple()}"
        return store.path_of(self._name, hashlib.sha256(key.encode()).hexdigest())
