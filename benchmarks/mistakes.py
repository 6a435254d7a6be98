"""Mistakes made in recordings with truth, and whether `inspect` names them: a table of mistake x
recording, and alarms on sound ones."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from recordings import recordings

from steelyard.experiment.read import read_experiment
from steelyard.inspection.agreements.excerpt import excerpts
from steelyard.inspection.mistakes.search import Mistake as Found
from steelyard.inspection.mistakes.search import mistakes

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from mistaken import MISTAKES, Mistake, possible


def named(found: list[Found], mistake: Mistake) -> str:
    """``yes``, ``late`` where it was named after another one, ``no``."""

    def fits(each: Found) -> bool:
        text = f"{each.amendment.what}; {each.amendment.proposal}"
        who = not mistake.subject or each.amendment.subject == mistake.subject
        return who and any(word in text for word in mistake.words)

    if found and fits(found[0]):
        return "yes"
    return "late" if any(fits(each) for each in found) else "no"


def main(only: list[str]) -> None:
    """Print the table, of some recordings or of all."""
    chosen = [(name, path) for name, path, _ in recordings() if not only or name in only]
    results: dict[str, dict[str, str]] = {}
    alarms = {}
    for name, path in chosen:
        sound = read_experiment(path)
        alarms[name] = sum(len(mistakes(excerpt)[0]) for excerpt in excerpts(sound, 8))
        for what, mistake in MISTAKES.items():
            if not possible(mistake, sound):
                continue
            start = time.perf_counter()
            views = excerpts(mistake.make(sound), 1)
            found = mistakes(views[0])[0] if views else []
            results.setdefault(what, {})[name] = named(found, mistake)
            print(
                f"{name}: {what}: {results[what][name]} ({time.perf_counter() - start:.1f} s)",
                file=sys.stderr,
            )
    names = [name for name, _ in chosen]
    print(f"| mistake | {' | '.join(names)} |")
    print("|---|" + "---|" * len(names))
    for what, each in results.items():
        print(f"| {what} | {' | '.join(each.get(name, '') for name in names)} |")
    hits = {name: sum(each.get(name) == "yes" for each in results.values()) for name in names}
    made = {name: sum(name in each for each in results.values()) for name in names}
    print(f"| named | {' | '.join(f'{hits[name]} of {made[name]}' for name in names)} |")
    print(
        "| false alarms on the sound recording |"
        f" {' | '.join(str(alarms[name]) for name in names)} |"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
