"""Run every case and write docs/gallery: `make gallery`. Names of cases run those alone.

A page is written if all of its cases run.
"""

from __future__ import annotations

import sys
import time

from gallery.cases import PAGES
from gallery.report import FOLDER, picture, write_index, write_page


def main(names: list[str]) -> int:
    """Run the cases; 1 where a quantity agrees to fewer digits than required."""
    cases = [case for page in PAGES for case in page.cases]
    unknown = set(names) - {case.name for case in cases}
    if unknown:
        print(f"no such case: {', '.join(sorted(unknown))}", file=sys.stderr)
        return 2
    results = []
    for case in cases:
        if names and case.name not in names:
            continue
        started = time.perf_counter()
        rows = case.quantities()
        FOLDER.mkdir(parents=True, exist_ok=True)
        picture(case, FOLDER / f"{case.name}.png")
        results.append((case, rows))
        print(f"{case.name}: {len(rows)} quantities, {time.perf_counter() - started:.1f} s")
        for row in rows:
            if not row.agrees:
                print(
                    f"  {row.quantity}: {row.ours:.12g}, but {row.theirs:.12g} is known: "
                    f"{row.digits_agreed:.2f} digits of {row.digits_required:.2f}",
                    file=sys.stderr,
                )
    ran = {case.name for case, _ in results}
    for page in PAGES:
        if {case.name for case in page.cases} <= ran:
            write_page(FOLDER, page, results)
    if not names:
        write_index(FOLDER, PAGES, results)
    return int(not all(row.agrees for _, rows in results for row in rows))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
