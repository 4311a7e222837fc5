import html
import re

import numpy as np

from airrace.track import load_track
from airrace.visualization.inline import show_page, show_paths


def _page(shown) -> str:
    """Returns what is in the frame."""
    (attribute,) = re.findall(r'srcdoc="([^"]*)"', shown._repr_html_())
    return html.unescape(attribute)


def test_a_page_is_in_the_frame_as_it_is(tmp_path):
    page = '<p class="x">&amp; "quoted"</p>'
    assert _page(show_page(page)) == page
    (tmp_path / "page.html").write_text(page)
    assert _page(show_page(tmp_path / "page.html")) == page


def test_a_view_of_paths_needs_no_server():
    positions = np.array([[0.0, 0, 1], [5, 0, 1], [9, 3, 1]])
    page = _page(show_paths(load_track("hexagon"), [(positions, [1.0, 5.0, 9.0])]))
    assert "<html" in page.lower() and "paths/0" not in page  # packed, not as text
    assert not re.search(r'src="https?://', page)
