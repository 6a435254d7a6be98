"""Commands that write, ended at random moments: are their results old or new, is a signal lost?

``python benchmarks/killed_verbs.py [COUNT [SECONDS [VERB ...]]]``: every verb of :data:`VERBS`, or
some of them, in turn replaces results that are there and gets SIGKILL, SIGTERM or SIGINT; half of
the moments are drawn over the time that the verb takes, half over the tenth of a second after it has begun to write. What is
there then must be, byte by byte, all of the old files or all of the new ones; the next undisturbed
command must leave nothing hidden. A signal is lost where the process goes on for more than two
seconds, or ends as if none had come though its results are not in their place.

Two are different. A study goes on: after every kill the same command once more has to end with the
results of one that nobody has disturbed. The log of ``watch`` grows: it has to be the old one, or
lines that are whole, with an estimate beside it only where it has ended; a signal ends it with an
estimate of what was seen. ``killed.py`` kills campaigns.
"""

import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from halls import recorded
from recordings import write_small

from steelyard.experiment.write import write_experiment

VERBS = {
    "identify": "small/experiment.yaml --method two-step --out {out} --force",
    "convert": "small/experiment.yaml --format csv --out {out} --force",
    "calibrate": "hall/experiment.yaml --out {out} --force",
    "design": "cogiro --check multisine --duration 3 --out {out} --force",
    "report": "{out}",
    "export": "{out} --format urdf --anyway --out {out}/body.urdf --force",
    "simulate": "cogiro --duration 3 --out {out} --force",
    "compare": "found/estimate.json other/estimate.json --out {out} --force",
    "inspect": "small/experiment.yaml --out {out} --force",
    "robots": "cogiro --out {out}/robot.html --force",
    "init": "small/moving --robot small/robot.yaml --out {out}/experiment.yaml --force",
    "demo": "--out {out} --force",
    "study": "cogiro --draws 2 --duration 3 --method two-step --jobs 1 --out {out}",
    "watch": "run/experiment.yaml --source replay:multisine@max --rate 2 --out {out}/log.jsonl --force",
}
GOES_ON, GROWS = "study", "watch"
ROWS = "campaign.parquet"
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LOST = 2.0
"""[s]"""
BEFORE = ("init_import_site", "Could not import runpy module")
"""What Python says of a signal while it begins."""
WRITES = 0.1
"""After the hidden folder of a command is seen [s]."""
ENV = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "OPENBLAS_NUM_THREADS": "1"}


