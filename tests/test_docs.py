"""The documentation: its commands are commands, its links lead somewhere, its pages need no
network; what runs its commands does so."""

import ast
import contextlib
import re
import shlex
import subprocess
import sys
import tomllib
from html.parser import HTMLParser

import click
import pytest
from places import ROOT
from ruamel.yaml import YAML

import steelyard
from steelyard.cli import app

DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_extensions"))

from session import CommandError, Session, block, blocks, part_of  # noqa: E402

PAGES = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)
EVERYWHERE = [
    *PAGES,
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "examples" / "README.md",
    ROOT / "examples" / "kuka-tool" / "README.md",
]


def by_name(path):
    return path.relative_to(ROOT).as_posix()


# What runs the commands


@pytest.fixture
def session(tmp_path):
    with Session(tmp_path) as found:
        yield found


def test_commands_run_in_order_and_in_one_shell(session):
    assert session.run("mkdir inner && cd inner && what=there") == (0, "")
    assert session.run("echo $what; basename $PWD") == (0, "there\ninner\n")


def test_output_and_errors_come_as_on_a_screen(session):
    assert session.run("echo one; echo two >&2; echo three; (exit 3)") == (3, "one\ntwo\nthree\n")


def test_output_without_an_end_of_line(session):
    assert session.run("printf x") == (0, "x")


def test_a_command_reads_nothing_of_the_next_one(session):
    assert session.run("cat") == (0, "")


def test_a_mistake_of_syntax_is_one_of_its_command(session):
    status, printed = session.run("echo 'unfinished")
    assert status != 0
    assert "unexpected EOF" in printed
    assert session.run("echo next") == (0, "next\n")


def test_a_command_that_ends_the_shell(session):
    with pytest.raises(CommandError, match="'exit 2' ended the shell"):
        session.run("exit 2")


def test_a_block_shows_prompt_command_and_output(session):
    assert (
        session.do(block("shell", "", {}, "echo one \\\n  two\n\nfalse || echo three\n"))
        == "$ echo one \\\n>   two\none two\n$ false || echo three\nthree\n"
    )


def test_another_status_than_the_page_says(session):
    assert session.do(block("shell", "", {"status": "3"}, "(exit 3)\n")) == "$ (exit 3)\n"
    with pytest.raises(CommandError, match=r"'\(exit 3\)' should end with status 0, ended with 3"):
        session.do(block("shell", "", {}, "(exit 3)\n"))


def test_a_file_is_written(session):
    session.do(block("file", "a.yaml", {}, "a: 1\n"))
    assert session.run("cat a.yaml") == (0, "a: 1\n")


def test_blocks_of_a_page():
    page = (
        "text\n```{shell}\n:status: 3\n:setup:\nls -l\n```\n~~~\n```{file} a.yaml\na: 1\n\nb:"
        " 2\n```\n```python\nno\n```\n"
    )
    first, second = blocks(page)
    assert (first.kind, first.commands, first.status, first.setup) == ("shell", ("ls -l",), 3, True)
    assert (second.kind, second.name, second.text) == ("file", "a.yaml", "a: 1\n\nb: 2\n")


def test_an_option_that_there_is_not():
    with pytest.raises(ValueError, match="expected options"):
        block("shell", "", {"statsu": "3"}, "ls\n")


def test_some_lines():
    text = "1\n2\n3\n4\n5\n"
    assert part_of(text, "2-3,5") == "…\n2\n3\n…\n5\n"
    assert part_of(text, "1-2") == "1\n2\n…\n"
    assert part_of(text, "3-") == "…\n3\n4\n5\n"
    with pytest.raises(ValueError, match="ascending lines of 5"):
        part_of(text, "4-9")


# What the pages say


def parse(command):
    """What click makes of a command, without doing it; an error where there is no such verb or
    option."""
    words = shlex.split(command, comments=True)
    words = words[
        : next((i for i, word in enumerate(words) if word in {"|", ">", "&&", ";"}), len(words))
    ]
    context = app.make_context("steelyard", words[1:]) if len(words) > 1 else None
    if context is not None:
        name, verb, rest = app.resolve_command(context, [*context._protected_args, *context.args])
        assert verb is not None
        verb.make_context(name, rest, parent=context)


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_commands_of_blocks_are_commands(page):
    for each in blocks(page.read_text(encoding="utf-8")):
        for command in each.commands if each.kind == "shell" else ():
            if command.startswith("steelyard "):
                with contextlib.suppress(click.exceptions.Exit):  # --version, --help
                    parse(command)


@pytest.mark.parametrize("page", EVERYWHERE, ids=by_name)
def test_commands_within_sentences_are_commands(page):
    text = re.sub(
        r"^(```+|~~~+).*?^\1", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    top = click.Context(app, info_name="steelyard")
    for command in re.findall(r"`steelyard ([a-z][^`]*)`", text):
        verb = app.get_command(top, command.split()[0])
        assert verb is not None, command
        options = {name for parameter in verb.params for name in parameter.opts} | {"--help"}
        for option in re.findall(r"(?<!\S)--[a-z-]+", command):
            assert option in options, command


@pytest.mark.parametrize("page", EVERYWHERE, ids=by_name)
def test_python_compiles(page):
    for code in re.findall(
        r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    ):
        ast.parse(code)


@pytest.mark.parametrize("page", EVERYWHERE, ids=by_name)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not re.match(r"[a-z]+:", target):
            assert (page.parent / target).exists(), target


def test_the_page_of_python_has_the_whole_public_face():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\.\. auto\w+:: steelyard\.(\w+)$", page, flags=re.MULTILINE)) == set(
        steelyard.__all__
    )


