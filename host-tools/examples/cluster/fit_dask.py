#!/usr/bin/env python3
"""A fit on the workers of a Dask cluster: they compute the shards, and one process merges them.

    fit_dask.py RECORDINGS --parts DIR --out LIB [--shards N] [--workers N | --scheduler ADDRESS] [-- OPTION...]

Each shard is one call of `stylus fit --shard`, and each OPTION one of `stylus fit`. RECORDINGS and DIR must be seen by
all workers under the same path. Needs Python 3.10 and `pip install "dask[distributed]"`.
"""

import argparse
import os
import subprocess
import sys


def run(command, threads):
    """Runs `command` and returns its output; raises RuntimeError with its last line if it fails."""
    environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"ended with {done.returncode}, and said nothing"]
        raise RuntimeError(f"{' '.join(command)}: {lines[-1]}")
    return done.stdout.strip()


def arguments():
    """Returns the parsed command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", help="folder with trials.csv, or such a list")
    parser.add_argument("--parts", required=True, metavar="DIR", help="folder of the shards' partial results")
    parser.add_argument("--out", required=True, metavar="LIB", help="library to write; with --each their folder")
    parser.add_argument("--shards", type=int, metavar="N", help="number of shards [default: four per worker]")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="workers on this machine [default: 2]")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a running scheduler, such as tcp://host:8786")
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="threads of a worker's call [default: 1]")
    parser.add_argument("--stylus", default="stylus", metavar="PROGRAM", help="the program, as workers find it")
    # What follows -- is not this program's, also where it looks like an option of it.
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    given = parser.parse_args(words[:end])
    given.options = words[end + 1 :]
    return given


def main():
    """Maps the shards on the cluster and merges them; returns the exit code."""
    # After the command line, because it takes a second.
    from dask.distributed import Client, LocalCluster, as_completed

    given = arguments()
    fit = [given.stylus, "fit", given.recordings, "--parts", given.parts, *given.options]
    if given.scheduler:
        cluster = None
        client = Client(given.scheduler)
    else:
        cluster = LocalCluster(n_workers=given.workers, threads_per_worker=1, dashboard_address=None)
        client = Client(cluster)
    try:
        workers = len(client.scheduler_info(n_workers=-1)["workers"])
        shards = given.shards or 4 * max(workers, 1)
        print(f"{shards} shards on {workers} workers", flush=True)
        # Not pure: a shard that is asked for again is computed again, or found in the folder by the command.
        futures = [
            client.submit(run, [*fit, "--shard", f"{number}/{shards}"], given.threads, pure=False)
            for number in range(1, shards + 1)
        ]
        for _, output in as_completed(futures, with_results=True):
            print(output, flush=True)
        print(run([*fit, "--merge", "--out", given.out], os.cpu_count()), flush=True)
    except (RuntimeError, OSError) as failure:
        print(f"fit_dask.py: {failure}", file=sys.stderr)
        return 1
    finally:
        client.close()
        if cluster is not None:
            cluster.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
