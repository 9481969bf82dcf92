"""Pages without outside resources: tags in order, a description a picture, no script or request."""

import re
from html.parser import HTMLParser

EMPTY = frozenset({"meta", "img", "source", "br", "wbr"})


class Page(HTMLParser):
    """Words of a page, and what it would load; `open` holds the tags that are not closed yet."""

    def __init__(self):
        super().__init__()
        self.open, self.loads, self.words = [], [], []

    def handle_starttag(self, tag, attrs):
        assert tag not in ("script", "link", "object", "base")
        if (
            tag == "iframe"
        ):  # empty until it is asked for; the policy of its page lets it load nothing
            assert {name for name, _ in attrs} == {"title", "data-scene"}
            assert "default-src 'none'" in dict(attrs)["data-scene"]
        self.loads += [v for k, v in attrs if k in ("src", "srcset", "href", "data", "poster")]
        assert tag != "img" or dict(attrs)["alt"]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.words.append(data)


def read_alone(text):
    """Content of a page, which must be whole and take nothing from elsewhere."""
    page = Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert text.startswith("<!DOCTYPE html>")
    page.loads = [load for load in page.loads if load != "view.html"]  # a link beside it
    assert all(load.startswith("data:image/png;base64,") for load in page.loads)
    bare = re.sub(r"base64,[A-Za-z0-9+/=]*|data-scene='[^']*'", "", text)
    assert not re.search(r"http|@import|url\(", bare)
    return page
