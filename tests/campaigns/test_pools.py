"""What the pool of local processes makes of a worker that is late."""

from collections import deque

from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.pools import LocalPool


class Late:
    """A worker whose run began long ago; it may have finished since."""

    def __init__(self, *, finished):
        self.ready, self.row, self.pipe, self._finished, self.stopped = True, 0, self, finished, False

    def poll(self):
        return self._finished

    def receive(self):
        return "row", {"row": 0, "status": "ok"}

    def overdue(self, limit):
        return limit is not None

    def stop(self):
        self.stopped = True


def heard(path, worker):
    pool = LocalPool(load_campaign(path), None, workers=1)
    pool._workers.append(worker)
    return pool._receive(worker, deque(), {0: 0})


def test_a_run_that_is_over_counts_though_it_is_heard_after_the_limit(write):
    worker = Late(finished=True)
    assert heard(write(runs=1, more="time_limit_s: 5"), worker) == {"row": 0, "status": "ok"}
    assert not worker.stopped and worker.row is None


def test_a_run_that_is_not_over_at_the_limit_has_failed(write):
    worker = Late(finished=False)
    row = heard(write(runs=1, more="time_limit_s: 5"), worker)
    assert row["status"] == "failed" and row["error"] == "took longer than time_limit_s = 5"
    assert worker.stopped
