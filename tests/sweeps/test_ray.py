"""A sweep on a Ray cluster has the same results, also if workers, machines or the head are lost."""

import subprocess
import sys
import threading
import time

import pytest

from gym_passive_walker.apps.sweeps.run import SweepResult
from tests.sweeps.odd import odd_sweep, same

pytest.importorskip("ray")
parquet = pytest.importorskip("pyarrow.parquet")
cluster_utils = pytest.importorskip("ray.cluster_utils")

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # Ray's own


@pytest.fixture
def cluster(odd):
    """A head and another machine with one CPU each, both on this machine."""
    head = {"num_cpus": 1, "include_dashboard": False}
    found = cluster_utils.Cluster(initialize_head=True, head_node_args=head)
    found.other = found.add_node(num_cpus=1)
    yield found
    found.shutdown()


def line(odd, count, address):
    """A command that sweeps on a cluster, in its own process."""
    script, options = odd / "script.py", {"over": {"x": list(range(count))}, "ray": address}
    options["given"] = {"folder": str(odd)}
    script.write_text(
        "import gym_passive_walker as gpw\n"
        "if __name__ == '__main__':\n"
        f"    gpw.sweep('odd_tasks:noted', {str(odd / 'out')!r}, trust=True, **{options!r})\n"
    )
    return [sys.executable, "-W", "ignore", str(script)]


def test_it_finds_the_same_as_processes_do(odd, cluster):
    here = odd_sweep("square", odd / "here", 200, workers=2)
    same(here, odd_sweep("square", odd / "there", 200, workers=None, ray=cluster.address))


def test_a_worker_that_is_killed_leaves_its_tasks_to_the_others(odd, cluster):
    given, on_ray = {"folder": str(odd)}, {"workers": None, "ray": cluster.address}
    killed = odd_sweep("orphans", odd / "out", 40, given=given, **on_ray)
    assert (odd / "reported").exists() and killed.failures == 0
    same(killed, odd_sweep("orphans", odd / "whole", 40, given=given))


def test_a_machine_that_is_lost_leaves_its_tasks_to_the_others(odd, cluster):
    def lose():
        while not (odd / "noted").exists() or (odd / "noted").read_text().count("\n") < 20:
            time.sleep(0.01)
        cluster.remove_node(cluster.other)

    losing = threading.Thread(target=lose)
    losing.start()
    on_ray = {"workers": None, "ray": cluster.address}
    found = odd_sweep("noted", odd / "out", 300, given={"folder": str(odd)}, **on_ray)
    losing.join()
    assert found.failures == 0
    assert found.columns()["square"].tolist() == [x * x for x in range(300)]


def test_a_machine_that_joins_takes_its_share(odd, cluster):
    cluster.remove_node(cluster.other)
    process = subprocess.Popen(line(odd, 2500, cluster.address))
    while not (odd / "noted").exists():
        assert process.poll() is None
        time.sleep(0.01)
    cluster.add_node(num_cpus=1)
    assert process.wait(timeout=300) == 0
    workers = {each.split()[1] for each in (odd / "noted").read_text().splitlines()}
    assert len(workers) == 2 and len(SweepResult(odd / "out", 2500, 0).columns()["x"]) == 2500


def test_a_machine_of_another_version_is_refused(odd, cluster, monkeypatch):
    elsewhere = odd / "elsewhere"
    elsewhere.mkdir()
    text = (odd / "odd_tasks.py").read_text()
    (elsewhere / "odd_tasks.py").write_text(text.replace("x * x", "x * x + 1"))
    cluster.remove_node(cluster.other)
    monkeypatch.setenv("PYTHONPATH", str(elsewhere), prepend=":")
    cluster.add_node(num_cpus=1)
    said = r"of the cluster has version .* install that version there"
    with pytest.raises(ValueError, match=said):
        odd_sweep("noted", odd / "out", 500, given={"folder": str(odd)}, workers=None,
                  ray=cluster.address)  # fmt: skip


def test_a_sweep_that_loses_its_head_goes_on_with_the_next(odd):
    head = {"num_cpus": 2, "include_dashboard": False}
    first = cluster_utils.Cluster(initialize_head=True, head_node_args=head)
    process = subprocess.Popen(line(odd, 400, first.address))
    journal = odd / "out" / "journal.jsonl"
    while not (journal.exists() and journal.read_text().count("\n") >= 30):
        assert process.poll() is None
        time.sleep(0.01)
    first.shutdown()
    assert process.wait(timeout=300) != 0
    kept = len(journal.read_text().splitlines())
    kept += sum(parquet.read_metadata(path).num_rows for path in (odd / "out/rows").iterdir())
    done = (odd / "noted").read_text().count("\n")
    second = cluster_utils.Cluster(initialize_head=True, head_node_args=head)
    try:
        subprocess.run(line(odd, 400, second.address), check=True, timeout=300)
    finally:
        second.shutdown()
    again = (odd / "noted").read_text().count("\n") - done
    assert 30 <= kept < 400 and again == 400 - kept  # nothing that was kept is done again
    whole = odd_sweep("noted", odd / "whole", 400, given={"folder": str(odd)})
    same(SweepResult(odd / "out", 400, 0), whole)
