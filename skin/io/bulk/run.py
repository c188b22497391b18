"""A job on one machine: logs in parallel processes, retried where a process dies."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any

from bus.processors import processors
from skin.errors import check_number
from skin.io.bulk.decode_part import decode_part
from skin.io.bulk.job import Job, Part, parts_of
from skin.io.bulk.manifest import load_manifest
from skin.io.bulk.parent_watch import hold
from skin.io.bulk.progress import OnProgress, Progress

__all__ = ["TRIES", "report_of", "run", "run_parts"]

TRIES = 3
"""Attempts at a log whose process dies."""
LOOK_S = 0.5
"""Interval of progress reports."""
MOST_JOBS = 256


def run(
    job: Job, logs: Iterable[Path], *, jobs: int = 1, on_progress: OnProgress | None = None
) -> dict[str, Any]:
    """Decode logs.

    Processes are spawned, not forked, so that they inherit no thread or lock: a script that calls
    this with more than one job does so under ``if __name__ == "__main__"``.

    Parameters
    ----------
    job : Job
    logs : iterable of Path
    jobs : int
        Processes; each takes a log at a time, and has threads where there are two processors for
        each.
    on_progress : callable, optional
        Called at intervals with a `skin.io.bulk.progress.ProgressReport`.

    Returns
    -------
    dict
        A summary: totals, and the results of each log.
    """
    check_number("jobs", jobs, 1, MOST_JOBS, whole=True)
    begun, parts = time.monotonic(), parts_of(logs)
    progress = Progress(job, parts, on_progress)
    done = run_parts(job, parts, min(jobs, len(parts)), progress)
    return report_of(parts, done, time.monotonic() - begun)


def run_parts(
    job: Job, parts: list[Part], jobs: int, progress: Progress
) -> dict[str, dict[str, Any]]:
    """Summaries of all parts, by key."""
    if jobs == 1:
        done = {}
        for part in parts:
            with progress.watching():
                done[part.key] = decode_part(job, part)
            progress.ended(part)
        return done
    return dict(_in_processes(job, parts, jobs, progress))


def _in_processes(
    job: Job, parts: list[Part], jobs: int, progress: Progress
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Summaries as they come; the largest logs start first, to shorten the job."""
    left = sorted(parts, key=lambda part: part.size)
    decode = partial(decode_part, threads=processors() >= 2 * jobs)
    tries = dict.fromkeys(left, 0)
    context = multiprocessing.get_context("spawn")
    while left:
        held, watch = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(jobs, context, initializer=hold, initargs=(held,))
        running: dict[Future[dict[str, Any]], Part] = {}
        try:
            while left or running:
                while left and len(running) < jobs:
                    running[pool.submit(decode, job, left[-1])] = left[-1]
                    left.pop()
                ended, _ = wait(running, LOOK_S, FIRST_COMPLETED)
                for future in ended:
                    summary = future.result()
                    part = running.pop(future)
                    progress.ended(part)
                    yield part.key, summary
                progress.look()
        except BrokenProcessPool:
            for part in running.values():
                tries[part] += 1
                if tries[part] < TRIES:
                    left.append(part)
                else:
                    progress.ended(part)
                    yield part.key, _given_up(job, part)
        finally:
            if running:  # this process is being ended
                watch.close()
            pool.shutdown(cancel_futures=True)
            watch.close()
            held.close()


def _given_up(job: Job, part: Part) -> dict[str, Any]:
    """The summary of a log whose processes die."""
    found = (load_manifest(job, part) or {}).get("summary", {})
    return found | {
        "log": str(part.log), "key": part.key, "state": "failed",
        "error": f"{part.log}: must be decoded by a process that lives; got {TRIES} that died "
        "(out of memory, or killed)",
    }  # fmt: skip


def report_of(parts: list[Part], done: dict[str, dict[str, Any]], wall_s: float) -> dict[str, Any]:
    """The summary of a job from those of its logs."""
    logs = [done[part.key] for part in parts]
    decoded = [one for one in logs if one["state"] == "decoded"]
    frames = sum(one["frames"] for one in decoded)
    wrong = []
    for one in logs:
        wrong += [one["error"]] if one["error"] else []
        wrong += [one["damage"]] if one.get("damage") else []
        wrong += one.get("faults", [])
    return {
        "logs": logs,
        "decoded": len(decoded),
        "unchanged": sum(one["state"] == "unchanged" for one in logs),
        "failed": sum(one["state"] == "failed" for one in logs),
        "cycles": sum(one.get("cycles", 0) for one in logs),
        "frames": sum(one.get("frames", 0) for one in logs),
        "contacts": sum(one.get("contacts", 0) for one in logs),
        "slips": sum(one.get("slips", 0) for one in logs),
        "frames_per_s": frames / max(wall_s, 1e-9),
        "wall_s": wall_s,
        "faults": wrong,
    }
