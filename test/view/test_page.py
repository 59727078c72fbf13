"""Pages as documents, without a browser: one for each of two browsers, and never more pictures than are drawn."""

from bokeh.document import Document
from test_feed import SECOND, fill

from radar_app.view.choices_tab import ChoicesTab
from radar_app.view.feed import Feed
from radar_app.view.page import Context, Page
from radar_app.view.pictures import AHEAD
from radar_app.view.room_tab import RoomTab


class Filled:
    """A source that has given all that it will."""

    title, goes, note, zones_file = "filled", "live", "", None

    def __init__(self):
        self.feed = Feed()
        fill(self.feed, 2.0)

    def reload_zones(self, told):
        told(False, "")

    def close(self):
        pass


def test_two_browsers_see_the_page():
    """Each gets models of its own."""
    source = Filled()
    pages = [Page(Context(source, Document()), [RoomTab, ChoicesTab]) for _ in range(2)]
    assert source.feed.wanted("range_doppler")
    for page in pages:
        page.close()
    assert not source.feed.wanted("range_doppler")


def test_who_draws_slowly_gets_fewer_pictures():
    """After some that were not drawn nothing is sent; then what is newest, in one piece."""
    source = Filled()
    context = Context(source, Document())
    page = Page(context, [RoomTab])
    sent = context.document.get_model_by_name("sent")
    drawn = context.document.get_model_by_name("drawn")
    for k in range(10):
        fill(source.feed, 0.1, start=2.0 + 0.1 * k)
        page.tick()
    assert sent.data["n"] == [AHEAD]
    drawn.data = {"n": [AHEAD]}
    page.tick()
    assert sent.data["n"] == [AHEAD + 1]
    assert source.feed.history().end_ns == 29 * SECOND // 10
    assert len(sent.data["people/x"][0]) == 1
    drawn.data = {"n": [AHEAD + 1]}
    page.tick()  # what this picture left to the next one, if it left anything
    last = sent.data["n"][0]
    assert last <= AHEAD + 2
    drawn.data = {"n": [last]}
    page.tick()
    page.tick()
    assert sent.data["n"] == [last]  # nothing is new


def test_a_choice_is_shown_while_time_stands_still():
    """Whose maps are shown may be chosen at a moment that stays: the tab is asked once more, and no more."""
    source, seen = Filled(), []
    context = Context(source, Document())
    page = Page(context, [RoomTab])
    page.tabs[0].update = seen.append
    page.bar._freeze()
    page.tick()
    fill(source.feed, 0.1, start=2.0)
    page.tick()
    assert len(seen) == 1
    context.document.get_model_by_name("person").value = "1"
    page.tick()
    page.tick()
    assert len(seen) == 2
    assert seen[0].stamp_ns == seen[1].stamp_ns
