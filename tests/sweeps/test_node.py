"""One worker of each machine compiles the code."""

import threading
import time

from gym_passive_walker.apps.sweeps import node


def test_of_workers_that_start_together_one_compiles_and_the_others_wait(tmp_path, monkeypatch):
    began, ended = [], []

    def slow():
        began.append(time.monotonic())
        time.sleep(0.2)
        ended.append(time.monotonic())

    monkeypatch.setattr(node, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(node, "pieces", lambda _: [slow])
    returned = []

    def worker():
        node.compile_once()
        returned.append(time.monotonic())

    threads = [threading.Thread(target=worker) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(began) == 1 and min(returned) >= ended[0]


def test_one_that_is_killed_while_it_compiles_leaves_it_to_the_next(tmp_path, monkeypatch):
    done = []

    def killed():
        raise SystemExit

    monkeypatch.setattr(node, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(node, "pieces", lambda _: [killed])
    try:
        node.compile_once()
    except SystemExit:
        pass
    monkeypatch.setattr(node, "pieces", lambda _: [lambda: done.append(1)])
    node.compile_once()
    node.compile_once()
    assert done == [1]
