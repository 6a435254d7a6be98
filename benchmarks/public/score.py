"""Scores results of the public benchmark; NumPy alone: `python score.py RESULTS TRUTH [--json FILE]`.

A result is one JSON file per method and recording::

    {"format": "cable-robot-benchmark/1", "method": "my-method", "recording": "cogiro/plain-00",
     "data": "full" or "platform",
     "value": [mass, cx, cy, cz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy],
     "covariance": 10 rows of 10, or null, "accepted": true, false or null, "seconds": 1.2,
     "failure": null, or why there is no result}

SI units, platform axes, inertia about the centre of gravity. A number that a method does not give is
null in `value`, and its row and column in `covariance` are null. `accepted` is the method's own verdict on
its result, null if it has none.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
FORMAT = "cable-robot-benchmark/1"
TEN = 10
GROUPS = {"mass": slice(0, 1), "center_of_gravity": slice(1, 4), "inertia": slice(4, 10)}
NORMAL_95 = 1.959963984540054
FAR = 5.0
"""Stated 1-sigma beyond which an error counts as confidently wrong."""


def numbers(values: Sequence[Any]) -> Array:
    """Floats, NaN for null."""
    return np.array([np.nan if each is None else float(each) for each in values])


def check(result: Mapping[str, Any], where: str) -> None:
    """Whether a result has the form above.

    Raises:
        ValueError: It has not; the sentence says what to do.
    """
    missing = [key for key in ("method", "recording", "value") if key not in result]
    if result.get("format") != FORMAT or missing:
        what = f"the keys {', '.join(missing)}" if missing else f"format '{FORMAT}'"
        raise ValueError(f"{where}: expected {what}, found none; add it")
    if len(result["value"]) != TEN:
        raise ValueError(
            f"{where}: key 'value': expected {TEN} numbers or nulls, found {len(result['value'])};"
            " give all ten"
        )
    covariance = result.get("covariance")
    if covariance is not None and (
        len(covariance) != TEN or any(len(row) != TEN for row in covariance)
    ):
        raise ValueError(
            f"{where}: key 'covariance': expected {TEN} rows of {TEN}, or null, found another shape;"
            " correct it"
        )


def score_one(result: Mapping[str, Any], truth: Sequence[float]) -> dict[str, Any]:
    """Scores of one recording.

    Returns:
        ``given``: parameters that are numbers. ``error``: part -> relative error, None where one of
        its numbers is null: of the mass in parts of it; of the centre of gravity, its distance in parts
        of the body's radius of gyration sqrt(trace J / 2 m); of the inertia, in parts of the norm of
        the matrix. ``chi_square`` of the numbers given and ``freedom``, their count; None without a
        usable covariance. ``inside``, ``intervals``: 95 % intervals that contain the truth, and how
        many there are; ``far``: those off by more than 5 stated 1-sigma.
    """
    value, true = numbers(result["value"]), np.asarray(truth, dtype=float)
    known = np.isfinite(value)
    error = value - true
    radius = np.sqrt(true[4:7].sum() / 2 / true[0])
    # Off-diagonal elements stand twice in the matrix.
    weight = np.array([1, 1, 1, 2, 2, 2])
    sizes = {
        "mass": (abs(error[0]), true[0]),
        "center_of_gravity": (np.linalg.norm(error[1:4]), radius),
        "inertia": (np.sqrt(weight @ error[4:] ** 2), np.sqrt(weight @ true[4:] ** 2)),
    }
    found: dict[str, Any] = {
        "given": int(known.sum()),
        "error": {
            part: float(size / scale) if np.isfinite(size) else None
            for part, (size, scale) in sizes.items()
        },
        "chi_square": None, "freedom": 0, "inside": 0, "intervals": 0, "far": 0,
    }  # fmt: skip
    if result.get("covariance") is None or not known.any():
        return found
    covariance = np.array([numbers(row) for row in result["covariance"]])
    block = covariance[np.ix_(known, known)]
    variance = np.diag(block)
    if not np.isfinite(block).all() or (variance <= 0).any():
        return found
    sigma = np.sqrt(variance)
    scaled = error[known] / sigma
    correlation = block / np.outer(sigma, sigma)
    correlation = (correlation + correlation.T) / 2
    if np.linalg.eigvalsh(correlation).min() > 1e-12:
        found["chi_square"] = float(scaled @ np.linalg.solve(correlation, scaled))
        found["freedom"] = int(known.sum())
    found["intervals"] = int(known.sum())
    found["inside"] = int((np.abs(scaled) <= NORMAL_95).sum())
    found["far"] = int((np.abs(scaled) > FAR).sum())
    return found


def summary(scores: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Scores of one method over recordings; medians where single ones may be far off.

    Args:
        scores: Of :func:`score_one`, with ``accepted``, ``seconds`` and ``failure`` of the results.
    """
    done = [each for each in scores if each.get("failure") is None]
    chi = [each["chi_square"] / each["freedom"] for each in done if each["chi_square"] is not None]
    intervals = sum(each["intervals"] for each in done)
    judged = [each for each in done if each.get("accepted") is not None]
    kept = [each for each in done if each.get("accepted") is not False]
    rows: dict[str, Any] = {
        "recordings": len(scores),
        "failed": len(scores) - len(done),
        "null": 1 - sum(each["given"] for each in done) / (TEN * len(done)) if done else None,
        "error": {},
        "chi_square": float(np.median(chi)) if chi else None,
        "coverage": sum(each["inside"] for each in done) / intervals if intervals else None,
        "intervals": intervals,
        "far": sum(each["far"] for each in done),
        "rejected": sum(each["accepted"] is False for each in judged) if judged else None,
        "far_unrejected": sum(each["far"] for each in kept),
        "seconds": _median([each["seconds"] for each in done if each.get("seconds") is not None]),
    }
    for part in GROUPS:
        rows["error"][part] = _median(
            [each["error"][part] for each in done if each["error"][part] is not None]
        )
    return rows


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def read_results(folder: Path) -> list[dict[str, Any]]:
    """All results below a folder.

    Raises:
        ValueError: One has not the form, or there is none.
    """
    results = []
    for path in sorted(folder.rglob("*.json")):
        try:
            result = json.loads(path.read_text("utf-8"))
        except json.JSONDecodeError as error:
            raise ValueError(
                f"{path}:{error.lineno}: expected JSON, found something else; correct it"
            ) from error
        check(result, str(path))
        results.append(result)
    if not results:
        raise ValueError(f"{folder}: expected results (*.json), found none; run a method first")
    return results


