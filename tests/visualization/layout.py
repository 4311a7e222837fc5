"""How pages hold at the widths of a desk, of a small window and of a phone, as a browser measures it."""

import contextlib

WIDTHS = ((1600, 900), (1024, 768), (390, 844))
THEMES = ("light", "dark")
# Of the page of a race: pairs of panels that cover one another, what leaves the window, and in how
# many rows the buttons of the bar are. A legend may be above the scene, and a card is above all.
_PANELS = """(() => {
  const seen = (each) => {
    const { width, height } = each.getBoundingClientRect();
    return width > 0 && height > 0 && getComputedStyle(each).visibility !== "hidden";
  };
  const all = (query) => [...document.querySelectorAll(query)].filter(seen);
  const name = (each) => each.id || each.firstElementChild?.id;
  const box = (each) => each.getBoundingClientRect();
  const panels = all("#race > .panel:not(#results), #side > .panel");
  const overlaps = [];
  panels.forEach((one, k) => panels.slice(k + 1).forEach((other) => {
    const [a, b] = [box(one), box(other)];
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 1 && down > 1) overlaps.push(`${name(one)}, ${name(other)}`);
  }));
  const outside = [...panels, ...all("#race button:not(#resize), #race select, #race td, #race a")]
    .filter((each) => !each.closest("#results") && (box(each).left < -1 || box(each).right > innerWidth + 1
      || box(each).top < -1 || box(each).bottom > innerHeight + 1))
    .map((each) => name(each) || each.innerText);
  const middles = all("#bar button, #bar select, #bar a").map((e) => (box(e).top + box(e).bottom) / 2);
  const rows = middles.sort((a, b) => a - b).filter((y, k, ys) => !k || y - ys[k - 1] > 10).length;
  return { overlaps, outside, rows, panels: panels.map(name) };
})()"""
_PAGE = """(() => {
  const box = (each) => each.getBoundingClientRect();
  const letters = [...document.querySelectorAll("figure svg text")].filter(
    (each) => each.getClientRects().length).map((each) => parseFloat(getComputedStyle(each).fontSize) * Math.hypot(each.getScreenCTM().a,
      each.getScreenCTM().b));
  const tiles = [...document.querySelectorAll(".facts li")];
  const rows = Map.groupBy(tiles, (each) => Math.round(box(each).top));
  const ragged = [...rows.values()].filter((row) => new Set(row.flatMap((each) =>
    [box(each).height, box(each.querySelector("b")).bottom].map(Math.round))).size > 2).length;
  const scrolled = [...document.querySelectorAll("figure > div")].filter(
    (each) => each.scrollWidth > each.clientWidth + 1).length;
  return { over: document.documentElement.scrollWidth - innerWidth, ragged, scrolled,
    tiles: new Set(tiles.map((each) => Math.round(box(each).width))).size,
    least: Math.min(99, ...letters) };
})()"""


def check_panels(browser, width):
    """Asserts that all of the page of a race can be seen; returns the names of its panels."""
    # What makes room for the bar hears of its height with the next frame.
    with contextlib.suppress(AssertionError):
        browser.wait_for(f"{_PANELS}.overlaps.length === 0", patience=5.0)
    found = browser.evaluate(_PANELS)
    assert found["overlaps"] == [] and found["outside"] == [], (width, found)
    assert found["rows"] <= 2, (width, found)
    return found["panels"]


def check_page(browser, url):
    """Asserts that a page is as wide as its window, and its pictures and tiles can be read."""
    browser.open(url)
    for width, height in WIDTHS:
        for theme in THEMES:
            browser.resize(width, height, theme)
            found = browser.evaluate(_PAGE)
            assert found["over"] <= 0, (width, found)
            assert found["least"] > 8.0 and found["scrolled"] == 0, (width, found)
            assert found["ragged"] == 0 and found["tiles"] <= 1, (width, found)
    browser.resize(640, 400, "light")
