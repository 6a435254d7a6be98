"""Changed files for every reader: ``python tests/fuzz.py --files 10000``, or for a time, or guided
by what of the code they reach.

A reader may refuse a file with an error of the package, or read it. Anything else is found: another
exception, a warning, words on the standard error, more than ten seconds of the processor, more than 500 MiB, the end of the
process. The same seed gives the same files.
"""

import argparse
import gzip
import json
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

MOST_SECONDS, MOST_MEMORY = 10.0, 500 << 20
"""Of the processor, and resident, of the reader and the process within its fence."""
PATIENCE = 120
"""By the clock, on a machine that does other things [s]."""
GUIDED = ("text", "init", "experiment", "robot", "covariance", "sensors", "estimate", "report",
          "truth", "message", "caspr", "import", "mcap", "bag", "db3", "npz")  # fmt: skip
"""Of which code of the package can be followed; the rest is read by compiled libraries."""


FRESH = 300
"""Files after which the process is begun anew: memory that libraries keep is not that of one file."""


def changed(name, number, seed, sound):
    """The file of a number: which sound file it comes from, and its bytes."""
    from mutations import mutated

    rng = random.Random(f"{name}:{seed}:{number}")
    path = rng.choice(sorted(sound))
    content = sound[path]
    packed = path.suffix == ".gz" and rng.random() < 0.8
    if packed:
        content = gzip.decompress(content)
    content = mutated(rng, content, list(sound.values()))
    return path, gzip.compress(content, mtime=0) if packed else content


def placed(target, path, content, folder):
    """The file in a folder of its own, with what must lie beside it."""
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir()
    if target.beside is not None:
        shutil.copytree(target.beside, folder, dirs_exist_ok=True)
    place = folder / path.name
    place.write_bytes(content)
    return place


def outcome(target, place):
    """How reading ended: ``read``, ``refused``, or what should not be."""
    from steelyard.errors import SteelyardError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            target.read(place)
    except SteelyardError as error:
        text = error.on_command_line
        whole = "\n" not in text.strip() and len(text) < 4000
        return "refused" if whole else f"found: no single sentence: {text[:200]!r}"
    except KeyboardInterrupt:
        raise
    except BaseException:
        return "found: " + traceback.format_exc()
    return "read"


def used():
    """Time of the processor [s] and largest memory [bytes] of this process and its readers since it
    was asked last."""
    seconds = time.process_time()
    memory = 0
    for pid in (os.getpid(), *_children()):
        with suppress(OSError, StopIteration):
            folder = Path(f"/proc/{pid}")
            lines = (folder / "status").read_text().splitlines()
            memory += 1024 * int(next(x for x in lines if x.startswith("VmHWM")).split()[1])
            if pid != os.getpid():
                fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
                seconds += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            (folder / "clear_refs").write_text("5")
    own = os.times()
    return seconds + own.children_user + own.children_system, memory


def _children():
    with suppress(OSError):
        return [int(x) for x in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]
    return []


def serve(seed, folder):
    """Read the files that are asked for, one a line; says how each ended."""
    from readers import TARGETS, sound_files

    out = os.fdopen(os.dup(1), "w")
    said = (folder / "said").open("w+b")
    os.dup2(said.fileno(), 1)
    os.dup2(said.fileno(), 2)
    sound = {}
    for line in sys.stdin:
        name, number = json.loads(line)
        if name not in sound:
            sound[name] = sound_files(name, folder)
        target = TARGETS[name]
        path, content = changed(name, number, seed, sound[name])
        place = placed(target, path, content, folder / "changed")
        before, _ = used()
        how = outcome(target, place)
        after, memory = used()
        said.seek(0)
        if words := said.read():
            how = f"found: said of itself: {words[:2000].decode(errors='replace')}"
            said.seek(0)
            said.truncate()
        print(json.dumps([how, max(0.0, after - before), memory]), file=out, flush=True)


class Reader:
    """A process that reads changed files, begun again when it is gone."""

    def __init__(self, seed, folder):
        self.arguments = [sys.executable, __file__, "--serve", str(folder), "--seed", str(seed)]
        self.process, self.left = None, 0

    def ask(self, name, number):
        """How the reading of a file ended, seconds, bytes."""
        if self.left == 0:
            self.end()
        if self.process is None:
            self.left = FRESH
            self.process = subprocess.Popen(
                self.arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                start_new_session=True,
            )  # fmt: skip
        self.left -= 1
        with suppress(BrokenPipeError):
            print(json.dumps([name, number]), file=self.process.stdin, flush=True)
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            what = f"ended: {self.process.poll()}" if ready else f"no answer in {PATIENCE} s"
            self.end()
            return f"found: {what}", 0.0 if ready else float(PATIENCE), 0
        return json.loads(line)

    def end(self):
        """End it and the readers that it began."""
        if self.process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            self.process, self.left = None, 0