def tree(folder):
    """Path -> bytes of all files of results."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part.startswith(".steelyard-") for part in path.parts)
    }


def hidden_in(top):
    """What commands prepare; the lock of a study stays."""
    while True:
        with suppress(FileNotFoundError):  # a folder that ended while it was looked at
            found = list(top.rglob(".steelyard-*"))
            return [path for path in found if path.name != ".steelyard-campaign.lock"]


def begun(verb, top):
    arguments = VERBS[verb].format(out=f"out-{verb}").split()
    return subprocess.Popen(
        [sys.executable, "-m", "steelyard", verb, *arguments],
        cwd=top, env=ENV, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def kind_of(verb, found, old, new):
    """``old``, ``new`` or ``mixed``."""
    if found == old:
        return "old"
    if verb == GOES_ON:
        # Its rows tell how long each took.
        found, new = ({k: v for k, v in each.items() if k != ROWS} for each in (found, new))
    if found == new:
        return "new"
    if verb != GROWS or set(found) - set(new) or found.get("mine.txt") != old["mine.txt"]:
        return "mixed"
    lines = found["log.jsonl"]
    # The estimate of the old log is taken away before that is.
    begun = "estimate.json" not in found and (lines == old["log.jsonl"] or is_json(lines))
    ended = is_json(lines) and is_json(found.get("estimate.json", b"{").replace(b"\n", b""))
    return "new" if begun or ended else "mixed"


def is_json(lines):
    """Whether all lines are whole."""
    try:
        return all(isinstance(json.loads(line), dict) for line in lines.splitlines())
    except ValueError:
        return False


def prepared(verb, top):
    """A folder with old results, the old files, the new ones, the status and how long it takes [s]."""
    out, start = top / f"out-{verb}", top / f"start-{verb}"
    if verb in ("report", "export"):
        shutil.copytree(top / "found", out)
    out.mkdir(exist_ok=True)
    process = begun(verb, top)
    _, said = process.communicate()
    if process.returncode not in (0, 3):
        raise SystemExit(f"{verb}: {said.decode()}")
    # Once more, since the first time all is read from the disk.
    before, process = time.monotonic(), begun(verb, top)
    process.communicate()
    taken = time.monotonic() - before
    new = tree(out)
    if verb == GOES_ON:
        shutil.rmtree(out)
        start.mkdir()
        return start, {}, new, process.returncode, taken
    for name in new:
        kept = verb in ("report", "export") and name in ("estimate.json", "report.json")
        if not kept and name != "provenance.json":
            (out / name).write_bytes(b"old " + name.encode())
    (out / "mine.txt").write_text("of the user")
    old = tree(out)
    shutil.copytree(out, start)
    begun(verb, top).communicate()
    return start, old, tree(out), process.returncode, taken


def ended(verb, top, taken, rng):
    """One command that gets a signal: the signal, its status, what it said, and how long it went on
    [s]; None: it had ended before.
    """
    number, process = rng.choice(SIGNALS), begun(verb, top)
    if rng.random() < 0.5:
        wait = rng.uniform(0.0, 1.1 * taken)
    else:
        wait, end = rng.uniform(0.0, WRITES), time.monotonic() + 3 * taken
        while process.poll() is None and time.monotonic() < end:
            if hidden_in(top):
                break
            time.sleep(0.002)
    with suppress(subprocess.TimeoutExpired):
        process.wait(wait)
    if process.poll() is not None:
        process.communicate()
        return None
    sent = time.monotonic()
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    return number, process.returncode, said.decode(), time.monotonic() - sent


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    limit = float(sys.argv[2]) if len(sys.argv) > 2 else 1e9
    # A shell has SIGINT ignored by what it runs in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rng, began = random.Random(1), time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        top = Path(temporary)
        write_small(top / "small")
        subprocess.run([sys.executable, "-m", "steelyard", "simulate", "cogiro", "--duration", "12",
                        "--out", "run", "--quiet"], cwd=top, env=ENV, check=True)  # fmt: skip
        (top / "hall").mkdir()
        write_experiment(recorded(m=4)[0], top / "hall")
        for name in ("found", "other"):
            words = ["identify", "small/experiment.yaml", "--method", "two-step", "--out", name]
            subprocess.run([sys.executable, "-m", "steelyard", *words], cwd=top, env=ENV,
                           stdout=subprocess.DEVNULL, check=False)  # fmt: skip
        verbs = sys.argv[3:] or list(VERBS)
        ready = {verb: prepared(verb, top) for verb in verbs}
        table = {verb: dict.fromkeys(("kills", "old", "new", "mixed", "lost"), 0) for verb in verbs}
        times = []
        for verb in itertools.cycle(verbs):
            done = sum(row["kills"] for row in table.values())
            if done >= count or time.monotonic() - began > limit:
                break
            start, old, new, status, taken = ready[verb]
            out, row = top / f"out-{verb}", table[verb]
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(start, out)
            how = ended(verb, top, taken, rng)
            if how is None:
                continue
            number, code, said, after = how
            if verb == GOES_ON:
                begun(verb, top).communicate()
            found = tree(out)
            row["kills"] += 1
            kind = kind_of(verb, found, old, new)
            row[kind] += 1
            if number != signal.SIGKILL:
                times.append(after)
                expected = {signal.SIGINT: 130, signal.SIGTERM: 143}[number]
                # Before the program's first line Python itself ends, with a status of its own.
                heard = code in (expected, -number) or any(word in said for word in BEFORE)
                heard = heard or (code == status and kind == "new")
                # It ends with what was seen, or says that nothing has arrived.
                heard = heard or (verb == GROWS and code in (0, 3) and kind == "new")
                if not heard or after > LOST:
                    row["lost"] += 1
                    print(f"{verb}: {number.name}: status {code} after {after:.2f} s, {kind}: {said[-300:]}")  # fmt: skip
            if kind == "mixed":
                print(f"{verb}: {number.name}: {sorted(found)}, hidden {hidden_in(top)}")  # fmt: skip
        left = 0
        for verb, (*_, new, _, _) in ready.items():
            begun(verb, top).communicate()
            left += kind_of(verb, tree(top / f"out-{verb}"), None, new) != "new"
        hidden = hidden_in(top)
    print("| command | kills | old / new | mixed | signals lost |\n|---|---|---|---|---|")
    for verb, row in table.items():
        print(f"| `{verb}` | {row['kills']} | {row['old']} / {row['new']} | {row['mixed']} | {row['lost']} |")  # fmt: skip
    total = {key: sum(row[key] for row in table.values()) for key in next(iter(table.values()))}
    print(f"all: {total}; SIGTERM and SIGINT: {len(times)}, most {max(times, default=0):.2f} s, mean {sum(times) / max(len(times), 1):.2f} s")  # fmt: skip
    print(f"after one more command each: {left} not new, {len(hidden)} hidden")


if __name__ == "__main__":
    main()
