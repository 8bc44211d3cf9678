"""The explorer in Chromium: what a person does with it, by mouse and by keyboard."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import threading
from pathlib import Path

import pytest
from explorer_fixtures import small_database, small_library

from lithoform import generate, read_mesh
from lithoform.database.store import Store
from lithoform.explorer.controls import controls
from lithoform.explorer.state import recipe_of_link
from lithoform.recipe_io import read_recipe
from lithoform.soundness import check

pytest.importorskip("dash", reason="the explorer needs Dash")
playwright = pytest.importorskip("playwright.sync_api", reason="the browser is driven by Playwright")

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium; scripts/install-debian-packages.sh installs it")

LAPTOP = {"width": 1366, "height": 768}
# A recipe in which every parameter acts: smoothed by a Taubin pair, cut and blended.
FULL = "tab=studio&N_t=1280&n_s=4&smoothing_method=taubin&d_b=0.05&h_b=0.1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return small_database(tmp_path_factory.mktemp("browser") / "db")


@pytest.fixture(scope="module")
def library():
    return small_library()


@pytest.fixture(scope="module")
def app(folder, library):
    from lithoform.explorer.app import make_app

    return make_app(folder, library)


@pytest.fixture(scope="module")
def address(app):
    from werkzeug.serving import WSGIRequestHandler, make_server

    class Quiet(WSGIRequestHandler):
        def log(self, *_) -> None:
            pass

    server = make_server("127.0.0.1", 0, app.server, threaded=True, request_handler=Quiet)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="module")
def browser():
    # WebGL in software, which every machine has.
    arguments = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    if os.geteuid() == 0:
        arguments.append("--no-sandbox")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, address):
    """Open pages, and hold afterwards that nothing was complained of and nothing was asked from elsewhere."""
    faults, foreign = [], []

    def watch(page):
        page.set_default_timeout(20_000)
        page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda fault: faults.append(str(fault)))
        page.on("request", lambda request: None if request.url.startswith((address, "data:", "blob:"))
                else foreign.append(request.url))  # fmt: skip

    with contextlib.ExitStack() as stack:

        def call(query="", **options):
            context = browser.new_context(viewport=LAPTOP, **options)
            stack.callback(context.close)
            page = context.new_page()
            watch(page)
            page.goto(f"{address}?{query}" if query else address)
            page.wait_for_selector("#studio-controls details", state="attached")
            return page

        yield call
    assert (faults, foreign) == ([], [])


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    chosen = os.environ.get("LITHOFORM_ARTEFACTS")
    place = Path(chosen) if chosen else tmp_path_factory.mktemp("pictures")
    place.mkdir(parents=True, exist_ok=True)
    return place


def stone_of(page, view="studio"):
    """Hash of the stone that is drawn, once there is one."""
    return page.wait_for_selector(f"#{view}-view[data-hash]", state="attached").get_attribute("data-hash")


def next_stone(page, before, view="studio"):
    """Hash of the stone after the one of a hash."""
    page.wait_for_selector(f"#{view}-view[data-hash]:not([data-hash='{before}'])", state="attached")
    return stone_of(page, view)


def colours_of(page, view):
    """Number of different colours in the picture of a stone, as the screen shows it."""
    picture = page.locator(f"#{view}-view").screenshot()
    import io

    from PIL import Image

    return len(set(Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data()))


def choose(page, dropdown, label):
    """Take an entry of one of Dash's lists, by the keyboard."""
    page.locator(f"#{dropdown}").focus()
    page.keyboard.press("Enter")
    page.locator(".dash-dropdown-content label").filter(has_text=re.compile(f"^{re.escape(label)}$")).click()


# ------------------------------------------------------------------------------------------------ studio


