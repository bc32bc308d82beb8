"""Run every case and card, and write docs/gallery and docs/cards: `make gallery`.

Names of cases or cards run those alone. A page of cases is written if all of its cases run.
"""

from __future__ import annotations

import sys
import time

from gallery import moving
from gallery.cases import PAGES
from gallery.report import FOLDER, picture, write_index, write_page


def main(names: list[str]) -> int:
    """Run cases and cards; 1 where a quantity agrees to fewer digits than required."""
    cases = [case for page in PAGES for case in page.cases]
    unknown = set(names) - {case.name for case in cases} - set(moving.NAMES)
    if unknown:
        print(f"no such case or card: {', '.join(sorted(unknown))}", file=sys.stderr)
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
    chosen = sys.argv[1:]
    status = main(chosen)
    if status == 0 and (not chosen or set(chosen) & set(moving.NAMES)):
        moving.write(chosen)
    sys.exit(status)
