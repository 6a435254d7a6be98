"""Rows of a campaign in a real PostgreSQL."""

from zlib import crc32

import polars as pl
import pytest
from campaign_work import here
from postgres import programs, server
from recordings import write_small

from steelyard.campaigns.database import DatabaseTable
from steelyard.campaigns.rows import TABLE, columns, frame
from steelyard.campaigns.run import campaign
from steelyard.errors import InputError

pytestmark = pytest.mark.integration
SECRET = "xk7secret"


@pytest.fixture(scope="module")
def base():
    pytest.importorskip("adbc_driver_postgresql")
    if programs() is None:
        pytest.skip("PostgreSQL is not installed: apt-get install postgresql")
    with server() as url:
        yield url


@pytest.fixture
def url(base, request):
    """A table of its own for each test."""
    return f"{base}/postgres#t{crc32(request.node.name.encode())}"


def asked(url, query):
    from adbc_driver_postgresql import dbapi

    with dbapi.connect(url.partition("#")[0]) as connection, connection.cursor() as cursor:
        cursor.execute(query)
        found = cursor.fetch_polars() if query.startswith("SELECT") else None
        connection.commit()
    return found


def there(url):
    names = ", ".join(f'"{name}"' for name in columns())
    query = f"SELECT {names} FROM {url.partition('#')[2]} ORDER BY experiment, method"
    return asked(url, query)


def row(name, method="two-step", path="/data", **keys):
    about = {"status": "done", "asked": "default", "mass": 1.5, "accepted": True}
    return {"experiment": name, "method": method, "path": path, **about, **keys}


def test_rows_of_a_campaign_are_those_of_its_table_however_often_they_are_written(url, tmp_path):
    write_small(tmp_path / "data" / "a")
    keys = {"engine": here, "table": url}
    campaign(tmp_path / "data", tmp_path / "out", "two-step", **keys)
    table = pl.read_parquet(tmp_path / "out" / TABLE)
    assert there(url).equals(table)
    again = campaign(tmp_path / "data", tmp_path / "out", "two-step", **keys)
    assert again.unchanged == 1
    assert there(url).equals(table)


def test_nulls_lists_and_letters_come_back(url):
    table = frame([row("a", covariance=[1.0, None, -0.1], reason="nö; 'x' \"y\"", mass=None)])
    DatabaseTable.of(url).write(table)
    assert there(url).equals(table)


def test_rows_of_others_stay_and_what_an_experiment_has_no_longer_goes(url):
    target = DatabaseTable.of(url)
    target.write(frame([row("a"), row("b")]))
    target.write(frame([row("a", "consistent")]))
    found = there(url).select("experiment", "method").rows()
    assert found == [("a", "consistent"), ("b", "two-step")]
    target.write(frame([]))
    assert len(there(url)) == 2


def test_an_experiment_of_the_same_name_from_elsewhere_is_not_overwritten(url):
    target = DatabaseTable.of(url)
    target.write(frame([row("a")]))
    with pytest.raises(InputError, match=r"found 'a' of another path in postgresql://127"):
        target.write(frame([row("a", path="/other", mass=7.0), row("b")]))
    assert there(url).select("experiment", "mass").rows() == [("a", 1.5)]


def test_who_may_only_write_needs_no_right_to_make_tables(url):
    target = DatabaseTable.of(url)
    target.check()
    name = url.partition("#")[2]
    asked(url, f"CREATE ROLE writer_{name} LOGIN")
    writer = url.replace("steelyard@", f"writer_{name}@")
    with pytest.raises(InputError, match=f"permission denied for table {name}"):
        DatabaseTable.of(writer).check()
    asked(url, f"GRANT SELECT, INSERT, UPDATE, DELETE ON {name} TO writer_{name}")
    DatabaseTable.of(writer).write(frame([row("a")]))
    assert len(there(url)) == 1


def one_sentence(error):
    text = str(error.value)
    assert "\n" not in text
    assert SECRET not in text
    return text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda u: u.replace("steelyard@", f"nobody:{SECRET}@"), 'role "nobody" does not exist'),
        (lambda u: u.replace("/postgres", "/none"), 'database "none" does not exist'),
        (lambda u: f"postgresql://me:{SECRET}@127.0.0.1:1/x", "Connection refused"),
        (lambda u: f"postgresql://me:{SECRET}%@127.0.0.1:1/x", "not written as %25"),
        (lambda u: u.partition("#")[0] + "#none.rows", 'schema "none" does not exist'),
        (lambda u: u.partition("#")[0] + "#pg_roles", "column"),
    ],
)
def test_what_the_server_refuses_is_one_sentence_before_anything_is_done(
    base, change, said, tmp_path
):
    write_small(tmp_path / "data" / "a")
    wrong = change(f"{base}/postgres")
    with pytest.raises(InputError, match="table: expected a table that can be") as error:
        campaign(tmp_path / "data", tmp_path / "out", "two-step", engine=here, table=wrong)
    assert said in one_sentence(error)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "wrong",
    [f"mysql://me:{SECRET}@host/db", f"{SECRET}", "postgresql://h:port/x", "postgresql://h/x#a-b"],
)
def test_other_urls_are_one_sentence(wrong):
    with pytest.raises(InputError, match="table: expected postgresql://USER@HOST") as error:
        DatabaseTable.of(wrong)
    one_sentence(error)


def test_without_the_driver_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("steelyard.campaigns.database.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"steelyard\[database\]"):
        DatabaseTable.of("postgresql://h/x")