def test_the_studio_shows_the_stone_of_its_link_and_the_link_that_reopens_it(opened):
    page = opened("tab=studio&N_t=1280&k=0.25&seed=18446744073709551615&delta=0,1,0.5")
    told = stone_of(page)
    recipe = recipe_of_link(page.url.partition("?")[2])
    assert (recipe.perturbation, recipe.seed, recipe.phase_offset) == (0.25, 2**64 - 1, (0.0, 1.0, 0.5))
    assert generate(recipe).mesh.content_hash == told
    assert page.locator("#field-perturbation").input_value() == "0.25"
    assert colours_of(page, "studio") > 50
    again = opened(page.url.partition("?")[2])
    assert stone_of(again) == told


def test_every_control_is_answered_by_another_stone_or_a_sentence(opened):
    page = opened(FULL)
    page.evaluate("document.querySelectorAll('#studio-controls details').forEach((d) => { d.open = true; })")
    base = stone_of(page)
    answers = {}
    for control in (c for group in controls()["groups"] for c in group["controls"]):
        name, kind = control["name"], control["kind"]
        if kind in ("slider", "counts"):
            field = page.locator(f"#slide-{name}")
            field.focus()
            # Towards the middle, so that no slider is at its end.
            page.keyboard.press("ArrowRight" if kind == "counts" else "PageDown" if float(field.input_value()) > 0.4 *
                                float(field.get_attribute("max")) else "PageUp")  # fmt: skip
        elif kind == "vector":
            field = page.locator(f"#field-{name}-y")
            field.fill("0.7")
            field.press("Tab")
        elif kind == "choice":
            now = page.locator(f"#choice-{name}").input_value()
            page.locator(f"#choice-{name}").select_option(next(c for c in control["choices"] if c != now))
        elif kind == "flag":
            page.locator(f"#flag-{name}").focus()
            page.keyboard.press("Space")
        else:
            page.locator("#dice").click()
        page.wait_for_function(
            """(base) => document.getElementById('studio-view').dataset.hash !== base
            || document.getElementById('studio-told').classList.contains('refused')""",
            arg=base,
        )
        told = page.locator("#studio-told")
        answers[name] = "refused" if "refused" in told.get_attribute("class") else "stone"
        if answers[name] == "refused":
            assert told.text_content().startswith("triangles must be 8 n^2; got 1280")
        page.locator("#undo").click()
        page.wait_for_selector(f"#studio-view[data-hash='{base}']")
        page.wait_for_selector("#studio-told:not(.refused)")
    # 1,280 triangles are an icosahedral sphere alone.
    assert {name for name, answer in answers.items() if answer == "refused"} == {"topology"}
    assert len(answers) == 36


def test_dimensions_keep_their_order_and_undo_and_redo_go_through_the_changes(opened):
    page = opened("tab=studio&N_t=320")
    first = stone_of(page)
    page.evaluate("document.querySelectorAll('#studio-controls details').forEach((d) => { d.open = true; })")
    page.locator("#field-height").fill("1.75")
    page.keyboard.press("Tab")
    second = next_stone(page, first)
    assert [page.locator(f"#field-{name}").input_value() for name in ("length", "width", "height")] == [
        "2",
        "1.75",
        "1.75",
    ]
    page.locator("#preset").select_option("blade")
    third = next_stone(page, second)
    assert recipe_of_link(page.url.partition("?")[2]).main_scale == 1.0
    page.locator("#tab-studio").focus()
    page.keyboard.press("Control+z")
    assert next_stone(page, third) == second
    page.locator("#undo").click()
    assert next_stone(page, second) == first
    assert page.locator("#undo").is_disabled()
    page.keyboard.press("Control+Shift+Z")
    assert next_stone(page, first) == second
    page.locator("#field-triangles").fill("204800")
    page.keyboard.press("Tab")
    page.wait_for_selector("#studio-told.refused")
    assert "at most 200,000 triangles" in page.locator("#studio-told").text_content()
    assert stone_of(page) == second


