"""Types of ROS messages from definitions in IDL, in one pass over their words.

Parsers that try one alternative after the other take twice as long for every level of a nested
sequence. Of the language of [OMGIDL]_ this knows what ROS writes: modules, structures, names of
types, constants, enumerations, annotations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

_WORD = re.compile(
    r"""(?P<blank> \s+ | //[^\n]* | /\*.*?\*/ | ^\#[^\n]* )
      | (?P<text> "(?:\\.|[^"\\])*" | '(?:\\.|[^'\\])*' )
      | (?P<name> [A-Za-z_]\w* )
      | (?P<number> [-+]? (?: 0[xX][0-9a-fA-F]+ | (?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)? ) [fFdDlL]? )
      | (?P<sign> :: | << | >> | . )""",
    re.VERBOSE | re.DOTALL | re.MULTILINE | re.ASCII,
)
_DEEPEST = 20
"""Modules and names of types within each other; ROS has two."""
_LONGEST_NUMBER = 20
"""Characters."""
_BASES = {
    "boolean": "bool",
    "octet": "byte",
    "char": "char",
    "wchar": "wchar",
    "string": "string",
    "wstring": "wstring",
    "float": "float32",
    "double": "float64",
    "long double": "float128",
    "short": "int16",
    "long": "int32",
    "long long": "int64",
    "unsigned short": "uint16",
    "unsigned long": "uint32",
    "unsigned long long": "uint64",
    **{f"{sign}int{bits}": f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
"""Kinds of fields, in ``rosbags.interfaces.Nodetype``."""


class _Type(NamedTuple):
    """What a field is made of."""

    name: str
    is_base: bool
    longest: int = 0
    """Of a text."""
    many: int = 0
    """``_ARRAY``, ``_SEQUENCE``; 0: one."""
    size: int = 0


class _Struct(NamedTuple):
    scope: tuple[str, ...]
    fields: list[tuple[str, _Type]]


def types_in_idl(text: str) -> dict[str, list[tuple[str, Any]]]:
    """Types that a definition states.

    Args:
        text: The definition of one file.

    Returns:
        Type -> its fields: names and descriptions as ``rosbags.interfaces.typing.FieldDesc`` has
        them.

    Raises:
        ValueError: It is no IDL, or has more of it than messages of ROS do: expressions to
            evaluate, lists of lists, unions.
    """
    parser = _Parser(text)
    parser.definitions(())
    return {
        name: [
            (field, _described(parser.resolved(kind, each.scope))) for field, kind in each.fields
        ]
        for name, each in parser.structs.items()
    }


def _described(kind: _Type) -> Any:
    inner = (_BASE, (kind.name, kind.longest)) if kind.is_base else (_NAME, kind.name)
    return (kind.many, (inner, kind.size)) if kind.many else inner


def _words(text: str) -> Iterator[tuple[str, str]]:
    """Words with their kinds."""
    for match in _WORD.finditer(text):
        if match.lastgroup not in (None, "blank"):
            yield str(match.lastgroup), match[0]
    yield "end", "its end"


class _Parser:
    """Goes once through the words of a definition; every step takes at least one of them."""

    def __init__(self, text: str) -> None:
        self._rest = _words(text)
        self.kind, self.word = next(self._rest)
        self.structs: dict[str, _Struct] = {}
        self._names: dict[str, tuple[tuple[str, ...], _Type]] = {}
        self._constants: dict[str, int] = {}
        self._own_names: dict[str, str] = {}
        self._scope: tuple[str, ...] = ()

    def _next(self) -> str:
        """Take the word."""
        word = self.word
        if self.kind == "end":
            raise ValueError("a definition that is cut off")
        self.kind, self.word = next(self._rest)
        return word

    def _take(self, word: str) -> None:
        if self.word != word or self.kind == "text":
            raise ValueError(f"{self.word[:40]!r} in place of {word!r}")
        self._next()

    def _takes(self, word: str) -> bool:
        """Take a word if it comes now."""
        if self.word != word or self.kind == "text":
            return False
        self._next()
        return True

    def _name(self) -> str:
        if self.kind != "name":
            raise ValueError(f"{self.word[:40]!r} in place of a name")
        return self._next()

    def _annotations(self) -> None:
        while self._takes("@"):
            self._scoped_name()
            if not self._takes("("):
                continue
            level = 1
            while level:
                level += {"(": 1, ")": -1}.get(self.word if self.kind == "sign" else "", 0)
                self._next()

    def definitions(self, scope: tuple[str, ...]) -> None:
        """Definitions up to the end of a module, or of the whole."""
        if len(scope) > _DEEPEST:
            raise ValueError(f"more than {_DEEPEST} modules in each other")
        while True:
            self._scope = scope
            self._annotations()
            if (self.word == "}" and scope) or (self.kind == "end" and not scope):
                return
            what = self._name()
            if what == "module":
                inner = (*scope, self._name())
                self._take("{")
                self.definitions(inner)
                self._take("}")
            elif what == "struct":
                self._struct(scope)
            elif what == "typedef":
                kind = self._type()
                for name, declared in self._declared(kind):
                    self._names["/".join((*scope, name))] = scope, declared
            elif what == "const":
                self._constant(scope)
            elif what == "enum":
                self._enumeration()
            else:
                raise ValueError(f"'{what[:40]}', which is not known in messages")
            self._take(";")

    def _struct(self, scope: tuple[str, ...]) -> None:
        name = self._name()
        fields: list[tuple[str, _Type]] = []
        self._take("{")
        while not self._takes("}"):
            self._annotations()
            fields += self._declared(self._type())
            self._take(";")
        full = "/".join((*scope, name))
        self.structs[full], self._own_names[full] = _Struct(scope, fields), full

    def _constant(self, scope: tuple[str, ...]) -> None:
        """A constant: whole numbers are kept, since they may be sizes of lists."""
        self._type()
        name = self._name()
        self._take("=")
        if self.kind == "text":
            while self.kind == "text":
                self._next()
        elif self.kind == "number":
            self._constants["/".join((*scope, name))] = _whole(self._next())
        else:
            negative = self._takes("-")
            if self.kind != "name" or negative:
                raise ValueError("expressions to evaluate")
            value = _found(self._constants, self._scoped_name(), scope)
            if value is not None:
                self._constants["/".join((*scope, name))] = value
        if self.word != ";":
            raise ValueError("expressions to evaluate")

    def _enumeration(self) -> None:
        """An enumeration: its names are no types of messages."""
        self._name()
        self._take("{")
        while not self._takes("}"):
            self._next()

    def _declared(self, kind: _Type) -> list[tuple[str, _Type]]:
        """Names behind a type, with their arrays."""
        found = []
        while True:
            self._annotations()
            name, declared = self._name(), kind
            if self._takes("["):
                if kind.many:
                    raise ValueError("an array of lists")
                declared = kind._replace(many=_ARRAY, size=self._size())
                self._take("]")
                if self.word == "[":
                    raise ValueError("an array of arrays")
            found.append((name, declared))
            if not self._takes(","):
                return found

    def _type(self) -> _Type:
        """A type; the one of a sequence has no sequence in it."""
        if self.word != "sequence":
            return self._single()
        self._next()
        self._take("<")
        if self.word == "sequence":
            raise ValueError("a sequence of sequences")
        inner = self._single()
        size = self._size() if self._takes(",") else 0
        self._close()
        return inner._replace(many=_SEQUENCE, size=size)

    def _single(self) -> _Type:
        """A type that is no list: one of the language, or a name."""
        if self.word == "::":
            return _Type(self._scoped_name(), False)
        name = self._name()
        while name in ("unsigned", "long", "unsigned long") and self.word in (
            "short",
            "long",
            "double",
        ):
            name = f"{name} {self._next()}"
        if name not in _BASES:
            return _Type(self._scoped_name(name), False)
        longest = 0
        if name in ("string", "wstring") and self._takes("<"):
            longest = self._size()
            self._close()
        return _Type(_BASES[name], True, longest)

    def _close(self) -> None:
        """The bracket that ends a type, also the first of two."""
        if self.word == ">>":
            self.word = ">"
        else:
            self._take(">")

    def _scoped_name(self, first: str | None = None) -> str:
        """``a::b::c`` as ``a/b/c``; with a stroke before it: from the top."""
        parts = [first if first is not None else "" if self.word == "::" else self._name()]
        while self._takes("::"):
            parts.append(self._name())
        return "/".join(parts)

    def _size(self) -> int:
        """The size of a list: a number, or a constant."""
        size = _whole(self._next()) if self.kind == "number" else None
        if size is None:
            size = _found(self._constants, self._scoped_name(), self._scope)
        if size is None or size < 1 or self.word not in ("]", ">", ">>"):
            raise ValueError("expressions to evaluate, or a size that is no number")
        return size

    def resolved(self, kind: _Type, scope: tuple[str, ...]) -> _Type:
        """A type as it stands behind names of types."""
        for _ in range(_DEEPEST):
            if kind.is_base:
                return kind
            found = _found(self._names, kind.name, scope)
            if found is None:
                inner = _found(self._own_names, kind.name, scope)
                alone = "/".join((*scope, kind.name)) if "/" not in kind.name else kind.name
                return kind._replace(name=inner or alone.lstrip("/"))
            scope, behind = found
            if kind.many and behind.many:
                raise ValueError("an array of arrays")
            kind = behind if not kind.many else behind._replace(many=kind.many, size=kind.size)
        raise ValueError("a name of a type that stands for itself")


def _found(known: Mapping[str, Any], name: str, scope: tuple[str, ...]) -> Any:
    """What a name means, from the innermost module outwards; None: nothing."""
    if name.startswith("/"):
        return known.get(name[1:])
    for level in range(len(scope), -1, -1):
        found = known.get("/".join((*scope[:level], name)))
        if found is not None:
            return found
    return None


def _whole(word: str) -> int:
    """A whole number; -1 for one that is not whole, which is no size."""
    if len(word) > _LONGEST_NUMBER:
        raise ValueError("a number of too many digits")
    bare = word.lstrip("+-").lower()
    base = 16 if bare.startswith("0x") else 8 if bare.startswith("0") and bare != "0" else 10
    try:
        return int(word, base)
    except ValueError:
        return -1
