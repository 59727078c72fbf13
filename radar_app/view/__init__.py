"""The live page (``handwave view``): what a graph, or a recording, sees and does, in a browser.

How it is made
--------------
A **source** (`live.LiveSource`, `bag.BagSource`) puts what it hears into a `feed.Feed`, in a thread of its own. The feed keeps the last
minute and knows neither ROS nor Bokeh. `server.serve` opens a Bokeh server; for every browser it makes a `page.Page` of **tabs**.

How to add a tab
----------------
A tab is one module with one class (or function) that takes a `page.Context` and gives a `page.Tab`: a title, a Bokeh layout,
``update(now)`` and ``close()``. Register it where the command makes its list of tabs (``radar_app/view_commands.py``), with
``functools.partial`` where it needs settings::

    class MyTab:
        title = "mine"

        def __init__(self, context: Context, folder: Path) -> None:
            self._feed, self._seen = context.feed, context.feed.number
            self._wish = ExitStack()
            self._wish.enter_context(self._feed.want("frames"))   # raw frames come only while somebody wants them
            self.layout = column(..., sizing_mode="stretch_width")

        def update(self, now: Snapshot) -> None:                  # the server's thread, some ten times a second while the tab is seen
            for entry in self._feed.after("maps", self._seen):    # every finished event since the last look, none twice, none missed
                ...                                               # entry.value: EventMaps; its Gesture has the same stamp_ns and track_id
                self._seen = entry.number

        def close(self) -> None:                                  # the browser has left
            self._wish.close()

What changes many times a second goes through ``context.pictures``: sources and texts that it makes are sent in one piece, when the browser
has drawn what it was sent before. What seldom changes may be set on Bokeh's models in the usual way. A model belongs to one document, so
style sheets that several share are texts (`style`), never models of a module.

``update`` is not called while another tab is seen. What must go on then (a logger that misses nothing) belongs into a thread or a periodic
callback of its own: ``context.document.add_periodic_callback`` runs in the server's thread as long as the browser is there, and `feed.Feed`
may be read from anywhere.

What a tab reads
----------------
``feed.history()`` freezes all that is kept: `feed.History`, whose channels hold `feed.Entry` (number, stamp_ns, value). Values are the
library's own results (`PointCloud` in ``room``, `Tracks`, `Gesture`, `HandTrack`, `ZoneStates`, `RadarFrame`) and those of `records`.
``history.at(stamp)`` is a `feed.Snapshot`: what was known at that moment. Numbers count everything that came, so
``feed.after(channel, number)`` tells what is new.
"""
