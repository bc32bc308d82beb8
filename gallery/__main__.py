"""Run every case and write docs/gallery: `make gallery`. Names of cases run those alone."""

from __future__ import annotations

import sys
import time

from gallery.cases import CASES
from gallery.report import FOLDER, write_case, write_index


def main(names: list[str]) -> int:
    """Run the cases; 1 where a quantity agrees to fewer digits than required."""
    unknown = set(names) - {case.name for case in CASES}
    if unknown:
        print(f"no such case: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    results = []
    for case in CASES:
        if names and case.name not in names:
            continue
        started = time.perf_counter()
        rows = case.quantities()
        write_case(FOLDER, case, rows)
        results.append((case, rows))
        print(f"{case.name}: {len(rows)} quantities, {time.perf_counter() - started:.1f} s")
        for row in rows:
            if not row.agrees:
                print(
                    f"  {row.quantity}: {row.ours:.12g}, but {row.theirs:.12g} is known: "
                    f"{row.digits_agreed:.2f} digits of {row.digits_required:.2f}",
                    file=sys.stderr,
                )
    if not names:
        write_index(FOLDER, results)
    return int(not all(row.agrees for _, rows in results for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