def test_citations_of_the_code_are_defined():
    defined = set(
        re.findall(
            r"^- \*\*\[(\w+)\]\*\*",
            (DOCS / "references.md").read_text(encoding="utf-8"),
            flags=re.MULTILINE,
        )
    )
    cited = {
        key
        for path in (ROOT / "src").rglob("*.py")
        for key in re.findall(r"\[([A-Z][A-Za-z]+\d{4})\]_", path.read_text(encoding="utf-8"))
    }
    assert cited <= defined


def test_the_citation_is_of_this_version():
    citation = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["title"] == project["name"]
    assert str(citation["version"]) == project["version"]
    assert citation["license"] == project["license"]
    assert [author["name"] for author in citation["authors"]] == [
        author["name"] for author in project["authors"]
    ]


def test_decisions_are_numbered_and_have_one_form():
    pages = sorted((DOCS / "decisions").glob("[0-9]*.md"))
    assert [int(page.name[:4]) for page in pages] == list(range(1, len(pages) + 1))
    for number, page in enumerate(pages, start=1):
        text = page.read_text(encoding="utf-8")
        assert text.startswith(f"# {number}. "), page.name
        headings = re.findall(r"^## (.*)$", text, flags=re.MULTILINE)
        assert headings == ["Context", "Decision", "Consequences"], page.name


def test_architecture_leads_to_every_decision():
    text = (DOCS / "architecture.md").read_text(encoding="utf-8")
    for page in (DOCS / "decisions").glob("[0-9]*.md"):
        assert f"decisions/{page.name}" in text, page.name


# What is built


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The documentation without running its commands, warnings being errors."""
    out = tmp_path_factory.mktemp("docs")
    options = ["-q", "-W", "--keep-going", "-n", "-D", "shell_execute=0"]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            *options,
            "-d",
            str(out / "trees"),
            str(DOCS),
            str(out / "html"),
        ],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return out / "html"


class Resources(HTMLParser):
    """What a page loads, and whether it is on the machine."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        loads = values.get("src") or (values.get("href") if tag == "link" else None) or ""
        if re.match(r"(?:[a-z]+:)?//", loads):
            self.found.append((tag, loads))


@pytest.mark.slow
@pytest.mark.integration
def test_pages_load_nothing_from_elsewhere(built):
    pages = list(built.rglob("*.html"))
    assert len(pages) > len(PAGES)
    for page in pages:
        resources = Resources()
        text = page.read_text(encoding="utf-8")
        resources.feed(text)
        assert not resources.found, page.name
        assert not re.search(r"mathjax[^\"' ]*\.js", text, flags=re.IGNORECASE), page.name
    for sheet in built.rglob("*.css"):
        assert not re.search(
            r"(@import\s+|url\(\s*)['\"]?(?:https?:)?//", sheet.read_text(encoding="utf-8")
        ), sheet.name


@pytest.mark.slow
@pytest.mark.integration
def test_mathematics_is_mathml(built):
    text = (built / "theory.html").read_text(encoding="utf-8")
    assert text.count("<math") > 50
    assert "\\dot" not in text
    # One half, written without braces as TeX has it.
    assert re.search(r"<mfrac[^>]*>\s*<mn>1</mn>\s*<mn>2</mn>", text)
    assert not re.search(r"<mfrac[^>]*>\s*<mn>12</mn>", text)


@pytest.mark.slow
@pytest.mark.integration
def test_every_verb_and_kind_has_its_place(built):
    commands, files = (
        (built / name).read_text(encoding="utf-8") for name in ("commands.html", "files.html")
    )
    for verb in app.list_commands(click.Context(app)):
        assert f'id="{verb}"' in commands
    for kind in (
        "tension",
        "wrench",
        "imu",
        "attitude",
        "position",
        "pose",
        "length",
        "distance",
        "command",
    ):
        assert f'id="{kind}"' in files
    assert "generated:" not in commands + files


@pytest.mark.slow
@pytest.mark.integration
def test_search_works_without_a_server(built):
    assert (built / "searchindex.js").read_text(encoding="utf-8").startswith("Search.setIndex(")


def test_troubleshooting_quotes_what_the_program_says():
    """Every message in code marks of the first two tables stands in the source, part by part."""
    source = " ".join(
        re.sub(r'"\s*\n\s*f?"', "", path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "src").rglob("*.py"))
    )
    source = re.sub(r"\s+", " ", source)
    page = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    _, first, second, *_ = page.split("\n## ")
    lines = [line for line in (first + second).splitlines() if line.startswith("| `")]
    messages = [line.split("|")[1].strip() for line in lines]
    assert len(messages) > 15
    for message in messages:
        for part in re.findall(r"`([^`]+)`", message):
            for piece in filter(None, (p.strip(" %:") for p in re.split(r"…%?", part))):
                if len(piece) > 6:
                    assert piece in source, piece


@pytest.mark.integration
def test_the_gallery_shows_what_the_build_makes():
    import gallery

    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    shown = re.findall(r'<iframe [^>]*src="gallery/([^"]+)"', text)
    assert shown == list(gallery.PAGES)
    for command in gallery.COMMANDS:
        assert f"steelyard {command[0]}" in text
        assert command[0] in app.list_commands(click.Context(app))
