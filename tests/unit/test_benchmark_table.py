"""The table of benchmarks is made from what each of them prints."""

from tests.benchmarks import table


def test_a_peer_stands_beside_the_benchmark_that_it_is_measured_against():
    def one(name, median, **extra):
        return {"name": name, "stats": {"median": median, "min": median / 2}, "extra_info": extra}

    results = {
        "benchmarks": [
            one("test_streams[1e3-1e5]", 0.4, ms_per_stream=40.0, worst=1.5e-3),
            one("test_one_impact_ours", 0.002),
            one("test_one_impact_galpy", 0.7),
        ]
    }
    streams, ours = table.rows_of(results)
    assert streams.measured == "40.0 ms a stream, worst point 1.5e-03"
    assert streams.beside == table.PUBLISHED
    assert (ours.measured, ours.beside) == ("2 ms (best 1)", "galpy's streamgapdf: 700 ms")


def test_a_command_is_timed_in_a_process_of_its_own():
    row = table.timed("help", ("--help",), "none")
    clock, spent = (float(part.split()[0]) for part in row.measured.split(","))
    assert clock > 0
    assert spent > 0
    assert row.command == "streamdash --help"


def test_every_script_that_is_run_is_there():
    for script, *_ in table.SCRIPTS.values():
        assert (table.ROOT / "tests/benchmarks" / f"{script}.py").is_file()
