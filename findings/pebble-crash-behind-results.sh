#!/usr/bin/env bash
# pebble 5.2.3: after a task that ends its process, futures of other tasks fail or never end, if the
# parent has not read all results yet. `PoolManager.find_expired_task` looks the task up by an
# acknowledgement, which waits in the same pipe behind these results.
# Seen, of 6,000 tasks of which each 200th kills its process, with one worker and a parent that
# takes 0.3 ms for each result: {'others: NoneType': 5968, 'crashes: ProcessExpired': 26,
# 'others: ProcessExpired': 2, 'never ended': 4}. Numbers vary; with a slower parent, the pool breaks:
# BrokenProcessPool for hundreds of others. A crash alone is reported as documented.
# Fails if that has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pebble==5.2.3
cat > "$folder/crash.py" <<'PYTHON'
import collections
import multiprocessing
import os
import queue

import pebble


def task(number):
    if number % 200 == 199:
        os.kill(os.getpid(), 9)
    return number


if __name__ == "__main__":
    ended, seen = queue.SimpleQueue(), collections.Counter()
    context = multiprocessing.get_context("spawn")
    with pebble.ProcessPool(1, context=context) as pool:
        for number in range(6000):
            future = pool.schedule(task, args=(number,), timeout=30.0)
            future.add_done_callback(lambda future, number=number: ended.put((number, future)))
        for pending in range(6000, 0, -1):
            try:
                number, future = ended.get(timeout=10.0)
            except queue.Empty:
                seen["never ended"] = pending
                break
            error = future.exception()
            seen[f"{'crashes' if number % 200 == 199 else 'others'}: {type(error).__name__}"] += 1
            sum(range(20_000))  # work of the parent
        pool.stop()
    print(dict(seen))
    wrong = sum(count for name, count in seen.items()
                if name not in ("crashes: ProcessExpired", "others: NoneType"))
    assert wrong, "only the tasks that crash fail now"
PYTHON
"$folder/venv/bin/python" "$folder/crash.py"
