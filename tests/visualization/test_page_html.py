import base64
import json
import re
from importlib import resources

import pytest

from airrace.scenario import Scenario
from airrace.track import load_track
from airrace.vehicle import load_vehicle
from airrace.visualization.page_html import LIVE, make_page, page_config

HTML = "<html><head></head><body>Meshcat</body></html>"
FOLDER = resources.files("airrace.visualization") / "page"


@pytest.fixture
def config(hexagon):
    vehicle, _ = load_vehicle("Default")
    return page_config(Scenario(), load_track(hexagon), vehicle, "visualizer/drone", mode=LIVE)


def modules(page):
    """Returns the JavaScript modules of a page, by name."""
    (imports,) = re.findall(r'<script type="importmap">(.*?)</script>', page)
    return {
        name: base64.b64decode(url.partition(",")[2]).decode()
        for name, url in json.loads(imports)["imports"].items()
    }


def test_every_module_that_is_imported_is_in_the_page(config):
    made = modules(make_page(HTML, config))
    files = {f"airrace/{file.name}" for file in FOLDER.iterdir() if file.name.endswith(".js")}
    assert set(made) == files
    for name, text in made.items():
        for imported in re.findall(r'^import .*?from "(.*?)";', text, re.MULTILINE):
            assert imported in made, (name, imported)


def test_the_modules_import_what_there_is(config):
    made = modules(make_page(HTML, config))
    for name, text in made.items():
        for names, source in re.findall(r'import \{(.*?)\} from "(.*?)";', text, re.DOTALL):
            for each in filter(None, (word.strip() for word in names.split(","))):
                pattern = rf"export (async )?(function|class|const|let) [^;{{(]*\b{each}\b"
                assert re.search(pattern, made[source]), (name, each)


def test_a_page_holds_its_record_and_asks_for_nothing_else(config):
    page = make_page(HTML, config, {"events": [{"t": 1.0, "text": "</script>"}]})
    (data,) = re.findall(r'id="race-record">(.*?)</script>', page)
    assert json.loads(data)["events"][0]["text"] == "</script>"
    assert page.count("</body>") == 1 and page.index("Meshcat") < page.index("race-config")
    for text in (page, *modules(page).values()):
        assert not re.search(r'(src|href)="|url\(|@import|https?://', text)


def test_what_a_page_is_told_of_a_track(config, hexagon):
    track = load_track(hexagon)
    assert len(config["gates"]) == 6
    for gate, told in zip(track.gates, config["gates"]):
        assert told["middle"] == pytest.approx(gate.p_WG, abs=1e-3)
        assert told["pylons"][0] == pytest.approx(gate.left_pylon, abs=1e-3)
    assert 2.0 < config["maxThrust"] < 10.0
    assert len(config["speedColors"][0]) == 3
    json.dumps(config, allow_nan=False)


def test_a_page_below_a_path_of_a_proxy_finds_all_that_it_asks_for():
    for file in FOLDER.iterdir():
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"location\.(host|origin|protocol)|(src|href)=\"/", text), file.name
    assert 'new URL("race", location.href' in (FOLDER / "live.js").read_text(encoding="utf-8")
