"""The verb `watch`."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from steelyard.cli.options import (
    check_there,
    experiment_argument,
    force_option,
    limits_option,
    out_option,
)
from steelyard.cli.printing import in_lines

if TYPE_CHECKING:
    from steelyard.live.record import Record

NOT_ACCEPTED = 3
"""Exit status of an estimate that was made and written, but is not accepted."""


@click.command(short_help="Estimate while the robot moves.")
@experiment_argument
@click.option(
    "--source",
    required=True,
    metavar="URL",
    help="Where samples come from: replay:RUN[@SPEED|@max], udp://HOST:PORT, zmq+tcp://HOST:PORT,"
    " mqtt://HOST:PORT/TOPIC, opc.tcp://HOST:PORT,"
    " ads://HOST/NETID:PORT.",
)
@click.option(
    "--publish",
    multiple=True,
    metavar="URL",
    help="Where estimates go to: udp://HOST:PORT, zmq+tcp://HOST:PORT, mqtt://HOST:PORT/TOPIC,"
    " opc.tcp://HOST:PORT, foxglove:PORT, mcap:FILE; may be repeated.",
)
@click.option(
    "--rate",
    type=click.FloatRange(0, min_open=True),
    metavar="HZ",
    help="At most so many estimates a second of recorded time; default: all.",
)
@click.option(
    "--until",
    type=click.FloatRange(0, min_open=True),
    metavar="S",
    help="End after so many seconds of recorded time.",
)
@click.option(
    "--patience",
    type=click.FloatRange(0),
    default=0.2,
    show_default=True,
    metavar="S",
    help="How long samples may be late.",
)
@click.option(
    "--wanted",
    multiple=True,
    metavar="NAME=SIGMA",
    help="Say how long this motion must go on until the 1-sigma of mass [kg], cx, cy, cz [m], Jxx"
    " and so on [kg m^2] is as small as that; may be repeated.",
)
@click.option(
    "--page",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Serve a page that shows the estimates, on the loopback address; 0: any free port.",
)
@click.option(
    "--listen",
    metavar="ADDRESS",
    help="Serve it on this address of this machine instead; browsers then need a token, which is"
    " printed.",
)
@out_option(
    metavar="FILE",
    help="File for all estimates (.parquet, else JSON lines); estimate.json is written beside it.",
)
@force_option()
@limits_option
@click.option("--json", "as_json", is_flag=True, help="JSON lines, in a terminal too.")
@click.option("--quiet", is_flag=True, help="No remarks on stderr.")
def watch(
    experiment: Path,
    source: str,
    publish: tuple[str, ...],
    rate: float | None,
    until: float | None,
    patience: float,
    wanted: tuple[str, ...],
    page: int | None,
    listen: str | None,
    out: Path | None,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Estimate while the robot moves, from samples that arrive; EXPERIMENT describes robot and
    instruments.

    Ends with the source, after --until, or on Ctrl-C, with an estimate of all that was seen.
    """
    check_there(experiment)
    from dataclasses import replace

    from steelyard.live.settings import LIVE
    from steelyard.live.sinks.table import check_sink, open_sink
    from steelyard.live.sources.table import check_source, open_source
    from steelyard.live.watch import ended, watch
    from steelyard.live.watching import planned
    from steelyard.output import check_file_target

    if listen is not None and page is None:
        raise click.UsageError("--listen: expected --page too, found none; give its port")
    aims = _aims(wanted)
    check_source(source)
    for url in publish:
        check_sink(url)
    beside = None if out is None else out.parent / "estimate.json"
    for target in (out, beside):
        if target is not None:
            check_file_target(target, force=force)
    plan, name = planned(experiment, source)
    settings = replace(LIVE, patience=patience, wanted=aims)
    records: list[Record] = []
    session, first, last = None, None, None
    with ExitStack() as stack:
        stopped = stack.enter_context(_asked_to_stop())
        sinks = []
        for url in publish:
            sinks.append(open_sink(url))
            stack.callback(sinks[-1].close)
        if page is not None:
            sinks.append(stack.enter_context(_page(plan.name, page, listen)))
        samples = open_source(source, plan, settings)
        stack.callback(samples.close)
        write = stack.enter_context(_log(out, beside))
        show = stack.enter_context(_shown(as_json=as_json))
        for each in watch(plan, samples, name, settings, stopped):
            session = each.session
            for remark in each.remarks:
                _remark(remark, quiet=quiet)
            for record in each.records:
                first = record.time if first is None else first
                if rate is not None and last is not None and record.time - last < 1 / rate:
                    continue
                last = record.time
                for sink in sinks:
                    sink.send(record)
                write(record.line)
                records.append(record)
                show(record)
            if until is not None and session.seconds >= until:
                break
        found = ended(session) if session is not None else None
    sys.exit(_finished(plan, found, records, out, beside, quiet=quiet))


