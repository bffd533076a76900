"""Background jobs: one per configuration, watched through the cache, cancelled, resumed, limited."""

from __future__ import annotations

import time

import pytest

from streamdash.config import ConfigError, EnsembleConfig, Perturbers, StreamModel
from streamdash.simulation.ensemble import background, simulate
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.jobs import Jobs, Limits, Refused
from streamdash.simulation.status import Pace
from streamdash.store.cache import Cache
from tests.waiting import PATIENCE_S, wait_until


@pytest.fixture(scope="module")
def config() -> EnsembleConfig:
    return EnsembleConfig(perturbers=Perturbers(mass_range="1e5-1e7"), n_streams=130, n_theta=40)


@pytest.fixture
def start(geometry_cache):
    """Make the queue of a server on the test's cache; it is closed afterwards."""
    queues = []

    def make(cache: Cache | None = None, **limits) -> Jobs:
        queues.append(Jobs(cache or geometry_cache, Limits(workers=2, **{"nice": 0, **limits})))
        return queues[-1]

    yield make
    for jobs in queues:
        jobs.close()


def test_a_job_is_seen_from_none_to_all_and_gives_the_ensemble(config, start, geometry_cache, tmp_path, toy):
    jobs = start()
    key = jobs.submit(config, "me", "tiny masses")
    seen = []
    while (status := jobs.find(key)).active:
        seen.append((status.state, status.done))
        time.sleep(0.01)
    assert (status.state, status.done, status.error) == ("done", 130, "")
    assert status.took_s > 0
    assert seen[0] in (("waiting", 0), ("running", 0))
    assert [done for _, done in seen] == sorted(done for _, done in seen)
    entry = geometry_cache.covering(config)
    assert (entry.key, entry.title) == (key, "tiny masses")
    inline = Cache.default(tmp_path / "inline")
    inline.save_geometry(config.stream, geometry_cache.open_geometry(config.stream))
    simulate(config, "inline", cache=inline)
    assert toy.data_bytes(entry.path) == toy.data_bytes(inline.find(key).path)


def test_what_is_there_already_is_no_job(config, start, geometry_cache):
    simulate(config, "inline", cache=geometry_cache)
    jobs = start(max_jobs=0)
    fewer = config.model_copy(update={"n_streams": 20})
    assert jobs.submit(config) == config.key
    assert jobs.submit(fewer) == fewer.key
    assert jobs.statuses == ()


def test_two_who_ask_for_the_same_share_a_job_that_stops_when_both_have_left(config, start, geometry_cache):
    jobs = start()
    many = config.model_copy(update={"n_streams": 5000})
    key = jobs.submit(many, "a")
    assert jobs.submit(many, "b") == key
    wait_until(lambda: jobs.find(key).done > 0)
    assert jobs.find(key).owners == {"a", "b"}
    assert len(jobs.statuses) == 1
    jobs.cancel(key, "somebody else")
    jobs.cancel(key, "a")
    assert jobs.find(key).state == "running"
    jobs.cancel(key, "b")
    status = jobs.wait(key, PATIENCE_S)
    assert status.state == "cancelled"
    assert 0 < status.done < 5000
    assert geometry_cache.streams_done(many) == status.done


def test_a_cancelled_job_resumes_where_it_stopped(config, start, geometry_cache):
    jobs = start()
    many = config.model_copy(update={"n_streams": 400, "seed": 3})
    key = jobs.submit(many, "a")
    wait_until(lambda: jobs.find(key).done > 0)
    jobs.cancel(key, "a")
    kept = jobs.wait(key, PATIENCE_S).done
    assert 0 < kept < 400
    assert jobs.submit(many, "a") == key
    assert jobs.find(key).done == kept
    assert jobs.wait(key, PATIENCE_S).state == "done"
    assert geometry_cache.verify(geometry_cache.find(key)) == []


def test_a_job_whose_owner_has_gone_goes_on_and_may_be_cancelled_by_anybody(config, start):
    jobs = start()
    key = jobs.submit(config.model_copy(update={"n_streams": 5000}), "gone")
    jobs.leave("gone")
    assert jobs.find(key).active
    jobs.cancel(key, "anybody")
    assert jobs.wait(key, PATIENCE_S).state == "cancelled"


def test_jobs_wait_for_their_turn_and_a_waiting_one_is_cancelled_at_once(config, start):
    jobs = start()
    first, second = (config.model_copy(update={"n_streams": 2000, "seed": seed}) for seed in (5, 6))
    jobs.submit(first, "a")
    key = jobs.submit(second, "b")
    wait_until(lambda: jobs.find(first.key).state == "running")
    assert jobs.find(key).state == "waiting"
    jobs.cancel(key, "b")
    assert jobs.find(key).state == "cancelled"
    jobs.cancel(first.key, "a")
    assert jobs.wait(first.key, PATIENCE_S).state == "cancelled"


def test_what_another_process_computes_is_watched_and_does_not_hold_up_others(config, start, geometry_cache):
    jobs = start()
    theirs = config.model_copy(update={"n_streams": 100, "seed": 8})
    geometry = load_geometry(config.stream, geometry_cache)
    with geometry_cache.begin(theirs, background(geometry, theirs)):
        key = jobs.submit(theirs, "me")
        other = jobs.submit(config, "me")
        assert jobs.wait(other, PATIENCE_S).state == "done"
        assert jobs.find(key).state == "elsewhere"
    assert jobs.wait(key, PATIENCE_S).state == "done"  # the other process gave it up


