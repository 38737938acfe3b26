"""The studio: a page on which a person drags the lens and sees the rays and the response change.

A thin door: `document` holds the design that is worked on, `answers` calls the stages, `session` handles the
requests of one page, newest first, `guard` rejects requests from elsewhere, `server` serves the page in ``page/``,
which is built from ``web/``. `frames` defines the binary messages; `export` writes a page that needs no server.
"""
