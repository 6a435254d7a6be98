"""Whatever is sent: refusals that are counted, and nothing that grows."""

import json
import random
import resource
import socket
import time

import numpy as np
import pytest
from simulated import PAPER

from steelyard.errors import InputError
from steelyard.live.buffer import Buffer
from steelyard.live.sources.source import MessageSource
from steelyard.live.sources.udp import UdpTransport

pytestmark = pytest.mark.integration
GOOD = {"instrument": "tracker", "t": 1.0, "x": 0.1, "y": 0.2, "z": 0.3}
DEEP = [b"[" * 10_000_000, b'{"a":' * 2_000_000, b"[" * 500_000 + b"]" * 500_000]


def malformed(rng):
    """One message that is none."""
    kind = rng.randrange(9)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return json.dumps(GOOD).encode()[: rng.randrange(1, 50)]
    found = dict(GOOD)
    if kind == 2:
        found[rng.choice("txyz")] = rng.choice([1e300, -1e16, 10**400, 1 << 70])
    elif kind == 3:
        found[rng.choice("txyz")] = rng.choice([float("nan"), float("inf"), -float("inf")])
    elif kind == 4:
        found["instrument"] = rng.choice(
            ["", "tracker ", "../tracker", "\x1b[2J", 7, None, [], {}, "x" * 500]
        )
    elif kind == 5:
        found[rng.choice(["f1", "__class__", "", "X", "qw", "x" * 300])] = 1.0
    elif kind == 6:
        found[rng.choice("txyz")] = rng.choice(["0.1", True, {}, [[1.0]], [], [1.0, 2.0], "\ud800"])
    elif kind == 7:
        del found[rng.choice(["instrument", *"txyz"])]
    else:
        return rng.choice(
            [b"", b"null", b"[]", b"[[]]", b"1", b'"a"', b"{}", b"[" * 3000, b'{"a":' * 900]
        )
    return json.dumps(found).encode()


class Given:
    """A transport of messages that are at hand."""

    def __init__(self, batches):
        self.batches = iter(batches)

    def messages(self, seconds):
        return next(self.batches), []

    def close(self):
        """Nothing to end."""


def memory():
    """The most that this process has had [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def refuse(count, batch=1000):
    """Refusals and samples of so many malformed messages, with a sound one in every batch."""
    rng = random.Random(3)

    def batches():
        for i in range(count // batch):
            good = json.dumps({**GOOD, "t": i * 0.01}).encode()
            yield [*(malformed(rng) for _ in range(batch)), good]

    source = MessageSource(Given(batches()), PAPER, 8)
    buffer, most = Buffer(), []
    for i in range(count // batch):
        received = source.receive(0.0)
        assert received.refused == batch
        assert received.why.count("\n") == 0
        assert len(received.why) < 500
        buffer = buffer.with_arrivals(received.arrivals, {}).refused(received.refused)
        buffer = buffer.since({"tracker": i * 0.01 - 1.0})
        most.append(memory())
    return buffer, most


def test_what_is_malformed_is_counted_and_what_is_sound_is_taken():
    buffer, _ = refuse(20_000)
    assert buffer.counts.refused == 20_000
    assert buffer.counts.taken == 20


@pytest.mark.slow
@pytest.mark.long
def test_a_million_of_them_take_no_memory():
    buffer, most = refuse(1_000_000)
    assert buffer.counts.refused == 1_000_000
    assert buffer.counts.taken == 1000
    assert most[-1] - most[len(most) // 20] < 5.0


def test_ten_megabytes_of_nesting_are_refused():
    source = MessageSource(Given([DEEP]), PAPER, 8)
    received = source.receive(0.0)
    assert received.refused == len(DEEP)
    assert not received.arrivals


def test_floods_of_datagrams_end_in_refusals():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    source = MessageSource(UdpTransport(f"udp://127.0.0.1:{port}"), PAPER, 8)
    rng, refused = random.Random(1), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for _ in range(20):
            for _ in range(50):
                out.sendto(malformed(rng), ("127.0.0.1", port))
            out.sendto(b"[" * 60_000, ("127.0.0.1", port))
            end = time.monotonic() + 30.0
            before = refused
            while refused - before < 51 and time.monotonic() < end:
                refused += source.receive(0.01).refused
    source.close()
    assert refused == 20 * 51


def test_numbers_at_the_edges_never_reach_a_stream():
    rng = np.random.default_rng(0)
    source = MessageSource(
        Given([[json.dumps({**GOOD, "x": 10.0 ** float(e)}).encode() for e in rng.uniform(-320, 308, 500)]]), PAPER, 8
    )  # fmt: skip
    received = source.receive(0.0)
    values = np.concatenate([each.stream.values["position"] for each in received.arrivals])
    assert np.isfinite(values).all()
    assert np.abs(values).max() <= 1e15
    assert len(received.arrivals) + received.refused == 500


def test_a_source_says_what_was_wrong_once():
    source = MessageSource(Given([[b"x"]]), PAPER, 8)
    assert "expected JSON" in source.receive(0.0).why
    with pytest.raises(InputError):
        UdpTransport("udp://203.0.113.1:9")
