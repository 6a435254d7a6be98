"""Files that something has changed: bits, bytes, lengths, parts, numbers and lines."""

import re

TOKENS = (
    b"\x00", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x00\x00\x00\x80", b"nan", b"inf", b"-1e308",
    b"1e-320", b"99999999999999999999", b'"', b"'", b",", b";", b"\n", b"\r", b"\t", b"[", b"{", b"}", b"]",
    b"&a", b"*a", b"!!python/object:os.system", b"<!DOCTYPE a>", b"<![CDATA[", b"&#0;", b"\xef\xbb\xbf",
    b"\xff\xfe", b"\x1b[2J", b"\xe2\x80\xae", b"../../../etc/passwd", b"null", b"true", b"? ", b"- ", b": ",
    b"sequence<", b"string<=99999999>", b"float64[4294967295] a\n", b"%n%s", b"\\u0000", b"\\ud800", b"<<: *a",
)  # fmt: skip
"""What readers of one format or another may trip over."""
NUMBERS = (
    b"0", b"-0", b"-1", b"1e999", b"1e308", b"-1e308", b"5e-324", b"1e30", b"4294967296", b"-2147483649",
    b"9" * 400, b"NaN", b".inf", b"null", b"1e-9", b"'1'", b"[]", b"{}", b"[0, 0, 0]", b"",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
LARGEST = 1 << 20
"""Bytes of a changed file beyond those of the sound one."""


def mutated(rng, content, others=()):
    """A file with one to five changes.

    Args:
        rng: A :class:`random.Random`.
        content: Bytes of a sound file.
        others: Further ones, of which parts may be taken.
    """
    limit = len(content) + LARGEST
    for _ in range(rng.choice((1, 1, 2, 3, 5))):
        content = rng.choice(CHANGES)(rng, content or b"\n", others)[:limit]
    return content


def _part(rng, content, longest=4096):
    start = rng.randrange(len(content))
    return start, min(len(content), start + 1 + int(longest ** rng.random()))


def _bits(rng, content, _others):
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 8))):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _bytes(rng, content, _others):
    start, end = _part(rng, content, 16)
    return content[:start] + rng.randbytes(end - start) + content[end:]


def _cut(rng, content, _others):
    return content[: rng.randrange(len(content))]


def _removed(rng, content, _others):
    start, end = _part(rng, content)
    return content[:start] + content[end:]


def _repeated(rng, content, _others):
    start, end = _part(rng, content)
    times = rng.choice((2, 2, 3, 100, 10_000))
    return content[:start] + content[start:end] * min(times, 1 + LARGEST // (end - start))


def _doubled(rng, content, _others):
    start, end = _part(rng, content)
    return content[:end] + content[start:]


def _token(rng, content, _others):
    place = rng.randrange(len(content) + 1)
    return content[:place] + rng.choice(TOKENS) * rng.choice((1, 1, 1, 2, 1000)) + content[place:]


def _length(rng, content, _others):
    """A number of four or eight bytes that may be a length or a place."""
    size = rng.choice((2, 4, 8))
    place = rng.randrange(max(1, len(content) - size))
    value = rng.choice((0, 1, 2, 255, 1 << 16, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 62))
    order = rng.choice(("little", "big"))
    value %= 1 << (8 * size)
    return content[:place] + value.to_bytes(size, order) + content[place + size :]


def _spliced(rng, content, others):
    other = rng.choice(others) if others else content
    return content[: rng.randrange(len(content))] + other[rng.randrange(len(other)) :]


def _number(rng, content, _others):
    found = [*_NUMBER.finditer(content[: 1 << 17])]
    if not found:
        return _token(rng, content, ())
    one = rng.choice(found)
    return content[: one.start()] + rng.choice(NUMBERS) + content[one.end() :]


def _lines(rng, content, _others):
    lines = content.splitlines(keepends=True)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(4)
    if what == 0:
        del lines[min(i, j) : min(i, j) + rng.choice((1, 1, 3))]
    elif what == 1:
        lines[i], lines[j] = lines[j], lines[i]
    elif what == 2:
        lines.insert(i, lines[j])
    else:
        lines[i:i] = [lines[i]] * rng.choice((1, 10, 1000))
    return b"".join(lines)


CHANGES = (
    _bits, _bits, _bytes, _cut, _removed, _repeated, _doubled, _token, _length, _length, _spliced, _number,
    _number, _lines,
)  # fmt: skip
