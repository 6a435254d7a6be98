"""The page of `watch`: who may read it, and how it looks in a browser."""

import http.client
import json
import threading

import numpy as np
import pytest
from browser import browser, look, screenshot, until

from steelyard.errors import InputError
from steelyard.inertia import BODY_PARAMETERS
from steelyard.live.record import Record
from steelyard.live.sinks.page import _MOST_CLIENTS, History, PageSink
from steelyard.report.forms.live_page import live_page

PAGE = live_page("arm <b>1</b>")


def record(i, **changes):
    value = np.array([20.0, 0.01, -0.02, 0.3, 2.0, 2.5, 1.5, 0.1, -0.05, 0.02])
    sigma = np.full(len(BODY_PARAMETERS), 0.05) / np.sqrt(1 + i)
    wave = 0.5 * sigma * np.sin(0.3 * i + np.arange(10))
    given = {"accepted": None if i < 10 else True, "unmodelled": np.sin(i / 5 + np.arange(6.0))}
    given |= changes
    untold = np.arange(10) == 9
    value, sigma = (np.where(untold, np.nan, each) for each in (value + wave, sigma))
    return Record(0.5 * i, "tool", value, sigma, **given)


@pytest.fixture
def sink():
    made = PageSink(PAGE.html, PAGE.policy, 0)
    yield made
    made.close()


@pytest.fixture
def guarded():
    made = PageSink(PAGE.html, PAGE.policy, 0, "0.0.0.0")
    yield made
    made.close()


def port_of(sink):
    return int(sink.url.split("/")[2].rpartition(":")[2])


def asked(sink, path="/", method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port_of(sink), timeout=30)
    connection.request(method, path, headers={k.replace("_", "-"): v for k, v in headers.items()})
    answer = connection.getresponse()
    if answer.getheader("Content-Type") == "text/event-stream":
        return connection, answer
    body = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), body


def test_a_page_that_needs_nothing_but_itself(sink):
    status, headers, body = asked(sink)
    assert status == 200
    text = body.decode()
    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "arm &lt;b&gt;1&lt;/b&gt;" in text
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Cache-Control"] == "no-store"
    assert sink.token is None


def test_estimates_come_as_they_are_made(sink):
    for i in range(3):
        sink.send(record(i))
    connection, answer = asked(sink, "/events")
    assert answer.readline() == b"event: estimates\n"
    first = json.loads(answer.readline().removeprefix(b"data: "))
    assert [each["t"] for each in first] == [0.0, 0.5, 1.0]
    answer.readline()
    sink.send(record(3))
    assert answer.readline() == b"event: estimates\n"
    (new,) = json.loads(answer.readline().removeprefix(b"data: "))
    assert new == record(3).to_dict()
    connection.close()


@pytest.mark.parametrize(
    ("headers", "path", "status"),
    [
        ({"Host": "evil.example"}, "/", 421),
        ({"Host": "127.0.0.1.evil.example:80"}, "/events", 421),
        ({"Host": ""}, "/", 421),
        ({"Host": "192.168.1.7"}, "/", 421),
        ({"Host": "localhost:9000"}, "/", 200),
        ({"Host": "[::1]:9000"}, "/", 200),
        ({"Sec_Fetch_Site": "cross-site"}, "/events", 403),
        ({}, "/../../etc/passwd", 404),
        ({}, "/favicon.ico", 404),
    ],
)
def test_only_a_browser_that_means_this_machine_is_answered(sink, headers, path, status):
    assert asked(sink, path, **headers)[0] == status


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE"])
def test_nothing_can_be_done_but_read(sink, method):
    assert asked(sink, method=method)[0] == 501