def run(files, seconds, seed, names, keep):
    """Read changed files, the targets in turn; prints a table, keeps what was found."""
    begun, number = time.monotonic(), 0
    table = {
        name: dict.fromkeys(("files", "read", "refused", "found", "long", "large"), 0)
        for name in names
    }
    worst = {"seconds": (0.0, ""), "MiB": (0.0, "")}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        reader = Reader(seed, folder)
        try:
            while number * len(names) < files and time.monotonic() - begun < seconds:
                for name in names:
                    how, took, memory = reader.ask(name, number)
                    row = table[name]
                    row["files"] += 1
                    row[how.split(":")[0]] += 1
                    row["long"] += took > MOST_SECONDS
                    row["large"] += memory > MOST_MEMORY
                    worst["seconds"] = max(worst["seconds"], (took, f"{name} {number}"))
                    worst["MiB"] = max(worst["MiB"], (memory / (1 << 20), f"{name} {number}"))
                    if how.startswith("found") or took > MOST_SECONDS or memory > MOST_MEMORY:
                        print(
                            f"{name} {number}: {took:.1f} s, {memory >> 20} MiB, {how}", flush=True
                        )
                        if keep is not None:
                            _keep(name, number, seed, folder, keep)
                number += 1
        finally:
            reader.end()
    print(f"{'reader':12}" + "".join(f"{key:>9}" for key in next(iter(table.values()))))
    for name, row in table.items():
        print(f"{name:12}" + "".join(f"{value:9}" for value in row.values()))
    total = {key: sum(row[key] for row in table.values()) for key in next(iter(table.values()))}
    print(f"{'all':12}" + "".join(f"{value:9}" for value in total.values()))
    for what, (value, where) in worst.items():
        print(f"most {what}: {value:.2f} ({where})")
    print(f"seed {seed}, {time.monotonic() - begun:.0f} s by the clock")
    return total["found"] + total["long"] + total["large"]


def _keep(name, number, seed, folder, keep):
    from readers import sound_files

    path, content = changed(name, number, seed, sound_files(name, folder / "again"))
    place = keep / name / f"{seed}-{number}-{path.name}"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(content)


def guided(name, seconds, seed, keep):
    """Let atheris look for files that reach new code of one reader, within this process."""
    import atheris

    with atheris.instrument_imports(include=["steelyard"]):
        from readers import TARGETS, sound_files

        from steelyard.logs import formats
    # Within the process: what is behind the fence could not be followed.
    formats.opened_in_fence = lambda path, topic: formats.format_of(path).opened(path, topic)
    formats.topics_in_fence = lambda path: formats.format_of(path).topics(path)
    target = TARGETS[name]
    folder = Path(tempfile.mkdtemp())
    sound = sound_files(name, folder)
    corpus = folder / "corpus"
    corpus.mkdir()
    for i, content in enumerate(sound.values()):
        (corpus / str(i)).write_bytes(content)
    paths = sorted(sound)
    first = paths[0]

    def once(data):
        how = outcome(target, placed(target, first, data, folder / "changed"))
        if how.startswith("found"):
            print(how, file=sys.stderr)
            raise RuntimeError(how.strip().splitlines()[-1])

    keep.mkdir(parents=True, exist_ok=True)
    options = [sys.argv[0], f"-max_total_time={seconds}", f"-seed={seed + 1}", "-timeout=10",
               "-rss_limit_mb=1500", "-max_len=65536", f"-artifact_prefix={keep}/{name}-",
               "-print_final_stats=1", str(corpus)]  # fmt: skip
    atheris.Setup(options, once)
    atheris.Fuzz()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=10**9, help="stop after so many")
    parser.add_argument("--seconds", type=float, default=10**9, help="stop after so long")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", action="append", help="only this one; may be repeated")
    parser.add_argument("--keep", type=Path, help="folder for files that were found")
    parser.add_argument("--guided", type=int, metavar="S", help="atheris, so long for each reader")
    parser.add_argument("--serve", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        serve(asked.seed, asked.serve)
        return 0
    if asked.guided and asked.reader and len(asked.reader) == 1:
        guided(asked.reader[0], asked.guided, asked.seed, asked.keep or Path("fuzz-found"))
        return 0
    if asked.guided:
        failed = 0
        for name in asked.reader or GUIDED:
            own = [sys.executable, __file__, "--guided", str(asked.guided), "--reader", name]
            own += ["--seed", str(asked.seed), "--keep", str(asked.keep or Path("fuzz-found"))]
            ended = subprocess.run(own, stderr=subprocess.PIPE, text=True)
            lines = ended.stderr.splitlines()
            runs = next((x for x in lines if "number_of_executed_units" in x), "no files")
            print(f"{name:12} {runs.split()[-1]:>9} files, status {ended.returncode}", flush=True)
            if ended.returncode:
                failed += 1
                print("\n".join(x for x in lines if not x.startswith(("#", "INFO"))))
        return failed
    from readers import TARGETS

    return (
        1
        if run(asked.files, asked.seconds, asked.seed, asked.reader or list(TARGETS), asked.keep)
        else 0
    )


if __name__ == "__main__":
    sys.exit(main())