def test_what_was_refused_is_not_the_base_of_the_next_change(opened):
    page = opened("tab=studio&N_t=320&k=0.25")
    first = stone_of(page)
    page.evaluate("document.querySelectorAll('#studio-controls details').forEach((d) => { d.open = true; })")
    page.locator("#field-perturbation").fill("7")
    page.keyboard.press("Tab")
    page.wait_for_selector("#studio-told.refused")
    assert page.locator("#field-perturbation").input_value() == "7"  # with the reason beside it
    page.locator("#field-gain").fill("0.3")
    page.keyboard.press("Tab")
    second = next_stone(page, first)
    recipe = recipe_of_link(page.url.partition("?")[2])
    assert (recipe.perturbation, recipe.gain) == (0.25, 0.3)
    assert page.locator("#field-perturbation").input_value() == "0.25"
    # Nor is it a step of the history.
    page.locator("#undo").click()
    assert next_stone(page, second) == first
    assert page.locator("#undo").is_disabled()
    page.locator("#field-phase_offset-x").fill("99")
    page.keyboard.press("Tab")
    page.wait_for_selector("#studio-told.refused")
    page.locator("#field-phase_offset-y").fill("1")
    page.keyboard.press("Tab")
    next_stone(page, first)
    assert recipe_of_link(page.url.partition("?")[2]).phase_offset == (0.0, 1.0, 0.0)
    page.locator("#field-twist_axis-x").fill("0.5")
    page.keyboard.press("Tab")
    page.wait_for_selector("#studio-told:not(.refused)")


def test_a_slider_that_is_drawn_along_ends_with_its_last_value(opened):
    page = opened("tab=studio&N_t=1280")
    before = stone_of(page)
    page.evaluate("""async () => {
      const range = document.getElementById('slide-perturbation');
      for (let i = 0; i <= 50; i++) {
        range.value = String(300 + 4 * i);
        range.dispatchEvent(new Event('input', { bubbles: true }));
        await new Promise((done) => setTimeout(done, 8));
      }
    }""")
    last = generate(recipe_of_link("N_t=1280&k=0.5")).mesh.content_hash
    page.wait_for_selector(f"#studio-view[data-hash='{last}']")
    page.locator("#undo").click()
    assert next_stone(page, last) == before


def test_downloads_are_a_sound_mesh_its_sidecar_and_the_recipe(opened, tmp_path):
    page = opened("tab=studio&N_t=1280&seed=3")
    told = stone_of(page)
    for kind in ("stl", "json", "toml"):
        with page.expect_download() as download:
            page.locator(f"#get-{kind}").click()
        assert download.value.suggested_filename.endswith(f".{kind}")
        download.value.save_as(tmp_path / f"stone.{kind}")
    mesh = read_mesh(tmp_path / "stone.stl", unit="mm")
    assert check(mesh).sound
    assert len(mesh.faces) == 1280
    sidecar = json.loads((tmp_path / "stone.json").read_bytes())
    assert sidecar["content_sha256"] == told
    assert sidecar["file_sha256"] == hashlib.sha256((tmp_path / "stone.stl").read_bytes()).hexdigest()
    assert generate(read_recipe(tmp_path / "stone.toml")).mesh.content_hash == told


def test_a_bad_link_is_refused_politely_and_the_page_works_on(opened):
    page = opened("tab=studio&k=7&N_t=1280")
    notice = page.wait_for_selector("#notice:not([hidden])")
    assert "perturbation (k) must be 0 to 1; got 7" in notice.text_content()
    before = stone_of(page)
    page.locator("#notice button").click()
    assert page.locator("#notice").is_hidden()
    page.locator("#field-perturbation").fill("0.1")
    page.keyboard.press("Tab")
    next_stone(page, before)
    script = opened("tab=studio&calibration_frame=%3Cimg%20src%3Dx%20onerror%3Dalert(1)%3E")
    script.wait_for_selector("#notice:not([hidden])")
    assert script.locator("#notice img").count() == 0


def test_two_pages_at_once_have_a_stone_each(opened):
    pages = [opened(f"tab=studio&N_t=1280&seed={seed}") for seed in (1, 2)]
    for page in pages:
        stone_of(page)
    for step in range(3):
        for page, k in zip(pages, (0.2, 0.6), strict=True):
            page.locator("#field-perturbation").fill(f"{k + 0.05 * step:.2f}")
            page.keyboard.press("Enter")
    for page, seed, k in zip(pages, (1, 2), (0.3, 0.7), strict=True):
        expected = generate(recipe_of_link(f"N_t=1280&seed={seed}&k={k}")).mesh.content_hash
        page.wait_for_selector(f"#studio-view[data-hash='{expected}']")


