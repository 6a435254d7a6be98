"""The validation book: every claim about estimates, drawn anew as pages of docs/validation/.

`make validation` (hours), or `python benchmarks/book.py [--scale S] [--out DIR] [--anew] [CHAPTER ...]`: S is
the part of all draws that is made. What a part of a chapter has shown is kept in docs/validation/drawn (where S is less
than 1, in DIR) and is not made again unless that is asked for; a study that was ended goes on from its table
in DIR.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from recorder import METHODS

from steelyard.campaigns.study.power import WRONG
from steelyard.campaigns.study.result import Study
from steelyard.campaigns.study.run import ALL, study
from steelyard.report.evidence.made import steelyard_version

HERE = Path(__file__).parent
ROOT = HERE.parent
PAGES = ROOT / "docs" / "validation"
ROUGH = ROOT / "tests" / "data" / "rough-robots"
EVERY = (*METHODS, "recursive")
BEST = ("consistent",)
DEFAULT = ("maximum-likelihood",)


@dataclass(frozen=True)
class Draws:
    """A study."""

    label: str
    what: str
    count: int
    """Of draws, in full."""
    methods: tuple[str, ...] = EVERY
    keys: Mapping[str, Any] = field(default_factory=dict)

    def command(self, count: int) -> str:
        """How to do it alone."""
        words = ["steelyard study", shown(self.what), f"--draws {count}"]
        words += [f"--method {name}" for name in self.methods]
        words += [
            "--mistakes" if k == "mistakes" else f"--{k} {shown(v)}" for k, v in self.keys.items()
        ]
        return " ".join((*words, "--out DIR"))


@dataclass(frozen=True)
class Printed:
    """What another benchmark prints."""

    label: str
    script: str
    words: tuple[str, ...] = ()
    count: int = 0
    """Of draws, in full; they stand behind the script. 0: it has none."""

    def words_of(self, count: int) -> list[str]:
        """What is asked of Python, from the root of the project."""
        words = [f"benchmarks/{self.script}", *self.words, *([str(count)] if count else [])]
        # One process, so that what it says of times is true.
        return [*words, "1"] if self.script == "recursive.py" else words

    def command(self, count: int) -> str:
        """How to do it alone."""
        return f"python {' '.join(self.words_of(count))}"


@dataclass(frozen=True)
class Chapter:
    """One page."""

    title: str
    about: str
    parts: tuple[Draws | Printed, ...]
    power: bool = False
    """Whether it is about mistakes, rather than errors."""


PAPER = {"duration": 20.0}
CHAPTERS = {
    "uncertainty": Chapter(
        "Coverage and chi-square of every method",
        "Simulated experiments in which nothing is wrong, every error drawn anew as it is described.",
        (
            Draws("CoGiRo, sensors of the paper", "cogiro", 200, keys=PAPER),
            Draws("CoGiRo with a cuboid", "cogiro-cuboid", 200, keys=PAPER),
            Draws(
                "CoGiRo, camera and cheap IMU",
                "cogiro",
                200,
                keys={**PAPER, "sensors": str(HERE / "sensors" / "camera.yaml")},
            ),
            Draws(
                "CoGiRo, encoders and IMU",
                "cogiro",
                200,
                keys={**PAPER, "sensors": str(HERE / "sensors" / "lengths.yaml")},
            ),
            Draws("four cables", str(ROUGH / "four-cables-00" / "experiment.yaml"), 200),
            Draws("three cables", str(ROUGH / "three-cables-00" / "experiment.yaml"), 200),
        ),
    ),
    "verdict": Chapter(
        "Power and size of the verdict",
        "Every mistake in every draw, one at a time, by the method whose estimate `identify` gives.",
        (
            Draws("CoGiRo", "cogiro", 20, DEFAULT, {**PAPER, "mistakes": ALL}),
            Draws(
                "four cables",
                str(ROUGH / "four-cables-00" / "experiment.yaml"),
                20,
                DEFAULT,
                {"mistakes": ALL},
            ),
        ),
        power=True,
    ),
    "durations": Chapter(
        "Recordings of 5 to 300 s",
        "Whether the stated 1-sigma stays true as it falls.",
        tuple(
            Draws(f"{seconds} s", "cogiro", count, BEST, {"duration": float(seconds)})
            for seconds, count in ((5, 200), (10, 200), (20, 200), (60, 100), (300, 50))
        ),
    ),
    "designs": Chapter(
        "What is said of a designed motion beforehand",
        "Predicted 1-sigma against the errors of estimates from recordings of these motions.",
        (Printed("truth", "design.py", ("truth",), 200),),
    ),
    "imperfections": Chapter(
        "Imperfections of real robots",
        "Recordings of another simulator, one imperfection each, nothing of it stated.",
        (Printed("imperfect", "imperfect.py"),),
    ),
    "live": Chapter(
        "Estimates while data arrive",
        "Their errors in stated 1-sigma at several instants.",
        (Printed("recursive", "recursive.py", (), 60),),
    ),
    "recordings": Chapter(
        "Other simulators, and real recordings",
        "Recordings that are beside the project, or those of its tests.",
        (Printed("accuracy", "run.py", ("accuracy",)),),
    ),
}


def shown(value: object) -> str:
    """A path from the project."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text.removeprefix(f"{ROOT}/")


