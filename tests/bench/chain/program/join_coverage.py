#!/usr/bin/env python3
"""Coverage over many benches, from the lines of several calls of chain_coverage.

chain_coverage BENCHES PLACES FRAMES SEED 2 PARTS > FILE, for other seeds each; join_coverage.py FILE...
One line for each way to locate: the part of positions within their 95 %, what was claimed (1 sigma, median / 90 %)
and what was wrong, um. Errors within a bench are common to its places, so the interval behind each coverage is a
bootstrap over benches, not over places.
"""
import collections
import math
import random
import statistics
import sys

FIELDS = ("ex", "ey", "ez", "eh", "sx", "sy", "sz", "sh", "d2", "chi2", "rx", "ry")
CHI2_95_3 = 7.815  # 95 % of chi square of three degrees of freedom
MISFIT = 10.6      # kMisfitChi2


def read(files):
    """name -> seed -> rows, each a dict of FIELDS."""
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for file in files:
        with open(file, encoding="utf-8") as lines:
            for text in lines:
                cells = text.rstrip("\n").split("\t")
                if cells[0] == "row" and len(cells) == 3 + len(FIELDS):
                    row = dict(zip(FIELDS, map(float, cells[3:])))
                    found[cells[1]][int(cells[2])].append(row)
    return found


def at_part(values, part):
    values = sorted(v for v in values if not math.isnan(v))
    return values[round(part * (len(values) - 1))] if values else math.nan


WITHIN = {
    "depth": lambda r: abs(r["ez"]) < 1.96 * r["sz"],
    "aside": lambda r: abs(r["ex"]) < 1.96 * r["sx"],
    "aside y": lambda r: abs(r["ey"]) < 1.96 * r["sy"],
    "3-D": lambda r: r["d2"] < CHI2_95_3,
    "height": lambda r: abs(r["eh"]) < 1.96 * r["sh"],
}
CLAIMED = {
    "depth": lambda r: r["sz"],
    "aside": lambda r: math.sqrt((r["sx"] ** 2 + r["sy"] ** 2) / 2),
    "height": lambda r: r["sh"],
}
WRONG = {
    "depth": lambda r: abs(r["ez"]),
    "aside": lambda r: math.hypot(r["ex"], r["ey"]) / math.sqrt(2),
    "height": lambda r: abs(r["eh"]),
    "aside relative to a look": lambda r: math.hypot(r["rx"], r["ry"]) / math.sqrt(2),
}


def bootstrap(benches, within):
    """2.5 % and 97.5 % of the coverage where benches are drawn anew, with replacement."""
    counts = [(sum(map(within, rows)), len(rows)) for rows in benches]
    draw = random.Random(1)
    parts = []
    for _ in range(1000):
        chosen = draw.choices(counts, k=len(counts))
        parts.append(sum(c for c, _ in chosen) / sum(n for _, n in chosen))
    return at_part(parts, 0.025), at_part(parts, 0.975)


def line(name, by_seed):
    benches = list(by_seed.values())
    rows = [row for bench in benches for row in bench]
    print(f"{name}: {len(benches)} benches, {len(rows)} places")
    for what, within in WITHIN.items():
        low, high = bootstrap(benches, within)
        whole = sum(all(map(within, bench)) for bench in benches)
        none = sum(not any(map(within, bench)) for bench in benches)
        print(f"  in 95 %, {what}: {100 * sum(map(within, rows)) / len(rows):.1f} % "
              f"({100 * low:.1f} to {100 * high:.1f}); benches wholly within {whole}, wholly outside {none}")
    print(f"  misfit {100 * sum(r['chi2'] > MISFIT for r in rows) / len(rows):.2f} %")
    for what, claimed in CLAIMED.items():
        values = [claimed(r) for r in rows]
        print(f"  sigma {what}: {at_part(values, 0.5):.0f} / {at_part(values, 0.9):.0f} um")
    for what, wrong in WRONG.items():
        values = [wrong(r) for r in rows]
        print(f"  error {what}: {at_part(values, 0.5):.0f} / {at_part(values, 0.9):.0f} um")
    share = [statistics.mean(r["d2"] for r in bench) for bench in benches]
    print(f"  squared distance of a place in its covariance, mean of benches {statistics.mean(share):.2f} (3), "
          f"median {statistics.median(share):.2f}")


def main(files):
    for name, by_seed in read(files).items():
        line(name, by_seed)


if __name__ == "__main__":
    main(sys.argv[1:])
