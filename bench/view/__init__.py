"""`rebar view`: a campaign or one recording in a browser, from a server of this machine alone.

The server reads a folder and writes nothing. It hands out documents of scores and runs, and recordings by byte range: the
page decodes them itself. `app/` holds the sources of the page, and `static/app.js` is what `make view` builds from them.
"""

from __future__ import annotations

from ._content import CampaignContent as CampaignContent
from ._content import Content as Content
from ._content import content_of as content_of
from ._page import run_page as run_page
from ._server import ViewServer as ViewServer