def test_from_elsewhere_a_token_is_needed(guarded):
    token = guarded.token
    assert len(token) >= 32
    assert guarded.url.endswith(f"/?token={token}")
    for path in (
        "/",
        "/events",
        "/?token=",
        "/?token=wrong",
        "/?token=%C3%A9",
        f"/events?token={token}",
    ):
        assert asked(guarded, path)[0] == 401
    assert asked(guarded, Cookie="steelyard=wrong; other")[0] == 401
    status, headers, body = asked(guarded, f"/?token={token}")
    # The token leaves the address bar at once.
    assert (status, headers["Location"], body) == (303, "/", b"")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert asked(guarded, Cookie=f"a=b; {cookie.partition(';')[0]}")[0] == 200
    assert asked(guarded, Cookie=cookie.partition(";")[0], Host="evil.example")[0] == 421
    assert asked(guarded, Cookie=cookie.partition(";")[0], Host="192.168.1.7:80")[0] == 200


def test_no_address_is_written_anywhere(guarded, capfd):
    asked(guarded, f"/?token={guarded.token}")
    assert capfd.readouterr() == ("", "")


def test_so_many_clients_and_no_more(sink):
    sink.send(record(0))
    held = [asked(sink, "/events") for _ in range(_MOST_CLIENTS)]
    assert asked(sink, "/events")[0] == 503
    assert asked(sink)[0] == 200
    for connection, answer in held:
        answer.close()
        connection.close()


def test_the_end_lets_everyone_go():
    sink = PageSink(PAGE.html, PAGE.policy, 0)
    _, answer = asked(sink, "/events")
    thread = threading.Thread(target=sink.close)
    thread.start()
    assert b"event: end" in answer.read()
    thread.join(30)
    assert not thread.is_alive()


def test_what_is_kept_is_bounded_and_the_newest_is_whole():
    history = History(100)
    for i in range(10_000):
        history.add(str(i))
    number, lines = history.after(0, 0.0)
    assert number == 10_000
    assert len(lines) <= 100
    assert lines[-25:] == [str(i) for i in range(9975, 10_000)]
    assert int(lines[0]) < 100
    assert history.after(number - 2, 0.0)[1] == ["9998", "9999"]


def test_a_port_that_is_taken_is_refused(sink):
    with pytest.raises(InputError, match="choose another"):
        PageSink(PAGE.html, PAGE.policy, port_of(sink))


@pytest.mark.browser
def test_it_shows_what_is_known(tmp_path):
    for_page = PageSink(PAGE.html, PAGE.policy, 0)
    change = {"t": 20.0, "kind": "load", "load": "tool + 1", "mass": 5.0, "sigma_mass": 0.1}
    for i in range(60):
        for_page.send(record(i, events=(change,) if i == 40 else ()))
    with browser() as driver:
        for scheme, width in (("light", 400), ("dark", 1400), ("light", 1400)):
            look(driver, width=width, scheme=scheme)
            driver.get("about:blank")
            driver.get_log("browser"), driver.get_log("performance")
            driver.get(for_page.url)
            until(driver, "return document.body.dataset.shown === '60'")
            screenshot(driver, tmp_path / f"live-{scheme}-{width}.png")
            wide, window = driver.execute_script(
                "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
            )
            assert wide <= window
            text = driver.execute_script("return document.body.innerText")
            assert "accepted" in text
            assert "20.0 s, load, tool + 1, +5.00 ± 0.10 kg" in text
            assert "not told yet" in text
            assert driver.execute_script("return document.querySelectorAll('.line').length") == 15
            assert (
                driver.execute_script("return document.querySelectorAll('.event').length") == 16 - 1
            )
            quiet = [e for e in driver.get_log("browser") if e["level"] in {"SEVERE", "WARNING"}]
            assert not quiet, quiet
        for_page.send(record(60, accepted=False, reasons=("<img src=x onerror=alert(1)>",)))
        until(driver, "return document.body.dataset.shown === '61'")
        assert "not accepted" in driver.execute_script("return document.body.innerText")
        assert not driver.execute_script("return document.querySelectorAll('img').length")
        for_page.close()
        until(driver, "return document.getElementById('connection').textContent === 'ended'")
