"""How peers are timed."""

import statistics
import time


def median(work, repeats, rounds=9):
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(repeats):
            work()
        times.append((time.perf_counter() - start) / repeats)
    return statistics.median(times)
