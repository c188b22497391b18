"""A Linux kernel with CAN as an ordinary program, for machines whose own kernel has none.

User-Mode Linux boots in seconds, as any user, and has the host's files for its own, so the same
environment and checkout run inside. It is not a place to measure time: one processor, and system
calls cost some 20 µs.
"""

import ast
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["run_tests", "unavailable"]

KERNEL = "linux.uml"
PROGRAMS = {
    KERNEL: "user-mode-linux",
    "insmod": "kmod",
    "ip": "iproute2",
    "candump": "can-utils",
    "taskset": "util-linux",
}
MODULES = Path("/usr/lib/uml/modules")
SEARCH = os.environ.get("PATH", "") + ":/usr/local/sbin:/usr/sbin:/sbin"
LIMIT_S = 1500  # of a boot with all its tests: a guard against a hang, not a measure
LONG_S = float(os.environ.get("F3T_LONG_S", "600"))  # what a long test adds to it


def unavailable():
    """Say which Debian packages are missing, or nothing when a guest can boot.

    Returns
    -------
    str or None
    """
    missing = [package for name, package in PROGRAMS.items() if not shutil.which(name, path=SEARCH)]
    if not missing:
        return None
    return f"no vcan0 here, nor a kernel with one: sudo apt-get install {' '.join(missing)}"


def run_tests(nodeids, root):
    """Boot, run the tests and power off.

    Parameters
    ----------
    nodeids : list of str
    root : Path
        Of the checkout, where pytest is started.

    Returns
    -------
    reports : list of dict
        pytest's own reports in their serialised form: set-up, call and tear-down of each test.
    came_up : bool
        Whether the guest reached its first process.
    console : str
        All that it printed.
    """
    with _shared_directory() as directory:
        directory.joinpath("tests").write_text("\n".join(nodeids))
        pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=0"]
        pytest += ["--basetemp", str(directory / "pytest"), f"@{directory / 'tests'}"]
        reports = directory / "reports"
        console = _run(pytest, root, directory, VCAN_REPORTS=str(reports))
        written = reports.read_text() if reports.exists() else ""
        lines = written.split("\n")[:-1]  # a last one without its end was cut short
        # Literals, and nothing else is taken for one: JSON would make lists of a report's tuples.
        return [ast.literal_eval(line) for line in lines], (directory / "up").exists(), console


@contextmanager
def _shared_directory():
    # Not where TMPDIR may point: the guest has a /run and a /dev/shm of its own.
    with tempfile.TemporaryDirectory(prefix="vcan-", dir="/var/tmp") as name:
        yield Path(name)


def _run(command, root, directory, **variables):
    job = directory / "job"
    job.write_text(_job(command, root, directory, variables))
    job.chmod(0o755)
    # Beside the job, because a checkout's path may hold a blank and the command line's may not.
    shutil.copy(Path(__file__).parent / "init", directory / "init")
    return _boot(directory)


def _job(command, root, directory, variables):
    environment = {
        "PATH": SEARCH,
        "HOME": os.environ.get("HOME", "/"),
        "LANG": "C.UTF-8",
        "TMPDIR": str(directory),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    # The host's compiled kernels serve here too: the processor is the same, and so is its name.
    passed = ("CI", "NUMBA_CACHE_DIR", "F3T_LONG_S", "UPDATE_GOLDEN")
    environment |= {name: os.environ[name] for name in passed if name in os.environ}
    settings = shlex.join(f"{name}={value}" for name, value in (environment | variables).items())
    return (
        f"#!/bin/sh\ncd {shlex.quote(str(root))} && exec env -i {settings} {shlex.join(command)}\n"
    )


def _boot(directory):
    modules = max(MODULES.glob("*/kernel"), default=MODULES)
    # On one processor: each system call of the guest is two hand-overs between processes that
    # never run at the same time, and to wake another processor takes ten times as long.
    command = ["taskset", "--cpu-list", str(max(os.sched_getaffinity(0)))]
    command += [shutil.which(KERNEL, path=SEARCH), "mem=2G", "quiet", f"uml_dir={directory}"]
    command += [
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "rw",
        f"init={directory}/init",
    ]
    command += ["con=null", "con0=fd:0,fd:1", f"VCAN_DIR={directory}", f"VCAN_MODULES={modules}"]
    # The guest's memory is a file in TMPDIR: /dev/shm, its first choice, is often too small.
    environment = os.environ | {"TMPDIR": str(directory)} | _preload(directory)
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        start_new_session=True,
    ) as process:
        try:
            console, _ = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired as late:
            console = (late.output or b"") + f"\nended after {LIMIT_S} s".encode()
        finally:  # its helper processes do not end by themselves when it is cut short
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return console.decode(errors="replace")


def _preload(directory):
    """What the guest's kernel needs on a processor with AMX: see registers.c."""
    compiler, library = shutil.which("cc", path=SEARCH), directory / "registers.so"
    if not compiler or "amx_tile" not in Path("/proc/cpuinfo").read_text():
        return {}
    source = Path(__file__).parent / "registers.c"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return {"LD_PRELOAD": str(library)}
