"""The validation book: every claim about estimates, drawn anew as pages of docs/validation/.

`make validation` (hours), or `python benchmarks/book.py [--scale S] [--out DIR] [CHAPTER ...]`: S is the
part of all draws that is made. What was done is in DIR and is not done again; remove it to begin anew.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
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
        "Every mistake in every draw, one at a time, by the methods that `identify` takes.",
        (
            Draws("CoGiRo", "cogiro", 100, BEST, {**PAPER, "mistakes": ALL}),
            Draws(
                "four cables",
                str(ROUGH / "four-cables-00" / "experiment.yaml"),
                100,
                BEST,
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


def dated(folder: Path, what: str) -> str:
    """The day on which a result became what it is."""
    file = folder / "made.txt"
    known, _, day = file.read_text().partition("\n") if file.exists() else ("", "", "")
    if known != what:
        day = datetime.now(UTC).date().isoformat()
        file.write_text(f"{what}\n{day}")
    return day.strip()


def studied(part: Draws, folder: Path, scale: float, jobs: int) -> Study:
    return study(part.what, folder, scaled(part.count, scale), part.methods, jobs=jobs, **part.keys)


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
            f"{100 * np.nanmean(each.coverage):.1f}",
            f"{np.nanmean(each.chi_square):.2f}", f"{np.nanmax(each.chi_square):.2f}",
            f"{each.joint / 10:.2f}", f"{ratio:.2f}", str(len(small)),
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


def printed(part: Printed, folder: Path, scale: float) -> str:
    """What it prints; kept once it has ended."""
    folder.mkdir(parents=True, exist_ok=True)
    count = scaled(part.count, scale)
    words = [part.script, *part.words, *([str(count)] if count else [])]
    if part.script == "recursive.py":
        words.append("1")
    kept = folder / f"{'-'.join(words)}.txt"
    if not kept.exists():
        command = [sys.executable, str(HERE / words[0]), *words[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        kept.write_text(done.stdout)
    day = dated(folder, f"{kept.name} {steelyard_version()}")
    text = kept.read_text().strip("\n")
    return f"`python benchmarks/{' '.join(words)}`, {day}:\n\n```\n{text}\n```"


def page(name: str, chapter: Chapter, out: Path, scale: float, jobs: int) -> str:
    """A chapter, with all that it needs done."""
    rows: list[tuple[str, ...]] = []
    commands, blocks = [], []
    for i, part in enumerate(chapter.parts):
        folder = out / name / f"{i}"
        if isinstance(part, Printed):
            blocks.append(printed(part, folder, scale))
            continue
        found = studied(part, folder, scale, jobs)
        rows += (power if chapter.power else errors)(found, part.label)
        day = dated(folder, f"{found.draws} {steelyard_version()}")
        commands.append(f"| {part.label} | `{part.command(found.draws)}` | {day} |")
        blocks += [f"{part.label}: {text}" for text in found.problems]
    lines = [f"# {chapter.title}", "", chapter.about]
    lines += [
        f"Drawn by `make validation` with {scale:g} of all draws, steelyard {steelyard_version()}."
    ]
    if scale < 1:
        lines += ["**These are few draws: they show the form, and large errors, no more.**"]
    if rows:
        lines += ["", *table(POWER if chapter.power else ERRORS, rows), "", *NOTES[chapter.power]]
        lines += ["", "| what | command | date |", "|---|---|---|", *commands]
    return "\n".join([*lines, *(f"\n{block}" for block in blocks)]) + "\n"


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
    asked.add_argument("chapters", nargs="*", choices=[*CHAPTERS, []], metavar="CHAPTER")
    given = asked.parse_args()
    for name in given.chapters or CHAPTERS:
        text = page(name, CHAPTERS[name], given.out, given.scale, given.jobs)
        (PAGES / f"book-{name}.md").write_text(text, encoding="utf-8")
        print(f"docs/validation/book-{name}.md", flush=True)


if __name__ == "__main__":
    main()
