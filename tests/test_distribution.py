"""The wheel that is made of the source distribution works outside of the checkout."""

import os
import subprocess
import sys

import pytest
from places import ROOT
from recordings import write_small

pytestmark = pytest.mark.slow


def done(words, **more):
    ended = subprocess.run(
        list(map(str, words)), capture_output=True, text=True, check=False, **more
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Where the wheel has been unpacked to."""
    folder = tmp_path_factory.mktemp("distribution")
    # First the source distribution, then the wheel of what is in that.
    done([sys.executable, "-m", "build", "--outdir", folder / "made", ROOT])
    (wheel,) = (folder / "made").glob("*.whl")
    assert len(list((folder / "made").glob("*.tar.gz"))) == 1
    target = folder / "installed"
    done([sys.executable, "-m", "pip", "install", "--no-deps", "--target", target, wheel])
    return target


def run(installed, folder, *words):
    return done(
        [sys.executable, "-m", "steelyard", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(installed)},
    )


def test_it_is_the_one_that_was_installed(installed, tmp_path):
    code = "import steelyard; print(steelyard.__file__, steelyard.__version__)"
    out = done(
        [sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(installed)}
    )
    assert out.startswith(f"{installed}{os.sep}steelyard")


def test_files_beside_the_modules_are_there(installed, tmp_path):
    assert "cogiro" in run(installed, tmp_path, "robots")
    assert '"$schema"' in run(installed, tmp_path, "schema")
    small = write_small(tmp_path / "small")
    words = ("identify", small, "--method", "least-squares", "--out", tmp_path / "result")
    run(installed, tmp_path, *words)
    assert "plotly" in (tmp_path / "result" / "report.html").read_text(encoding="utf-8").lower()
    assert (installed / "steelyard" / "py.typed").is_file()
