"""The studio: a page on which the user drags the lens and sees rays and response change.

It computes nothing itself: `document` stores the edited design, `answers` calls the stages, `session` handles the
requests of one page, newest first, `guard` rejects requests from elsewhere, and `server` serves the page in ``page/``,
which is built from ``web/``. `frames` defines the binary messages; `export` writes a page that needs no server.
"""
