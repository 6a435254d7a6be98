"""What was taken out of a recording, or put right, when it was read, in words."""

from __future__ import annotations

from steelyard.experiment.faults.fault import Fault


def left_out_in_words(run: str, fault: Fault) -> str:
    """A sentence on readings that were left out.

    Args:
        run: In which they were.
        fault: What was wrong with them.
    """
    name, count, when = fault.instrument, fault.count, f"at {fault.start:.3f} s"
    if count > 1 or fault.kind != "spike":
        when = f"from {fault.start:.3f} to {fault.end:.3f} s"
    if fault.kind == "set":
        return (
            f"run '{run}': the clock of {name} was set from {fault.start:.3f} to {fault.end:.3f} s"
            f" while its readings went on: the {count} times since then are taken as if it had not"
            " been; see that nothing sets the clock while you record"
        )
    if fault.kind == "doubled":
        return (
            f"run '{run}': {count} samples of {name} say once more what the one before them said,"
            f" {when} on its clock: left out"
        )
    if fault.kind == "held":
        what = f"{fault.channel.replace('_', ' ')} of " if fault.channel else ""
        return (
            f"run '{run}': {what}{name} is logged more often than it reads: {count} samples that"
            " repeat the reading before them are left out"
        )
    if fault.kind == "spike":
        return (
            f"run '{run}': {count} readings of {name}, {fault.channel}, stand alone, far from those"
            f" before and after them, {when} on its clock: left out; look for a damaged file or a"
            " loose contact"
        )
    if fault.kind == "dead":
        return (
            f"run '{run}': {fault.channel.replace('_', ' ')} of {name} reads the same in all"
            f" {count} samples while its other channels read noise: left out; repair the sensor or"
            " its cable"
        )
    channel = f" of {fault.channel}" if fault.channel else ""
    return (
        f"run '{run}': {name}{channel} repeats its reading {when} on its clock while others move"
        f" ({count} samples): left out"
    )