# ------------------------------------------------------------------------------------------------ design space


def pixel_of(page, trace, point):
    """Where on the page a point of the cloud is drawn."""
    return page.evaluate(
        """([trace, point]) => {
      const graph = document.querySelector('#cloud .js-plotly-plot');
      const scene = graph._fullLayout.scene._scene, { model, view, projection } = scene.glplot.cameraParams;
      const data = graph._fullData[trace];
      let p = ['x', 'y', 'z'].map((k, i) => data[k][point] * scene.dataScale[i]).concat(1);
      for (const m of [model, view, projection]) {
        p = [0, 1, 2, 3].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r] * p[3]);
      }
      const box = scene.container.getBoundingClientRect();
      return [box.x + box.width * (0.5 + 0.5 * p[0] / p[3]), box.y + box.height * (0.5 - 0.5 * p[1] / p[3])];
    }""",
        [trace, point],
    )


def test_axes_change_and_a_click_on_a_point_makes_its_stone(opened, library):
    page = opened()
    page.wait_for_selector("#candidates button")
    titles = """() => ['x', 'y', 'z'].map((k) =>
        document.querySelector('#cloud .js-plotly-plot')._fullLayout.scene[k + 'axis'].title.text)"""
    assert page.evaluate(titles) == ["roundness R", "solidity S3D", "true sphericity TS"]
    choose(page, "axis-x", "elongation EI")
    page.wait_for_function(f"() => ({titles})()[0] === 'elongation EI'")
    choose(page, "axis-y", "E")
    page.wait_for_function(f"() => ({titles})()[1] === 'E'")
    assert "the target has no place on these axes" in page.locator("#cloud-told").text_content()
    page.wait_for_timeout(500)
    # Some points are hidden by others: the first that can be hit will do.
    for point in range(20):
        page.mouse.move(*pixel_of(page, 0, point))
        page.wait_for_timeout(200)
        # Plotly sees a button that is held while it draws, as a hand holds it.
        page.mouse.down()
        page.wait_for_timeout(150)
        page.mouse.up()
        with contextlib.suppress(playwright.TimeoutError):
            page.wait_for_selector("#space-view[data-hash]", timeout=1000)
            break
    told = stone_of(page, "space")
    index = int(re.search(r"Design (\d+), seed 0", page.locator("#space-told").text_content())[1])
    assert generate(library.recipe(index, seed=0)).mesh.content_hash == told
    page.wait_for_selector("#space-numbers th:has-text('predicted')")
    assert colours_of(page, "space") > 50
    page.locator("#space-numbers button", has_text="Another seed").click()
    next_stone(page, told, "space")
    page.locator("#space-numbers button", has_text="Open in the studio").click()
    assert stone_of(page) == stone_of(page, "space")
    assert recipe_of_link(page.url.partition("?")[2]).triangles == library.base.triangles


def test_the_target_ranks_the_candidates_and_filters_leave_some(opened, library):
    page = opened()
    row = "#candidates tr:nth-child(2) button"
    page.wait_for_selector(row)
    chosen = 17
    for name, value in zip(("roundness", "boxiness", "solidity", "true_sphericity"), library.descriptors[chosen],
                           strict=True):  # fmt: skip
        page.locator(f"#target-{name}").fill(f"{value:.4f}")
    page.keyboard.press("Tab")
    page.wait_for_selector(f"{row}[data-point='{chosen}']")
    page.locator(row).focus()
    page.keyboard.press("Enter")
    stone_of(page, "space")
    assert f"Design {chosen}" in page.locator("#space-told").text_content()
    page.locator("#within input").check()
    page.wait_for_function("() => !document.getElementById('cloud-told').textContent.startsWith('80 of')")
    page.locator("#target-roundness").fill("7")
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.getElementById('cloud-told').textContent.includes('at most 1')")