def test_a_model_that_galpy_cannot_build_fails_in_a_sentence(start):
    jobs = start()
    unbound = StreamModel(n_times=1, progenitor=(1.5, 0.3, 9.0, 0.9, -0.5, 0.1))
    key = jobs.submit(EnsembleConfig(stream=unbound, n_streams=1), "me")
    status = jobs.wait(key, PATIENCE_S)
    assert status.state == "failed"
    assert "progenitor: it is not bound to the Galaxy" in status.error


# ------------------------------------------------------------------ limits


@pytest.mark.parametrize(
    ("limits", "changes", "words"),
    [
        ({"max_streams": 100}, {}, "130 streams are more than the 100"),
        ({"max_disk_gb": 1e-6}, {}, "more than the 1e-06 GB"),
        ({"max_impacts": 1000}, {}, "130 streams with 57 impacts each are more than the 1e\\+03"),
        ({"max_jobs": 0}, {}, "runs or queues 0 simulations at most"),
        ({"max_jobs_per_session": 0}, {}, "0 simulations of yours"),
    ],
)
def test_beyond_its_limits_a_server_refuses_in_a_sentence(config, start, limits, changes, words):
    with pytest.raises(Refused, match=words) as refused:
        start(**limits).submit(config, "me")
    assert str(refused.value).count(". ") == 0


def test_a_session_may_have_only_so_many_jobs(config, start):
    jobs = start(max_jobs_per_session=2)
    several = [config.model_copy(update={"n_streams": 3000, "seed": seed}) for seed in range(10, 13)]
    for one in several[:2]:
        jobs.submit(one, "greedy")
    with pytest.raises(Refused, match="2 simulations of yours are running or waiting"):
        jobs.submit(several[2], "greedy")
    jobs.submit(several[2], "another")
    jobs.submit(several[0], "greedy")  # the same once more is no more


def test_a_network_address_may_have_only_so_many_jobs_however_many_its_sessions(config, start):
    jobs = start(max_jobs_per_address=2)
    several = [config.model_copy(update={"n_streams": 3000, "seed": seed}) for seed in range(20, 24)]
    jobs.submit(several[0], "one", place="192.0.2.1")
    jobs.submit(several[1], "two", place="192.0.2.1")
    with pytest.raises(Refused, match="2 simulations from your network address are running or waiting"):
        jobs.submit(several[2], "three", place="192.0.2.1")
    jobs.submit(several[2], "three", place="192.0.2.2")
    jobs.submit(several[3], "four")  # where no address is known, sessions alone are counted


def test_addresses_take_turns_however_many_jobs_one_has_queued(config, start, monkeypatch):
    monkeypatch.setattr("streamdash.simulation.jobs.TURN_S", 4.0)
    jobs = start()
    several = [config.model_copy(update={"n_streams": 9000, "seed": seed}) for seed in range(30, 33)]
    greedy = [jobs.submit(one, "greedy", place="192.0.2.1") for one in several[:2]]
    wait_until(lambda: jobs.find(greedy[0]).done > 0)
    modest = jobs.submit(several[2], "modest", place="192.0.2.2")
    wait_until(lambda: jobs.find(modest).done > 0)
    assert jobs.find(greedy[1]).done == 0


def test_a_job_that_takes_too_long_ends_in_a_sentence_and_keeps_what_is_finished(config, start):
    jobs = start(max_job_minutes=1e-3)
    many = config.model_copy(update={"n_streams": 20_000, "seed": 40})
    status = jobs.wait(jobs.submit(many, "me"), PATIENCE_S)
    assert status.state == "failed"
    assert "longer than the 0.001 minutes" in status.error
    assert status.done < 20_000


def test_a_name_that_cannot_be_used_is_refused(config, start):
    with pytest.raises(Refused, match="The name cannot be used: a name may hold"):
        start().submit(config, "me", "two\nlines")


def test_limits_come_from_the_environment(monkeypatch):
    default = Limits()
    monkeypatch.setenv("STREAMDASH_MAX_STREAMS", " 500 ")
    monkeypatch.setenv("STREAMDASH_WORKERS", "")
    assert Limits() == default.model_copy(update={"max_streams": 500})
    assert Limits(max_streams=7).max_streams == 7
    assert Limits(scheduler="tcp://somewhere:1").executor == "dask"
    for name, text in (("MAX_STREAMS", "many"), ("WORKERS", "0"), ("MAX_DISK_GB", "nan"), ("NICE", "-5")):
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv(f"STREAMDASH_{name}", text)
            with pytest.raises(ConfigError, match=f"^STREAMDASH_{name}: .*got '{text}'"):
                Limits()


def test_the_pace_leaves_out_how_long_workers_take_to_start():
    pace = Pace()
    for now, count in ((0, 100), (30, 150), (30.1, 200)):
        pace.note(now, count)
    assert (pace.per_second, pace.left(31, 300)) == (0, None)
    pace.note(31, 250)
    assert pace.per_second == pytest.approx(100)
    assert pace.left(31.2, 300) == pytest.approx(0.3)
    assert pace.left(60, 300) == 0