def _aims(wanted: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """1-sigma that are wanted, by the names of parameters."""
    from steelyard.inertia import BODY_PARAMETERS

    found = []
    for each in wanted:
        name, _, text = each.partition("=")
        try:
            sigma = float(text)
        except ValueError:
            sigma = 0.0
        if name not in BODY_PARAMETERS or not 0 < sigma < float("inf"):
            raise click.UsageError(
                f"--wanted: expected one of {', '.join(BODY_PARAMETERS)} with a 1-sigma above 0,"
                f" such as mass=0.2, found '{each}'; correct it"
            )
        found.append((name, sigma))
    return tuple(found)


def _finished(
    plan: Any,
    found: Any,
    records: list[Record],
    out: Path | None,
    beside: Path | None,
    *,
    quiet: bool,
) -> int:
    """Write what was found in the end; the exit status."""
    from dataclasses import replace

    from steelyard.identification.identification import Identification
    from steelyard.live.record import TABLE_FORMAT, table_of
    from steelyard.live.session import in_words
    from steelyard.output import results_folder, write_json, write_table

    if found is None or found.estimate is None:
        _say("nothing has arrived")
        return NOT_ACCEPTED
    received = in_words(found.session)
    estimate = replace(found.estimate, notes=(*found.estimate.notes, f"received: {received}"))
    identification = Identification(plan.name, plan.robot.platform, {estimate.method: estimate})
    if out is not None and beside is not None:
        # Both at once: a table is never beside the estimate of another.
        with results_folder(out.parent, force=True, shared=True) as folder:
            write_json(identification.to_dict(), folder / beside.name)
            if out.suffix == ".parquet":
                write_table(
                    [(found.session.name, table_of(records))], folder / out.name, TABLE_FORMAT
                )
    _remark(received, quiet=quiet)
    _remark(str(estimate.verdict), quiet=quiet)
    return 0 if estimate.verdict.accepted else NOT_ACCEPTED


def _remark(text: str, *, quiet: bool) -> None:
    """What only somebody who looks at it wants to know."""
    if not quiet and sys.stderr.isatty():
        _say(text)


def _say(text: str) -> None:
    """A line on stderr, in which nothing of a message can steer the terminal."""
    from steelyard.display import printable

    sys.stderr.write(f"{in_lines(f'steelyard: {printable(text)}', sys.stderr)}\n")
    sys.stderr.flush()


@contextmanager
def _page(title: str, port: int, listen: str | None) -> Iterator[Any]:
    """A page that is served, its address said: whoever has to open it needs that, so that it is
    said even to the quiet.
    """
    from steelyard.live.sinks.page import PageSink
    from steelyard.report.forms.live_page import live_page

    made = live_page(title)
    sink = PageSink(made.html, made.policy, port, listen)
    _say(f"page: {sink.url}")
    if sink.token is not None:
        _say("the page is sent unencrypted: use it within a network you trust")
    try:
        yield sink
    finally:
        sink.close()


@contextmanager
def _asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C or a polite kill has come: looked at between chunks, so that nothing is cut in
    two; a second one ends at once.
    """
    stop: list[int] = []

    def note(number: int, _frame: Any) -> None:
        stop.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)

    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    for each in before:
        signal.signal(each, note)
    try:
        yield lambda: bool(stop)
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextmanager
def _log(out: Path | None, beside: Path | None) -> Iterator[Callable[[str], None]]:
    """A file of JSON lines that grows as they come: what was seen before a failure stays."""
    from steelyard.output import growing_file

    if out is None or out.suffix == ".parquet":
        yield lambda text: None
        return
    out.parent.mkdir(parents=True, exist_ok=True)
    if beside is not None:
        # That of an earlier log; ours comes in the end.
        beside.unlink(missing_ok=True)
    with growing_file(out) as write:
        yield lambda text: write(f"{text}\n")


@contextmanager
def _shown(*, as_json: bool) -> Iterator[Callable[[Record], None]]:
    """A table that follows in a terminal, JSON lines elsewhere."""
    if as_json or not sys.stdout.isatty():
        yield lambda record: print(record.line, flush=True)
        return
    from rich.live import Live

    from steelyard.report.forms.live_table import live_table

    with Live(refresh_per_second=4) as live:
        yield lambda record: live.update(live_table(record))