# ------------------------------------------------------------------------------------------------ population


def test_distributions_and_sheets_of_a_population(opened, folder):
    page = opened("tab=population")
    page.wait_for_selector("#sheet-told:text-is('first, stones 1 to 24 of 28.')")
    assert "first: 28 particles, second: 10 particles." in page.locator("#distribution-told").text_content()
    assert page.locator(".cell").count() == 24
    page.locator(".cell").nth(2).click()
    told = stone_of(page, "stone")
    assert told == Store(folder).table(["content_hash"], sources=["first"])["content_hash"][2].as_py()
    page.locator("#kind input").nth(1).check()
    page.wait_for_function(
        "() => document.querySelector('#distribution .js-plotly-plot')._fullData[0].type === 'scatter'"
    )
    page.locator("#by-class input").check()
    page.wait_for_function("() => document.querySelector('#distribution .js-plotly-plot')._fullData.length === 8")
    choose(page, "descriptor", "elongation")
    title = "document.querySelector('#distribution .js-plotly-plot')._fullLayout.xaxis4.title.text"
    page.wait_for_function(f"() => {title}.startsWith('elongation')")
    page.locator("#sheet-on").click()
    page.wait_for_selector("#sheet-told:text-is('first, stones 25 to 28 of 28.')")
    choose(page, "sheet-source", "second")
    page.wait_for_selector("#sheet-told:text-is('second, stones 1 to 10 of 10.')")
    page.locator(".cell").nth(0).click()
    next_stone(page, told, "stone")
    page.locator("#stone-numbers button").click()
    assert stone_of(page) == stone_of(page, "stone")


def test_a_sheet_is_cancelled_and_a_closed_page_leaves_no_work(opened, app, monkeypatch):
    # Stones that take as long as somebody wishes.
    asked, free = [], threading.Event()
    shelf = app.context.shelf

    def slow(source, number, make=shelf.stone):
        asked.append(number)
        free.wait(10)
        return make(source, number)

    monkeypatch.setattr(shelf, "stone", slow)
    page = opened("tab=population")
    page.wait_for_selector("#sheet-cancel:enabled")
    page.locator("#sheet-cancel").click()
    free.set()
    page.wait_for_selector("#sheet-told:text-is('Cancelled.')")
    page.wait_for_timeout(300)
    assert len(asked) <= 2
    free.clear()
    asked.clear()
    page.locator("#tab-studio").click()
    page.locator("#tab-population").click()
    choose(page, "sheet-class", "plate")
    page.wait_for_selector("#sheet-cancel:enabled")
    page.close()
    free.set()
    for _ in range(100):
        if app.context.turns.working == 0:
            break
        threading.Event().wait(0.02)
    assert app.context.turns.working == 0
    assert len(asked) <= 2


# ------------------------------------------------------------------------------------------------ the page


