"""The documentation as one site: built from scratch, its links, and axe-core's rules."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

pytest.importorskip("mkdocs")

from axe_rules import problems
from chromium import BrowserContext, chromium, opened
from node_process import NodeProcess

pytestmark = pytest.mark.slow

PAGES = ("", "tutorials/first-ride/", "performance/", "interfaces/", "api/plants/")
"""Pages of every kind, looked through in both schemes; the others in one."""
ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the built site."""
    folder = tmp_path_factory.mktemp("docs") / "site"
    # --quiet would hide warnings from --strict.
    words = ["build", "--strict", "--site-dir", str(folder)]
    subprocess.run([sys.executable, "-m", "mkdocs", *words], cwd=ROOT, check=True)
    return folder


def test_the_api_pages_are_made_of_the_docstrings(site: Path) -> None:
    page = (site / "api" / "environments" / "index.html").read_text()
    assert "Balance a bicycle and ride it to a goal" in page
    assert "reset_mask" in page


def test_every_page_is_on_the_site_and_the_first_one_leads_to_the_tutorials(site: Path) -> None:
    start = (site / "index.html").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        html = site / "index.html" if page.stem == "index" else site / page.stem / "index.html"
        assert html.is_file(), page.name
    for page in (ROOT / "docs" / "tutorials").glob("*.md"):
        assert f'href="tutorials/{page.stem}/"' in start, page.name


def test_no_drawing_is_left_as_source_text(site: Path) -> None:
    for page in site.rglob("index.html"):
        assert "mermaid" not in page.read_text(), page
    assert (site / "images" / "architecture.svg").is_file()


def test_the_drawing_names_what_the_nodes_offer() -> None:
    page = (ROOT / "docs" / "interfaces.md").read_text()
    drawing = ElementTree.parse(ROOT / "docs" / "images" / "architecture.svg").getroot()
    words = " ".join(drawing.itertext())
    names = set(re.findall(r"\bbicycle/\w+", words))
    assert len(names) >= 8
    for name in names | {"goal_pose", "goal_path", "follow_path", "cmd_vel"}:
        assert f"`{name}`" in page, name
    assert "actions ride_to_pose" in words


def test_the_glossary_explains_the_words_of_other_fields() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text()
    entries = re.findall(r"^\| (?!word |---)(.+?) \|", page, re.MULTILINE)
    assert entries == sorted(entries, key=str.casefold)
    words = {re.sub(r" \(.*\)", "", word) for entry in entries for word in entry.split(", ")}
    readers_met = (
        "DDS Foxglove GNSS Gymnasium ONNX PlotJuggler RMS RTK RViz URDF action driver estimator "
        "firmware kick namespace node p50 p99 return service stable-baselines3 topic"
    )
    assert words >= {*readers_met.split(), "cross-track error", "hardware in the loop"}


def test_a_link_out_of_the_docs_keeps_its_text_and_names_the_file(site: Path) -> None:
    page = (site / "paths" / "index.html").read_text()
    name = "bicycle_controller/bicycle_controller/control/courses.py"
    assert re.search(rf'<span class="file" title="{name}">', page)


def test_a_link_to_nothing_ends_the_build(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("# Start\n\n[gone](../nowhere/gone.py)\n")
    hook = ROOT / "docs" / "site" / "repository_links.py"
    (tmp_path / "mkdocs.yml").write_text(f"site_name: x\nhooks: [{hook}]\n")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0
    assert "index.md links to ../nowhere/gone.py, which does not exist" in done.stderr


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    with chromium() as context:
        yield context


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    server = [sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1"]
    with NodeProcess(server, cwd=site) as process:
        port = process.wait_for_line(r"port (\d+)")[1]
        yield f"http://127.0.0.1:{port}/"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("page", PAGES)
def test_the_site_breaks_no_rule(
    browser: BrowserContext, address: str, page: str, scheme: Any
) -> None:
    tab = browser.new_page()
    tab.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    tab.goto(address + page)
    assert problems(tab) == []
    tab.set_viewport_size({"width": 390, "height": 844})
    assert tab.evaluate("() => document.documentElement.scrollWidth <= innerWidth + 1")
    tab.close()


def test_no_page_of_the_site_breaks_a_rule(
    browser: BrowserContext, address: str, site: Path
) -> None:
    tab = browser.new_page()
    tab.emulate_media(color_scheme="light", reduced_motion="reduce")
    found = {}
    pages = [path.parent.relative_to(site).as_posix() for path in site.rglob("index.html")]
    assert len(pages) > 40
    for page in sorted(pages):
        tab.set_viewport_size({"width": 1280, "height": 800})
        tab.goto(f"{address}{page}/")
        # One style sheet colours them all, and the pages above are looked at for it.
        found[page] = problems(tab, contrast=False)
        tab.set_viewport_size({"width": 390, "height": 844})
        if not tab.evaluate("() => document.documentElement.scrollWidth <= innerWidth + 1"):
            found[page].append(("wider than a phone", []))
    assert {page: broken for page, broken in found.items() if broken} == {}
    tab.close()


def test_the_reader_chooses_light_or_dark(browser: BrowserContext, address: str) -> None:
    with opened(browser, address) as tab:  # which fails on an error in the console
        tab.emulate_media(color_scheme="light")
        for wanted in ("dark", "light"):
            tab.locator("#theme-menu").click()
            tab.locator(f"[data-bs-theme-value={wanted}]").click()
            assert tab.locator("html").get_attribute("data-bs-theme") == wanted
