"""Compiled programs kept on disk, so that later processes read them instead of compiling again.

JAX has a persistent compilation cache, which is off until a folder is named. `use_compilation_cache` names a folder for
the command line and for users who call it. Only this module of pdjax writes to `jax.config`.
"""

import os
import tempfile
import warnings
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

THRESHOLDS = {  # Programs of every size and compile time are kept, unless the environment sets other thresholds.
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}


def default_folder() -> Path:
    """Return the folder of compiled programs in the user's cache directory. RuntimeError is raised without a home."""
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(caches, "pdjax", f"jax-{jax.__version__}")


def use_compilation_cache(path: str | os.PathLike | None = None) -> str | None:
    """Keep compiled programs on disk, so that later processes read them instead of compiling again.

    Call it once, before the first computation. It sets JAX's persistent compilation cache for the whole process:
    `jax_compilation_cache_dir`, and thresholds such that every program is kept. Nothing else in pdjax writes to
    `jax.config`, and importing pdjax does not call this function.

    Parameters
    ----------
    path : str or path, optional
        Folder of the compiled programs; it is made if it does not exist. By default it is the folder that JAX already
        uses (the environment variable `JAX_COMPILATION_CACHE_DIR`, or `jax.config`), and otherwise
        `pdjax/jax-<version>` in `$XDG_CACHE_HOME` or `~/.cache`.

    Returns
    -------
    str or None
        The folder in use, or None if it cannot be written. In that case a `UserWarning` says so, and every process
        compiles its programs as it would without a cache.

    Notes
    -----
    Programs that this process compiled before the call stay in memory and are not written. The key of a program
    contains the versions of JAX and XLA, the device and the compiler's flags, so a folder may be shared by several
    environments. The folder is never emptied: remove it whenever you like. JAX runs what it reads there, so use a
    folder that only you can write.

    Examples
    --------
    >>> folder = pd.use_compilation_cache()
    >>> folder == jax.config.jax_compilation_cache_dir
    True
    """
    known = jax.config.values.get("jax_compilation_cache_dir") or os.environ.get("JAX_COMPILATION_CACHE_DIR") or None
    given = path if path is not None else known
    if given is not None and "://" in os.fspath(given):  # a bucket, which JAX itself writes to
        folder = os.fspath(given)
    else:
        try:
            folder = str(_made(default_folder() if given is None else Path(given)))
        except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
            warnings.warn(_REFUSED.format(given or "the default folder", error), stacklevel=2)
            _use(None)
            return None
    _use(folder)
    for name, value in THRESHOLDS.items():
        if name.upper() not in os.environ:
            jax.config.update(name, value)
    return folder


_REFUSED = (
    "compiled programs are not kept on disk, because {} cannot be written ({}); the computation continues, and"
    " each process compiles its programs again. Name a folder that you can write: pd.use_compilation_cache(path), or"
    " the environment variable JAX_COMPILATION_CACHE_DIR"
)


def _made(folder: Path) -> Path:
    """Make the folder and return its absolute path. OSError is raised if no file can be created in it."""
    folder = folder.expanduser().absolute()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
    return folder


def _use(folder: str | None) -> None:
    """Set the folder of JAX's cache, also after JAX has used another one."""
    if folder != jax.config.values.get("jax_compilation_cache_dir"):
        compilation_cache.reset_cache()
        jax.config.update("jax_compilation_cache_dir", folder)
