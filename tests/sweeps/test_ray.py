"""On a Ray cluster a sweep finds the same, whatever becomes of workers, machines and the head."""

import threading
import time

import pytest

import gym_passive_walker as gpw
from tests.sweeps.same import same

pytest.importorskip("ray")
pytest.importorskip("pyarrow")
cluster_utils = pytest.importorskip("ray.cluster_utils")

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # Ray's own


@pytest.fixture
def cluster(odd):
    """A head and another machine, with a processor each, both on this machine."""
    head = {"num_cpus": 1, "include_dashboard": False}
    found = cluster_utils.Cluster(initialize_head=True, head_node_args=head)
    found.other = found.add_node(num_cpus=1)
    yield found
    found.shutdown()


def test_it_finds_the_same_as_processes_do(odd, cluster):
    over = {"x": list(range(200))}
    here = gpw.sweep("odd_tasks:square", odd / "here", over=over, workers=2)
    same(here, gpw.sweep("odd_tasks:square", odd / "there", over=over, ray=cluster.address))


def test_a_worker_that_is_killed_leaves_its_tasks_to_the_others(odd, cluster):
    over, given = {"x": list(range(40))}, {"folder": str(odd)}
    options = {"over": over, "given": given}
    killed = gpw.sweep("odd_tasks:orphans", odd / "out", ray=cluster.address, **options)
    assert (odd / "told").exists() and killed.failures == 0
    same(killed, gpw.sweep("odd_tasks:orphans", odd / "whole", workers=1, **options))


def test_a_machine_that_is_lost_leaves_its_tasks_to_the_others(odd, cluster):
    over, given = {"x": list(range(300))}, {"folder": str(odd)}

    def lose():
        while not (odd / "noted").exists() or (odd / "noted").read_text().count("\n") < 20:
            time.sleep(0.01)
        cluster.remove_node(cluster.other)

    losing = threading.Thread(target=lose)
    losing.start()
    found = gpw.sweep("odd_tasks:noted", odd / "out", over=over, given=given, ray=cluster.address)
    losing.join()
    assert found.failures == 0
    assert found.columns()["square"].tolist() == [x * x for x in range(300)]
