"""One bit of one reading flipped in a log without checksums: is it named, or does it change the
estimate?

``python benchmarks/flipped_bits.py [COUNT]``: bits of the exponent (and the sign) of single
readings of forces, IMU and tracker, drawn with seed 0; prints how many are refused, named, or
change an estimate by more than a tenth of its 1-sigma without being named.
"""

import struct
import sys
import tempfile
from pathlib import Path

import numpy as np

import steelyard
from steelyard.errors import SteelyardError
from steelyard.simulation.simulate import simulate

MOST = 0.1
"""Change of an estimate in units of its 1-sigma."""


def flipped(value, bit):
    """A number with one of the 12 highest bits of its 64 flipped: the sign is 0."""
    whole = struct.unpack("<Q", struct.pack("<d", value))[0] ^ (1 << (63 - bit))
    return struct.unpack("<d", struct.pack("<Q", whole))[0]


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "recorded"
        simulate("cogiro", duration=6.0).write(folder)
        path = folder / "experiment.yaml"
        methods = ("two-step", "maximum-likelihood")
        sound = steelyard.identify(path, methods)
        logs = {
            each: (folder / "multisine" / f"{each}.csv") for each in ("cables", "imu", "tracker")
        }
        texts = {name: log.read_text() for name, log in logs.items()}
        ends = dict.fromkeys(("refused", "rejected", "named", "no change", "unnamed"), 0)
        for number in range(count):
            name = list(logs)[rng.integers(3)]
            lines = texts[name].splitlines()
            row = int(rng.integers(1, len(lines)))
            cells = lines[row].split(",")
            column = int(rng.integers(1, len(cells)))
            bit = int(rng.integers(0, 12))
            before = float(cells[column])
            cells[column] = repr(flipped(before, bit))
            lines[row] = ",".join(cells)
            logs[name].write_text("\n".join(lines) + "\n")
            where = f"{number}: {name} row {row} column {column}, bit {bit}, {before:g} -> {cells[column]}"
            try:
                found = steelyard.identify(path, methods)
            except SteelyardError as error:
                ends["refused"] += 1
                print(f"{where}: refused: {str(error)[-120:]}")
            else:
                how, what = judged(sound, found)
                ends[how] += 1
                print(f"{where}: {how}{what}", flush=True)
            logs[name].write_text(texts[name])
        print(ends)


def judged(sound, found):
    """How an identification with a flipped bit ended, and by how much it is off."""
    off = {
        name: float(
            np.nanmax(
                np.abs(each.value - sound.estimates[name].value)
                / np.sqrt(np.diag(sound.estimates[name].covariance))
            )
        )
        if np.isfinite(each.value).any()
        else np.inf
        for name, each in found.estimates.items()
    }
    text = "".join(f", {name} by {value:.2g}" for name, value in off.items())
    worst = max(off.values())
    if found.is_rejected:
        return "rejected", text
    if worst <= MOST:
        return "no change", text
    notes = [*found.left_out, *(note for e in found.estimates.values() for note in e.notes)]
    return "named" if any(
        "left out" in note or "stand far" in note for note in notes
    ) else "unnamed", text


if __name__ == "__main__":
    main()