def test_the_keyboard_reaches_everything_and_each_field_has_a_name(opened):
    page = opened("tab=studio&N_t=320")
    stone_of(page)
    page.locator("#tab-studio").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("#tab-population").get_attribute("aria-selected") == "true"
    page.keyboard.press("Home")
    assert page.locator("#panel-space").is_visible()
    assert page.evaluate("document.activeElement.id") == "tab-space"
    page.locator("#tab-studio").click()
    page.evaluate("document.querySelectorAll('#studio-controls details').forEach((d) => { d.open = true; })")
    reached = set()
    page.locator("#tab-studio").focus()
    for _ in range(200):
        page.keyboard.press("Tab")
        name, outline = page.evaluate("""() => { const e = document.activeElement;
            return [e === document.body ? 'body' : e.id || e.parentElement.id, getComputedStyle(e).outlineStyle]; }""")
        if name in ("body", "tab-studio"):
            break
        assert outline != "none", name
        reached.add(name)
    fields = page.evaluate("""() => ['input', 'select', 'button'].flatMap((kind) =>
        [...document.querySelectorAll('#panel-studio ' + kind)]).filter((e) => !e.disabled).map((e) => e.id)""")
    assert set(fields) <= reached
    assert "studio-view" in reached
    nameless = page.evaluate("""[...document.querySelectorAll('input, select')].filter((e) =>
        !(e.labels && e.labels.length && e.labels[0].textContent.trim()) && !e.getAttribute('aria-label')
        && !e.closest('label') && !e.closest('[aria-hidden=true]')).map((e) => e.id || e.outerHTML)""")
    assert nameless == []
    canvas = page.locator("#studio-view canvas")
    before = canvas.screenshot()
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    assert canvas.screenshot() != before


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_every_tab_fits_a_laptop_in_light_and_dark(theme, opened, pictures):
    page = opened(color_scheme=theme)
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    page.wait_for_selector("#candidates button")
    page.locator("#candidates button").first.click()
    page.wait_for_selector("#space-numbers th:has-text('predicted')")
    page.wait_for_timeout(300)
    page.screenshot(path=pictures / f"space-{theme}.png")
    page.locator("#tab-studio").click()
    stone_of(page)
    page.wait_for_timeout(200)
    page.screenshot(path=pictures / f"studio-{theme}.png")
    page.locator("#tab-population").click()
    page.wait_for_selector("#sheet-told:text-is('first, stones 1 to 24 of 28.')")
    page.locator(".cell").first.click()
    stone_of(page, "stone")
    page.wait_for_timeout(200)
    page.screenshot(path=pictures / f"population-{theme}.png")
    for name in ("space", "studio", "population"):
        page.locator(f"#tab-{name}").click()
        # Nothing is beyond the window: what is long scrolls in its own column.
        assert page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == [
            1366,
            768,
        ]
    other = {"light": "dark", "dark": "light"}[theme]
    page.locator("#theme-button").click()
    page.wait_for_selector(f"html[data-theme='{other}']")
    page.reload()
    page.wait_for_selector("#studio-controls details", state="attached")
    assert page.evaluate("document.documentElement.dataset.theme") == other


@pytest.mark.parametrize(("width", "height"), [(1024, 700), (800, 700)])
def test_a_small_window_leaves_the_cloud_its_room(width, height, opened, pictures):
    page = opened()
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_selector("#candidates button")
    page.locator("#candidates button").first.click()
    page.wait_for_selector("#space-numbers th:has-text('predicted')")
    page.wait_for_timeout(300)
    page.screenshot(path=pictures / f"space-{width}.png")
    graph = page.locator("#cloud").bounding_box()
    # Plotly fits a scene to the height, so that one that is higher than wide is cut at its sides.
    assert graph["width"] > 1.2 * graph["height"]
    assert graph["height"] > 300
    for name in ("space", "studio", "population"):
        page.locator(f"#tab-{name}").click()
        page.wait_for_selector(f"#panel-{name} .beside", state="attached")
        too_wide = page.evaluate("""() => [document.documentElement, ...document.querySelectorAll("aside, .beside > *")]
          .filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth).map((e) => e.id || e.className)""")
        assert too_wide == []
        page.wait_for_timeout(200)
        page.screenshot(path=pictures / f"{name}-{width}.png")


def test_a_stone_of_20000_triangles_is_redrawn_soon_after_a_change(opened):
    page = opened("tab=studio")
    stone_of(page)
    seconds = page.evaluate("""async () => {
      const range = document.getElementById('slide-perturbation'), view = document.getElementById('studio-view');
      const taken = [];
      for (let i = 0; i < 9; i++) {
        const before = view.dataset.hash, started = performance.now();
        range.value = String(200 + 30 * i);
        range.dispatchEvent(new Event('input', { bubbles: true }));
        while (view.dataset.hash === before) await new Promise((done) => requestAnimationFrame(done));
        await new Promise((done) => requestAnimationFrame(done));
        taken.push((performance.now() - started) / 1e3);
      }
      return taken;
    }""")
    # 0.3 s is the aim on a machine of its own (benchmarks hold it); a machine that tests run on is shared.
    assert sorted(seconds)[len(seconds) // 2] < 1.5