def score(results: Sequence[Mapping[str, Any]], truths: Path) -> dict[str, Any]:
    """Method -> group of recordings -> summary; the groups are ``all``, each robot and each
    condition.

    Raises:
        ValueError: There is no truth for a recording.
    """
    collected: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for result in results:
        path = truths / f"{result['recording']}.json"
        if not path.exists():
            raise ValueError(f"{path}: expected the truth of a result's recording, found no file")
        truth = json.loads(path.read_text("utf-8"))["value"]
        own = {key: result.get(key) for key in ("accepted", "seconds", "failure")}
        scored = {**score_one(result, truth), **own, "recording": result["recording"]}
        robot, _, rest = result["recording"].partition("/")
        label = f"{result['method']} [{result.get('data') or 'full'}]"
        method = collected.setdefault(label, {})
        for group in ("all", robot, rest.rpartition("-")[0]):
            method.setdefault(group, []).append(scored)
    return {
        method: {group: summary(scores) for group, scores in groups.items()}
        for method, groups in collected.items()
    }


_COLUMNS = (
    "method [data]", "rec.", "failed", "null", "mass", "CoG", "inertia", "chi2/k", "95 %",
    "> 5 sigma", "rejected", "> 5 sigma, not rejected", "time",
)  # fmt: skip


def markdown(scored: Mapping[str, Mapping[str, Any]], group: str = "all") -> str:
    """The table of one group."""
    lines = ["| " + " | ".join(_COLUMNS) + " |", "|---" * len(_COLUMNS) + "|"]
    for method, groups in scored.items():
        if group not in groups:
            continue
        row = groups[group]
        cells = [
            method,
            str(row["recordings"]),
            str(row["failed"]),
            _percent(row["null"], 0),
            *(_percent(row["error"][part]) for part in GROUPS),
            _plain(row["chi_square"]),
            f"{_percent(row['coverage'], 0)} of {row['intervals']}" if row["intervals"] else "-",
            str(row["far"]) if row["intervals"] else "-",
            "-" if row["rejected"] is None else str(row["rejected"]),
            str(row["far_unrejected"]) if row["intervals"] else "-",
            "-" if row["seconds"] is None else f"{row['seconds']:.2g} s",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _percent(value: float | None, digits: int | None = None) -> str:
    if value is None:
        return "-"
    return f"{100 * value:.{digits}f} %" if digits is not None else f"{100 * value:.2g} %"


def _plain(value: float | None) -> str:
    return "-" if value is None else (f"{value:.2g}" if value < 1000 else f"{value:.0e}")


def main(arguments: Sequence[str]) -> int:
    """Print the tables; 2 where the input is wrong."""
    words = list(arguments)
    out = None
    if "--json" in words[:-1]:
        at = words.index("--json")
        out = Path(words[at + 1])
        del words[at : at + 2]
    if len(words) != 2:
        print("usage: python score.py RESULTS TRUTH [--json FILE]", file=sys.stderr)
        return 2
    try:
        scored = score(read_results(Path(words[0])), Path(words[1]))
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    if out is not None:
        out.write_text(json.dumps(scored, indent=1) + "\n", encoding="utf-8")
    groups = dict.fromkeys(group for each in scored.values() for group in each)
    for group in groups:
        print(f"\n### {group}\n\n{markdown(scored, group)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
