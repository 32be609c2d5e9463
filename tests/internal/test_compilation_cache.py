"""Tests of compiled programs kept on disk: the folder, when it is used, and a folder that cannot be written.

The cache belongs to the whole process, so each test starts new processes.
"""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

COUNT = """
import collections, jax, jax.monitoring
seen = collections.Counter()
jax.monitoring.register_event_listener(lambda name, **_: seen.update([name.rsplit("/", 1)[-1]]))
import numpy as np, pdjax as pd
"""
WORK = "np.testing.assert_allclose(jax.jit(lambda x: x * x + {0})(np.arange(3.0)), np.arange(3.0) ** 2 + {0})\n"


def process(code, home, **settings):
    """(lines printed, text on the error stream) of a new process with this home folder and environment."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_COMPILATION", "JAX_PERSISTENT", "XDG_CACHE"))}
    env |= {"HOME": str(home), "JAX_PLATFORMS": "cpu", **settings}
    done = subprocess.run([sys.executable, "-c", COUNT + code], env=env, capture_output=True, text=True, cwd=home)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), done.stderr


def test_importing_changes_no_setting_of_jax(tmp_path):
    names = "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs", "jax_enable_x64"
    code = f"print(*(getattr(jax.config, name) for name in {names}))"
    assert process(code, tmp_path)[0] == ["None 1.0 False"]
    assert list(tmp_path.iterdir()) == []


def test_a_second_process_reads_what_the_first_has_compiled(tmp_path):
    code = "print(pd.use_compilation_cache())\n" + WORK.format(1)
    code += "print(seen['cache_hits'], seen['cache_misses'])"
    (folder, first), said = process(code, tmp_path)
    assert folder == str(tmp_path / ".cache" / "pdjax" / f"jax-{jax.__version__}")
    hits, misses = map(int, first.split())
    assert hits == 0 and misses >= 1 and len(list(Path(folder).glob("*-cache"))) == misses and said == ""
    again, said = process(code, tmp_path)
    assert again == [folder, f"{misses} 0"]
    assert said == ""  # in particular no warnings of XLA about the machine that compiled it


def test_the_folder_may_be_named_after_jax_has_compiled(tmp_path):
    """Programs compiled after the call are kept in the folder that was named last."""
    code = WORK.format(1) + "print(pd.use_compilation_cache('one'))\n" + WORK.format(2)
    code += "print(pd.use_compilation_cache('two'))\n" + WORK.format(3)
    said, _ = process(code, tmp_path)
    assert said == [str(tmp_path / "one"), str(tmp_path / "two")]
    kept = [{p.name for p in (tmp_path / name).glob("jit__lambda*-cache")} for name in ("one", "two")]
    assert [len(names) for names in kept] == [1, 1] and kept[0] != kept[1]


@pytest.mark.parametrize("given", ["", "'mine'"])
def test_the_environment_names_the_folder_if_the_argument_does_not(given, tmp_path):
    settings = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "theirs"), "XDG_CACHE_HOME": str(tmp_path / "xdg")}
    settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "7.5"
    code = f"print(pd.use_compilation_cache({given}))\n"
    code += "print(jax.config.jax_persistent_cache_min_compile_time_secs)"
    expected = tmp_path / ("mine" if given else "theirs")
    assert process(code, tmp_path, **settings)[0] == [str(expected), "7.5"]
    assert [p.name for p in tmp_path.iterdir()] == [expected.name]
    del settings["JAX_COMPILATION_CACHE_DIR"]
    folder = tmp_path / ("mine" if given else f"xdg/pdjax/jax-{jax.__version__}")
    assert process(code, tmp_path, **settings)[0][0] == str(folder)


@pytest.mark.parametrize("way", ["argument", "environment", "default"])
def test_a_folder_that_cannot_be_written_gives_one_warning_and_the_computation_continues(way, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("a file, no folder")
    settings = {"environment": {"JAX_COMPILATION_CACHE_DIR": str(taken)}, "default": {"XDG_CACHE_HOME": str(taken)}}
    call = f"pd.use_compilation_cache({str(taken) if way == 'argument' else None!r})"
    code = f"for _ in range(3):\n    folder = {call}\nprint(folder)\n" + WORK.format(1) + WORK.format(2)
    printed, said = process(code, tmp_path, **settings.get(way, {}))
    assert printed == ["None"]
    assert said.count("UserWarning") == 1 and "compiled programs are not kept on disk, because" in said
    assert str(taken) in said and "pd.use_compilation_cache(path)" in said
    assert taken.read_text() == "a file, no folder"


def test_the_command_line_keeps_compiled_programs_or_says_in_one_line_why_it_cannot(tmp_path):
    code = "import sys; from pdjax.cli import main\nsys.argv = 'pdjax bench --list'.split()\n"
    code += "print(main(), jax.config.jax_compilation_cache_dir)"
    printed, said = process(code, tmp_path)
    assert printed[-1] == f"0 {tmp_path}/.cache/pdjax/jax-{jax.__version__}" and said == ""
    (tmp_path / "taken").write_text("")
    printed, said = process(code, tmp_path, XDG_CACHE_HOME=str(tmp_path / "taken"))
    assert printed[-1] == "0 None"
    assert said.startswith("pdjax: compiled programs are not kept on disk") and said.count("\n") == 1
