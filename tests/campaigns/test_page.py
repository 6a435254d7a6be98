"""The page of a campaign says what its table says, and nothing that the table does not tell."""

import re
from html import unescape
from urllib.parse import unquote

import numpy as np
import pytest
from drawn_estimates import series

from steelyard.campaigns.charts.series import series_of
from steelyard.campaigns.page import campaign_document, write_page
from steelyard.campaigns.rows import frame
from steelyard.inertia import BODY_PARAMETERS
from steelyard.report.forms.markdown import markdown

BODY = np.array([160, 0, -0.08, -0.12, 95, 89, 32, 4, 0, 0])


def rows(n, seed, *, added=None, dated=True, **keys):
    values, sigmas = series(n, seed, added)
    for i in range(n):
        yield {
            "experiment": f"run-{i:03}", "method": "consistent", "status": "done", "asked": "default",
            "accepted": True, "seconds": float(i), "recorded": 1.7e9 - 3600 * i if dated else None,
            **dict(zip(BODY_PARAMETERS, (values[i] + BODY).tolist(), strict=True)),
            **dict(zip([f"sigma_{p}" for p in BODY_PARAMETERS], sigmas[i].tolist(), strict=True)),
            **keys,
        }  # fmt: skip


def test_a_change_is_the_first_thing_that_is_said():
    document = campaign_document(frame(rows(30, 1, added=20, dated=False)))
    assert re.search(
        r"the body has changed: mass by \+\d\.\d+ ± 0\.\d+ kg since run-02", document.lead.text
    )
    assert document.lead.tone == "bad"
    assert campaign_document(frame(rows(30, 1))).lead.tone == "good"


def test_recordings_stand_in_the_order_of_their_times_or_names():
    dated = series_of(frame(rows(5, 1)))
    assert dated.names == tuple(f"run-{i:03}" for i in (4, 3, 2, 1, 0))
    table = [*rows(5, 1)]
    table[2]["recorded"] = None
    by_name = series_of(frame(table))
    assert by_name.names == tuple(sorted(dated.names))
    assert by_name.times is None
    assert "the order of their names" in markdown(campaign_document(frame(table)))


def test_rejected_estimates_are_left_out_and_counted():
    table = [*rows(6, 1), *rows(3, 2, accepted=False)]
    for i, row in enumerate(table[6:]):
        row["experiment"] = f"wrong-{i}"
    found = series_of(frame(table))
    assert (len(found.names), found.rejected) == (6, 3)
    assert "3 that were not accepted are left out" in markdown(campaign_document(frame(table)))


@pytest.mark.parametrize("count", [0, 1])
def test_few_estimates_are_not_compared(count):
    text = markdown(campaign_document(frame(rows(count, 1))))
    assert "CUSUM" not in text


def test_parameters_without_numbers_have_no_picture():
    table = [{**row, "Jyz": None, "sigma_Jyz": None} for row in rows(5, 1)]
    document = campaign_document(frame(table))
    text = markdown(document)
    assert "| inertia yz | 0 | - | - | - | - |" in text
    assert "Picture: inertia yz" not in text


def test_too_much_scatter_is_said():
    table = [
        {**row, **{f"sigma_{p}": row[f"sigma_{p}"] / 2 for p in BODY_PARAMETERS}}
        for row in rows(80, 5)
    ]
    text = markdown(campaign_document(frame(table)))
    assert "larger than stated" in text
    assert "less certain than they state" in text


def test_the_page_is_the_same_again_and_leads_to_files(tmp_path):
    name = 'odd "<b>" & é'
    table = frame({**row, "experiment": f"{name}{i}"} for i, row in enumerate(rows(4, 1)))
    place = tmp_path / "default" / f"{name}0"
    place.mkdir(parents=True)
    (place / "estimate.json").touch()
    write_page(table, tmp_path)
    first = (tmp_path / "campaign.html").read_bytes()
    write_page(table, tmp_path)
    assert (tmp_path / "campaign.html").read_bytes() == first
    text = first.decode()
    (target,) = re.findall(r'<a href="(default[^"]*)"', text)
    assert (tmp_path / unquote(unescape(target))).is_file()
    assert "<b>" not in text.partition("<script")[0]
    assert str(tmp_path) not in text


def test_a_long_campaign_lists_what_needs_a_look():
    table = [*rows(1100, 1)]
    table[1050] = {"experiment": "run-1050", "method": "", "status": "refused", "reason": "torn"}
    document = campaign_document(frame(table))
    listed = document.sections[-1].blocks[-1]
    assert len(listed.rows) == 1000
    assert listed.rows[0][0] == "run-1050"
