"""The rows of a campaign in a table of PostgreSQL, by ADBC: the same ones, however often they are
written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from steelyard.campaigns.rows import columns
from steelyard.errors import InputError

if TYPE_CHECKING:
    import polars as pl

DEFAULT_TABLE = "campaign"
_SCHEMES = ("postgresql", "postgres")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,62}(\.[A-Za-z_][A-Za-z0-9_]{0,62})?")
_PATIENCE = 10
"""How long a server may take to answer [s], where the URL says nothing of it."""
_FRESH = "steelyard_fresh_rows"
"""Name of the temporary table in which rows arrive."""


@dataclass(frozen=True)
class DatabaseTable:
    """A table of a database."""

    url: str
    """For libpq; may have a password, which is shown nowhere."""
    name: str
    """Of the table, with its schema where that is named."""
    shown: str
    """The URL without a password."""

    @classmethod
    def of(cls, url: str) -> DatabaseTable:
        """Read ``postgresql://USER@HOST:PORT/DATABASE#TABLE``.

        Raises:
            InputError: It is not of this form, or the driver is not installed.
        """
        try:
            parts = urlsplit(url)
            host, _ = parts.hostname, parts.port
        except ValueError:
            parts, host = urlsplit(""), None
        name = parts.fragment or DEFAULT_TABLE
        if parts.scheme not in _SCHEMES or not _NAME.fullmatch(name):
            # The text itself may have a password.
            raise InputError(
                "--table: expected postgresql://USER@HOST:PORT/DATABASE, with #TABLE behind it"
                f" where it is not '{DEFAULT_TABLE}', found something else; correct the URL"
            )
        if find_spec("adbc_driver_postgresql") is None:
            raise InputError(
                "--table: expected the package adbc-driver-postgresql, found it missing; install it"
                ' with: pip install "steelyard[database]"'
            )
        port = f":{parts.port}" if parts.port else ""
        shown = f"{parts.scheme}://{host or ''}{port}{parts.path}#{name}"
        query = parts.query
        if "connect_timeout" not in query:
            query = "&".join(filter(None, (query, f"connect_timeout={_PATIENCE}")))
        return cls(parts._replace(fragment="", query=query).geturl(), name, shown)

    def check(self) -> None:
        """Make the table where it is not there, and see whether it can be written to.

        Raises:
            InputError: It cannot.
        """
        with self._cursor() as cursor:
            self._prepare(cursor)

    def write(self, table: pl.DataFrame) -> None:
        """Rows of these experiments in place of all that the table has of them, at once; those of
        others stay.

        Raises:
            InputError: The server refuses, or the table has an experiment of one of these names
                from another path.
        """
        if table.is_empty():
            return
        names = _names()
        with self._cursor() as cursor:
            self._prepare(cursor)
            cursor.adbc_ingest(_FRESH, table, mode="create", temporary=True)
            cursor.execute(
                f"SELECT old.experiment FROM {self._quoted} old JOIN {_FRESH} fresh"
                " ON old.experiment = fresh.experiment AND old.path <> fresh.path LIMIT 1"
            )
            other = cursor.fetch_polars()
            if len(other):
                raise InputError(
                    f"--table: expected a table without other experiments of these names, found"
                    f" '{other.item(0, 0)}' of another path in {self.shown}; name another table"
                    " behind #"
                )
            cursor.execute(
                f"DELETE FROM {self._quoted} WHERE experiment IN (SELECT experiment FROM {_FRESH})"
            )
            cursor.execute(f"INSERT INTO {self._quoted} ({names}) SELECT {names} FROM {_FRESH}")
            cursor.execute(f"DROP TABLE {_FRESH}")

    @property
    def _quoted(self) -> str:
        return ".".join(f'"{part}"' for part in self.name.split("."))

    def _prepare(self, cursor: Any) -> None:
        """The table, made where it is not there, and locked: two campaigns write one after the
        other.

        One that an administrator has made needs no right to make tables.
        """
        import polars as pl

        kinds = {pl.String: "text", pl.Float64: "double precision", pl.Boolean: "boolean"}
        stated = [
            f'"{name}" {kinds.get(kind, "double precision[]")}' for name, kind in columns().items()
        ]
        cursor.execute(f"SELECT to_regclass('{self._quoted}') IS NOT NULL")
        if not cursor.fetch_polars().item():
            cursor.execute(
                f"CREATE TABLE {self._quoted} ({', '.join(stated)}, PRIMARY KEY (experiment,"
                " method))"
            )
        cursor.execute(f"SELECT {_names()} FROM {self._quoted} LIMIT 0")
        cursor.execute(f"LOCK TABLE {self._quoted} IN SHARE ROW EXCLUSIVE MODE")

    @contextmanager
    def _cursor(self) -> Iterator[Any]:
        """Within one transaction: all of it is done, or nothing.

        Raises:
            InputError: Whatever the server, or the way to it, says.
        """
        import adbc_driver_manager
        from adbc_driver_postgresql import dbapi

        try:
            with dbapi.connect(self.url) as connection, connection.cursor() as cursor:
                yield cursor
                connection.commit()
        except adbc_driver_manager.Error as error:
            raise InputError(
                f"--table: expected a table that can be written to, found {self.shown} where that"
                f" failed ({_said(error)}); check the address, the rights and the columns"
            ) from error


def _names() -> str:
    """Columns as SQL has them."""
    return ", ".join(f'"{name}"' for name in columns())


def _said(error: Exception) -> str:
    """What the server says, in one line, without the query."""
    text = " ".join(str(error).split())
    if "percent-encoded" in text:
        # It quotes what may be a password.
        return "a % in the URL that is not written as %25"
    text = re.split(r"ERROR: |FATAL: |\[libpq\] ", text)[-1]
    return re.split(r"\.? (?:SQLSTATE|LINE \d|DETAIL:|HINT:)", text)[0].rstrip(".?")