def scaled(count: int, scale: float) -> int:
    return max(2, round(count * scale)) if count else 0


@dataclass(frozen=True)
class Result:
    """What a part of a chapter has shown; kept beside the pages, so that a chapter may take several
    days, or machines."""

    command: str
    date: str
    version: str
    rows: Sequence[Sequence[str]] = ()
    blocks: Sequence[str] = ()
    """Of text."""

    @classmethod
    def of(cls, command: str, **found: Any) -> Result:
        """Of today."""
        return cls(command, datetime.now(UTC).date().isoformat(), steelyard_version(), **found)

    @classmethod
    def kept(cls, path: Path, command: str) -> Result | None:
        """What the same command has shown before; None: nothing."""
        if not path.exists():
            return None
        found = cls(**json.loads(path.read_text(encoding="utf-8")))
        return found if found.command == command else None

    def keep(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


def told(value: float, digits: int) -> str:
    """A number of a table; a dash where no draw has told it."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def errors(found: Study, label: str) -> Iterator[tuple[str, ...]]:
    """Rows of the table of a chapter about errors."""
    for name, each in found.methods.items():
        bounded = np.where(each.bound > 0, each.bound, np.nan)
        ratio = (
            np.sqrt(np.nanmean((each.rmse / bounded) ** 2))
            if np.isfinite(bounded).any()
            else np.nan
        )
        small = [str(p) for p in range(10) if each.outcome(p) == "too small"]
        yield (
            label, name, str(each.count), f"{each.accepted}/{each.rejected}",
            told(float(100 * np.nanmean(each.coverage)), 1),
            told(float(np.nanmean(each.chi_square)), 2), told(float(np.nanmax(each.chi_square)), 2),
            told(each.joint / 10, 2), told(ratio, 2), str(len(small)),
        )  # fmt: skip


ERRORS = (
    "what", "method", "draws", "accepted/rejected", "coverage of 95 % [%]", "chi-square per parameter",
    "largest", "of all ten, per parameter", "rmse over bound", "1-sigma too small",
)  # fmt: skip
POWER = ("what", "mistake", "draws", "rejected", "95 % from [%]", "to [%]", "accepted, and wrong")


def power(found: Study, label: str) -> Iterator[tuple[str, ...]]:
    """Rows of the table of a chapter about mistakes."""
    for each in found.rejections:
        low, high = (f"{100 * end:.0f}" for end in each.interval)
        name = each.mistake or "none (false rejections)"
        yield label, name, str(each.count), str(each.rejected), low, high, str(each.wrong)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|---|---|" + "---:|" * (len(head) - 2)
    yield from (f"| {' | '.join(row)} |" for row in rows)


def made(part: Draws | Printed, folder: Path, count: int, jobs: int, *, is_power: bool) -> Result:
    """Of a part, now."""
    command = part.command(count)
    if isinstance(part, Draws):
        found = study(part.what, folder, count, part.methods, jobs=jobs, **part.keys)
        rows = (power if is_power else errors)(found, part.label)
        problems = [f"{part.label}: {text}" for text in found.problems]
        return Result.of(command, rows=list(rows), blocks=problems)
    words = [sys.executable, *part.words_of(count)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
    return Result.of(command, blocks=[done.stdout.strip("\n")])


def results(
    name: str, out: Path, scale: float, jobs: int, *, anew: bool
) -> Iterator[Sequence[Result | None]]:
    """What there is of a chapter, each time another of its parts has been made; None: not yet.

    Args:
        name: Of the chapter.
        out: Where studies keep their tables.
        scale: Part of all draws.
        jobs: Processes that work at a time.
        anew: Whether to make what has been kept again.
    """
    chapter = CHAPTERS[name]
    counts = [scaled(part.count, scale) for part in chapter.parts]
    # A few draws are not to take the place of all of them.
    folder = (PAGES if scale == 1 else out) / "drawn"
    paths = [folder / f"{name}-{i}.json" for i in range(len(counts))]
    found = [
        None if anew else Result.kept(path, part.command(count))
        for path, part, count in zip(paths, chapter.parts, counts, strict=True)
    ]
    yield found
    for i, (part, count) in enumerate(zip(chapter.parts, counts, strict=True)):
        if found[i] is None:
            own = made(part, out / name / f"{i}", count, jobs, is_power=chapter.power)
            own.keep(paths[i])
            found[i] = own
            yield found


def page(chapter: Chapter, found: Sequence[Result | None], scale: float) -> str:
    """A chapter as far as it has been made."""
    lines = [
        f"# {chapter.title}",
        "",
        chapter.about,
        f"Drawn by `make validation` with {scale:g} of all draws.",
    ]
    if scale < 1:
        lines += ["**These are few draws: they show the form, and large errors, no more.**"]
    done = [(part, own) for part, own in zip(chapter.parts, found, strict=True) if own is not None]
    missing = [part.label for part, own in zip(chapter.parts, found, strict=True) if own is None]
    if missing:
        lines += [f"**Not drawn yet: {'; '.join(missing)}.**"]
    rows = [row for _, own in done for row in own.rows]
    if rows:
        lines += ["", *table(POWER if chapter.power else ERRORS, rows), "", *NOTES[chapter.power]]
        lines += ["", "| what | command | date | steelyard |", "|---|---|---|---|"]
    for part, own in done:
        if isinstance(part, Draws):
            lines += [f"| {part.label} | `{own.command}` | {own.date} | {own.version} |"]
    for part, own in done:
        if isinstance(part, Draws):
            lines += [f"\n{block}" for block in own.blocks]
        else:
            lines += ["", f"`{own.command}`, {own.date}, steelyard {own.version}:"]
            lines += [f"\n```\n{block}\n```" for block in own.blocks]
    return "\n".join(lines) + "\n"


NOTES = {
    False: (
        "Coverage and chi-square are means over the ten parameters, *largest* is the worst of them; all"
        " ten together are the squared errors over their covariance. Each should be 1 (coverage 95).",
        "The bound is that of Cramer and Rao. *1-sigma too small*: of how many parameters the draws"
        " contradict it (probability below 0.001 for all ten). The two steps state a 1-sigma from their"
        " residuals alone.",
    ),
    True: (
        "*Accepted, and wrong*: the errors contradict the stated covariance (probability below"
        f" {WRONG:g}). Intervals are those of Wilson.",
    ),
}


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--scale", type=float, default=1.0)
    asked.add_argument("--out", type=Path, default=ROOT / "build" / "validation")
    asked.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    asked.add_argument("--anew", action="store_true", help="make again what has been kept")
    asked.add_argument("chapters", nargs="*", choices=[*CHAPTERS, []], metavar="CHAPTER")
    given = asked.parse_args()
    for name in given.chapters or CHAPTERS:
        for found in results(name, given.out, given.scale, given.jobs, anew=given.anew):
            text = page(CHAPTERS[name], found, given.scale)
            (PAGES / f"book-{name}.md").write_text(text, encoding="utf-8")
        print(f"docs/validation/book-{name}.md", flush=True)


if __name__ == "__main__":
    main()
